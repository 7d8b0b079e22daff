"""Drives a unit's routine `table_calibration` over the bus, and reads its record as it grows."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Final, cast

import can

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import SCHEME_CAPACITY
from rrins.firmware_py.core.settings import Scheme
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.calibration_record import RECORD_ADDRESS, CalibrationEnd
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.routines import AxisName, RoutineState
from rrins.host_tools.calibration.estimation import Unit
from rrins.host_tools.calibration.model import Axes, Site
from rrins.host_tools.calibration.seconds import Seconds, of_bytes
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import CalibrationRecordError, RehearsalError
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.scenario.geometry import AxesDeg

_ROUTINE = table.routine("table_calibration")
_LOOK_S = 2.0
_log: Final = logging.getLogger(__name__)

_WORDS = {
    CalibrationEnd.STOPPED: "another tool stopped it",
    CalibrationEnd.MODE_LEFT: "the unit left STANDBY",
    CalibrationEnd.AXIS_NOT_FOLLOWING: "an axis of the table does not follow",
    CalibrationEnd.AXIS_TAKEN: "something else commands the table",
    CalibrationEnd.BASE_MOVED: "the base moves",
    CalibrationEnd.SESSION_ENDED: "the unit heard nothing of this tool for 5 s, time after time",
}


class RoutineRun:
    """A calibration under way.

    Parameters
    ----------
    tester : Tester
        Allowed to unlock the unit.
    first : int
        The position to begin with, from 0.

    Attributes
    ----------
    gyros, accelerometers : int
        How many the unit has.
    sensor : int
        That has failed, from 1, if the end says so.
    """

    def __init__(self, tester: Tester, scheme: Scheme, first: int = 0) -> None:
        self._tester = tester
        self._scheme, self._first = scheme, first
        found = tester.read([table.identifier("sensors")])["sensors"]
        self.gyros = cast("int", found["gyros"])
        self.accelerometers = cast("int", found["accelerometers"])
        self.sensor = 0

    def start(self) -> None:
        """Begin; a unit that navigates goes to STANDBY first."""
        mode = self._mode()
        if mode not in (Mode.STANDBY, Mode.SELF_TEST, Mode.POWER_ON):
            self._tester.start(table.routine("standby"), {})
        turns = self._scheme.turns
        rest = SCHEME_CAPACITY - len(turns)
        axes = [AxisName.INNER if turn.axis == "inner" else AxisName.OUTER for turn in turns]
        self._tester.start(
            _ROUTINE,
            {
                "positions": len(turns),
                "first": self._first,
                "turn_rate_dps": self._scheme.turn_rate_dps,
                "stand_s": self._scheme.stand_s,
                "axis": (*(int(axis) for axis in axes), *([0] * rest)),
                "angle_deg": (*(turn.angle_deg for turn in turns), *([0.0] * rest)),
            },
        )

    def _mode(self) -> Mode:
        did = table.identifier("mode")
        return Mode(cast("int", self._tester.read([did])["mode"]["mode"]))

    def follow(
        self, on_seconds: Callable[[Seconds], None], should_stop: Callable[[], bool]
    ) -> CalibrationEnd:
        """Read what is recorded until the routine has ended; return why it ended.

        `on_seconds` is called with the new seconds. If `should_stop` says so, or anything is
        raised, the routine is stopped: the unit is in STANDBY and both axes hold.
        """
        read = 0
        try:
            while True:
                self._tester.conversation.pass_time(_LOOK_S)
                stopping = should_stop()
                results = self._tester.stop(_ROUTINE) if stopping else self._results()
                size = cast("int", results["second_bytes"]) * cast("int", results["seconds"])
                if size > read:
                    data = self._tester.read_memory(RECORD_ADDRESS + read, size - read)
                    read = size
                    period_s = cast("int", results["period_ns"]) * 1e-9
                    on_seconds(of_bytes(data, self.gyros, self.accelerometers, period_s))
                if results["state"] != RoutineState.RUNNING:
                    self.sensor = cast("int", results["sensor"])
                    return CalibrationEnd(cast("int", results["end"]))
        except BaseException:
            self._give_up()
            raise

    def _results(self) -> Values:
        return self._tester.result(_ROUTINE)

    def _give_up(self) -> None:
        """Stop the routine if the bus still allows; without a tool it ends by itself after 5 s."""
        try:
            if self._results()["state"] == RoutineState.RUNNING:
                self._tester.stop(_ROUTINE)
        except (RehearsalError, can.CanError) as error:
            _log.warning("calibration: the unit could not be told to stop: %s", error)

    def require_done(self, end: CalibrationEnd) -> None:
        """Raise `CalibrationRecordError` unless the routine came to its end."""
        if end == CalibrationEnd.DONE:
            return
        words = _WORDS.get(end, end.name.lower().replace("_", " "))
        if end in (CalibrationEnd.GYRO_FAILED, CalibrationEnd.ACCELEROMETER_FAILED):
            kind = "gyro" if end == CalibrationEnd.GYRO_FAILED else "accelerometer"
            words = f"{kind} {self.sensor} failed"
        raise CalibrationRecordError(f"calibration: {words}; the unit keeps its old calibration")


def told_unit(tester: Tester, axes: tuple[AxesDeg, AxesDeg]) -> Unit:
    """Return what the computer is told about its site and base, with sensors along `axes`.

    Raises
    ------
    CalibrationRecordError
        When the computer has another number of sensors.
    """
    sensors = tester.read([table.identifier("sensors")])["sensors"]
    for kind, given in zip(("gyros", "accelerometers"), axes, strict=True):
        if sensors[kind] != len(given):
            raise CalibrationRecordError(
                f"the unit has {sensors[kind]} {kind}, the geometry {len(given)}: name the "
                "scenario, or another --rimu"
            )
    dids = [table.identifier("start_position"), table.identifier("initial_attitude")]
    values = tester.read(dids)
    position, attitude = values["start_position"], values["initial_attitude"]
    roll, pitch, heading = (
        math.radians(float(cast("float", attitude[name])))
        for name in ("roll_deg", "pitch_deg", "heading_deg")
    )
    return Unit(
        gyros=Axes.of(axes[0]),
        accelerometers=Axes.of(axes[1]),
        site=Site(
            math.radians(float(cast("float", position["latitude_deg"]))),
            float(cast("float", position["height_m"])),
        ),
        C_b_n=body_to_navigation(roll, pitch, heading),
    )
