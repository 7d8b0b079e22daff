"""Input-output control: 0x2F."""

from __future__ import annotations

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import Session
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.computer import AXIS_MODES, Computer
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.identifiers import IOControl
from rrins.firmware_py.diagnostics.refusal import RefusalError, require
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.server import Handler, Part, Server
from rrins.firmware_py.diagnostics.services.data import checked

_AXES = {
    table.identifier("axis_inner_control").number: 0,
    table.identifier("axis_outer_control").number: 1,
}
_HOME_DEG = 0.0


class Control(Part):
    """Outputs under a tool's control: the axes, and the sensors that the fusion uses."""

    def __init__(self, computer: Computer) -> None:
        self._computer = computer
        self._turning: dict[int, float] = {}  # axis -> commanded angle

    def leave_session(self, session: Session) -> None:
        """Return all control in the default session."""
        if session == Session.DEFAULT:
            for axis in (0, 1):
                self._return_axis(axis)
            self._exclude(0, 0)

    def control(self, server: Server, data: bytes) -> bytes:
        """Take control of an output, or return it (0x2F)."""
        require(len(data) >= 3, Code.INCORRECT_MESSAGE_LENGTH)
        did = table.IDENTIFIER_BY_NUMBER.get(int.from_bytes(data[:2], "big"))
        if did is None or did.control is None or not server.allows(did.control):
            raise RefusalError(Code.REQUEST_OUT_OF_RANGE)
        try:
            wanted = IOControl(data[2])
        except ValueError:
            raise RefusalError(Code.REQUEST_OUT_OF_RANGE) from None
        server.require_unlocked(did.control)
        values: Values = {}
        if wanted == IOControl.SHORT_TERM_ADJUSTMENT:
            values = checked(did, data[3:])
        else:
            require(len(data) == 3, Code.INCORRECT_MESSAGE_LENGTH)
        self._apply(did, wanted, values)
        return data[:3] + self._computer.read(did)

    def _apply(self, did: DataIdentifier, wanted: IOControl, values: Values) -> None:
        if did.number in _AXES:
            self._control_axis(_AXES[did.number], wanted, values)
        elif wanted == IOControl.SHORT_TERM_ADJUSTMENT:
            gyros, accelerometers = values["gyros"], values["accelerometers"]
            assert isinstance(gyros, int)
            assert isinstance(accelerometers, int)
            self._exclude(gyros, accelerometers)
        elif wanted != IOControl.FREEZE_CURRENT_STATE:
            self._exclude(0, 0)

    def _exclude(self, gyros: int, accelerometers: int) -> None:
        state = self._computer.state
        require(gyros >> int(state.gyros.count) == 0, Code.REQUEST_OUT_OF_RANGE)
        require(accelerometers >> int(state.accelerometers.count) == 0, Code.REQUEST_OUT_OF_RANGE)
        state.diagnostics.excluded_gyros = gyros
        state.diagnostics.excluded_accelerometers = accelerometers

    def _control_axis(self, axis: int, wanted: IOControl, values: Values) -> None:
        if wanted == IOControl.RETURN_CONTROL:
            self._return_axis(axis)
            return
        require(self._computer.mode in AXIS_MODES, Code.CONDITIONS_NOT_CORRECT)
        if wanted == IOControl.FREEZE_CURRENT_STATE:
            self._computer.hold_axis(axis)
            self._turning.pop(axis, None)
            return
        target = values.get("target_angle_deg", _HOME_DEG)
        assert isinstance(target, float)
        self._computer.turn_axis(axis, target)
        self._turning[axis] = target

    def _return_axis(self, axis: int) -> None:
        """Make an axis hold, unless the computer has commanded something else since."""
        target = self._turning.pop(axis, None)
        in_hand = target is not None and self._computer.is_told(axis, target)
        if in_hand and self._computer.mode in AXIS_MODES:
            self._computer.hold_axis(axis)

    def handlers(self) -> dict[int, Handler]:
        """Return the service of this group."""
        return {0x2F: self.control}
