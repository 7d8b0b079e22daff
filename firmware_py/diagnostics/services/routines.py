"""Routine control: 0x31."""

from __future__ import annotations

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import Session
from rrins.firmware_py.diagnostics.codecs import LengthError, ValueRangeError, Values
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.refusal import Answer, Later, RefusalError, require
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.routines import Routine
from rrins.firmware_py.diagnostics.server import Handler, Part, Server
from rrins.firmware_py.diagnostics.services import programmes
from rrins.firmware_py.diagnostics.services.calibration import CalibrationProgramme
from rrins.firmware_py.diagnostics.services.programmes import Programme
from rrins.firmware_py.diagnostics.services.table_calibration import TableCalibration

_START, _STOP = 0x01, 0x02


class Routines(Part):
    """The service that starts and stops routines, and reports their results."""

    def __init__(self, computer: Computer) -> None:
        made: tuple[Programme, ...] = (
            programmes.SelfTest(computer),
            programmes.Alignment(computer),
            programmes.AxisTurn(computer),
            programmes.Rotation(computer),
            CalibrationProgramme(computer),
            TableCalibration(computer),
            programmes.RestoreSetUp(computer),
            programmes.Standby(computer),
            programmes.ReadmitSensor(computer),
        )
        self._programmes = {programme.routine.number: programme for programme in made}

    @property
    def is_busy(self) -> bool:
        """Whether a running routine needs `work`."""
        return any(programme.is_running for programme in self._programmes.values())

    def work(self) -> None:
        """Do one epoch's work of the running routines."""
        for programme in self._programmes.values():
            if programme.is_running:
                programme.work()

    def leave_session(self, session: Session) -> None:
        """In the default session, stop the routines that run only for the tool."""
        if session == Session.DEFAULT:
            for programme in self._programmes.values():
                if programme.is_running and programme.ends_with_session:
                    programme.end_with_session()

    def power_on(self) -> None:
        """Forget all results."""
        for programme in self._programmes.values():
            programme.forget()

    def control(self, server: Server, data: bytes) -> Answer:
        """Start or stop a routine, or report its results (0x31)."""
        require(len(data) >= 3, Code.INCORRECT_MESSAGE_LENGTH)
        routine = table.ROUTINE_BY_NUMBER.get(int.from_bytes(data[1:3], "big"))
        if routine is None or not server.allows(routine.access):
            raise RefusalError(Code.REQUEST_OUT_OF_RANGE)
        server.require_unlocked(routine.access)
        require(routine.can_stop or data[0] != _STOP, Code.SUB_FUNCTION_NOT_SUPPORTED)
        programme = self._programmes[routine.number]
        arguments = _arguments(routine, data[3:]) if data[0] == _START else {}
        require(data[0] == _START or len(data) == 3, Code.INCORRECT_MESSAGE_LENGTH)
        if data[0] == _START:
            self._start(programme, arguments)
        elif data[0] == _STOP:
            require(programme.can_be_stopped, Code.REQUEST_SEQUENCE_ERROR)
            programme.stop()
        else:
            require(programme.was_started, Code.REQUEST_SEQUENCE_ERROR)

        def poll() -> bytes | None:
            if not programme.is_settled():
                return None
            return data[:3] + routine.result_layout.encode(programme.results())

        return Later(poll)

    @staticmethod
    def _start(programme: Programme, arguments: Values) -> None:
        require(not programme.is_running, Code.REQUEST_SEQUENCE_ERROR)
        require(programme.may_start(), Code.CONDITIONS_NOT_CORRECT)
        programme.start(arguments)

    def handlers(self) -> dict[int, Handler]:
        """Return the service of this group."""
        return {0x31: self.control}


def _arguments(routine: Routine, data: bytes) -> Values:
    """Return a routine's arguments, or raise `RefusalError`."""
    try:
        arguments = routine.argument_layout.decode(data)
    except LengthError:
        raise RefusalError(Code.INCORRECT_MESSAGE_LENGTH) from None
    try:
        routine.argument_layout.check(arguments)
    except ValueRangeError:
        raise RefusalError(Code.REQUEST_OUT_OF_RANGE) from None
    return arguments
