"""The routine `table_calibration`: turns the table through a scheme and records sums of a second.

It runs in STANDBY and leaves the unit there. A tool reads the record as it grows, from
`RECORD_ADDRESS`, and estimates the sensors' constants from it; nothing is stored here. What would
spoil the record ends the routine with a reason.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import cast

import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.values import AxisCommand
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.memory import INNER, OUTER
from rrins.firmware_py.core.turntable import sequencer, table_sums
from rrins.firmware_py.core.turntable.table_sums import TableSums
from rrins.firmware_py.diagnostics.calibration_record import AT_REST, CalibrationEnd, record_of
from rrins.firmware_py.diagnostics.codecs import Value, Values
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.routines import RoutineState
from rrins.firmware_py.diagnostics.services.programmes import Programme

SETTLE_S = 0.5
"""After a turn, before the table counts as at rest."""

WATCH_EPOCHS = 20
"""Between two looks at the axes."""

MISSING_S = 3
"""Seconds in a row in which a sensor misses an epoch: it has failed."""

MOVED_S = 4
"""Seconds in a row in which the base seems to move: longer than it takes to find a stuck sensor."""

TURN_LIMIT = math.radians(0.05)
"""rad/s that the base may turn: 0.02 °/s, and what uncalibrated sensors err by at 2 °/s."""

FORCE_LIMIT = 0.05 * earth.GRAVITY_EQUATOR
"""m/s² by which the specific force of a base at rest, and uncalibrated sensors, may be off."""


class _Stage(IntEnum):
    HOMING = 0
    POSITIONS = 1


class TableCalibration(Programme):
    """A scheme of turns, and the sums of its seconds."""

    name = "table_calibration"
    ends_with_session = True

    def __init__(self, computer: Computer) -> None:
        super().__init__(computer)
        self._sums = TableSums.zeros()
        self._clear()

    def _clear(self) -> None:
        self._stage = _Stage.HOMING
        self._end = CalibrationEnd.NONE
        self._sensor = self._moved = 0
        self._position = self._epochs = self._wanted = self._left = 0
        self._missing = np.zeros((2, 2), dtype=int)  # kind; bits before, seconds in a row
        self._axes: list[int] = []
        self._turns_deg: list[float] = []
        self._targets_deg = [0.0, 0.0]
        self._stand_s = 0.0
        self._rate_before_dps = 0.0
        self.computer.calibration_record.clear()

    def may_start(self) -> bool:
        """Return whether the mode allows it."""
        return self.computer.mode == Mode.STANDBY

    def start(self, arguments: Values) -> None:
        """Begin, at the first position that is asked for."""
        super().start(arguments)
        self._clear()
        count, first = cast("int", arguments["positions"]), cast("int", arguments["first"])
        self._axes = list(cast("tuple[int, ...]", arguments["axis"])[:count])
        self._turns_deg = list(cast("tuple[float, ...]", arguments["angle_deg"])[:count])
        self._stand_s = cast("float", arguments["stand_s"])
        parameters = self.computer.state.parameters
        self._rate_before_dps = float(parameters.turn_rate_dps)
        parameters["turn_rate_dps"] = arguments["turn_rate_dps"]
        self._position = min(first, count)
        for axis, turn_deg in zip(self._axes[:first], self._turns_deg[:first], strict=True):
            self._targets_deg[axis] += turn_deg
        self._stage = _Stage.HOMING
        self._command()
        self._left = 0

    def _command(self) -> None:
        """Turn both axes to their targets; know how long that takes."""
        state = self.computer.state
        longest_s = 0.0
        for axis in (INNER, OUTER):
            target_deg = self._targets_deg[axis]
            now_deg = float(state.assembly.encoder_angle_deg[axis])
            span = float(state.parameters.angle_span_deg)
            now_deg += span * round((target_deg - now_deg) / span)
            state.sequencer.start_angle_deg[axis] = now_deg
            self.computer.turn_axis(axis, target_deg)
            longest_s = max(longest_s, self._turn_s(abs(target_deg - now_deg)))
        state.sequencer.epochs = state.sequencer.turn_begun = 0
        stand_s = self._stand_s if self._stage == _Stage.POSITIONS else AT_REST
        self._wanted = max(1, round((longest_s + stand_s) * 1e9 / self.computer.period_ns))
        self._epochs = 0

    def _turn_s(self, turn_deg: float) -> float:
        parameters = self.computer.state.parameters
        if turn_deg < 1e-6:
            return 0.0
        rate, acceleration = parameters.turn_rate_dps, parameters.axis_acceleration_dps2
        settle_s = float(rate / acceleration + parameters.axis_rise_s) + SETTLE_S
        return float(turn_deg / rate) + settle_s

    def stop(self) -> None:
        """End early; both axes hold."""
        super().stop()
        self._end = CalibrationEnd.STOPPED
        self._release()

    def end_with_session(self) -> None:
        """End early, because the session of the tool has ended; both axes hold."""
        self.stop()
        self._end = CalibrationEnd.SESSION_ENDED

    def forget(self) -> None:
        """Return to the state after power-on."""
        super().forget()
        self._clear()

    def _release(self) -> None:
        """Let both axes hold, and turn at the former rate from now on."""
        parameters = self.computer.state.parameters
        parameters["turn_rate_dps"] = self._rate_before_dps
        if self.computer.mode == Mode.STANDBY:
            for axis in (INNER, OUTER):
                self.computer.hold_axis(axis)

    def _fail(self, end: CalibrationEnd, sensor: int = 0) -> None:
        self.state = RoutineState.FAILED
        self._end, self._sensor = end, sensor
        self._release()

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        self._epochs += 1
        is_over = self._epochs >= self._wanted
        if is_over or self._epochs % WATCH_EPOCHS == 0:
            self._watch()
        if self.is_running and self._stage == _Stage.POSITIONS:
            table_sums.add(self.computer.ram, self._sums)
            self._left -= 1
            if self._left == 0 or is_over:
                self._close_second()
        if is_over and self.is_running:
            self._advance()

    def _watch(self) -> None:
        """End the routine if the mode was left, or an axis does not do what it is told."""
        state = self.computer.state
        state.sequencer.epochs = self._epochs
        if self.computer.mode != Mode.STANDBY:
            self._fail(CalibrationEnd.MODE_LEFT)
        elif self._is_commanded_otherwise():
            self._fail(CalibrationEnd.AXIS_TAKEN)
        elif sequencer.watch(state.sequencer, state.parameters, state.assembly):
            self._fail(CalibrationEnd.AXIS_NOT_FOLLOWING)

    def _is_commanded_otherwise(self) -> bool:
        targets = enumerate(self._targets_deg)
        command = self.computer.state.sequencer.command
        told = self.computer.state.sequencer.target_angle_deg
        return any(
            command[axis] != AxisCommand.POSITION or told[axis] != target
            for axis, target in targets
        )

    def _advance(self) -> None:
        """Go on to the next position, or end."""
        if self._stage == _Stage.POSITIONS:
            self._position += 1
        else:
            self._stage = _Stage.POSITIONS
            self._sums = TableSums.zeros()
            table_sums.add(self.computer.ram, self._sums)
        if self._position >= len(self._axes):
            self.state = RoutineState.DONE
            self._end = CalibrationEnd.DONE
            self._release()
            return
        self._targets_deg[self._axes[self._position]] += self._turns_deg[self._position]
        self._command()
        self._left = self._second_epochs

    @property
    def _second_epochs(self) -> int:
        return 1_000_000_000 // self.computer.period_ns

    def _close_second(self) -> None:
        """Keep the second in the record, if nothing is wrong with it."""
        state, sums = self.computer.state, self._sums[0]
        seconds = int(sums.epochs) * self.computer.period_ns * 1e-9
        if seconds > 0.0:
            self._guard(seconds)
            self.computer.calibration_record += record_of(state, sums, self._position)
        table_sums.begin(sums)
        self._left = self._second_epochs

    def _guard(self, seconds: float) -> None:
        """End the routine if a sensor has failed, or the base moves."""
        sums = self._sums[0]
        for kind, bits in enumerate((int(sums.gyro_missing), int(sums.accelerometer_missing))):
            both = bits & int(self._missing[kind, 0]) if self._missing[kind, 1] else bits
            self._missing[kind] = (both, self._missing[kind, 1] + 1) if both else (0, 0)
            if self._missing[kind, 1] >= MISSING_S:
                end = CalibrationEnd.ACCELEROMETER_FAILED if kind else CalibrationEnd.GYRO_FAILED
                self._fail(end, (both & -both).bit_length())
                return
        for repetition, end in (
            (self.computer.state.diagnostics.gyro_repetition, CalibrationEnd.GYRO_FAILED),
            (
                self.computer.state.diagnostics.accelerometer_repetition,
                CalibrationEnd.ACCELEROMETER_FAILED,
            ),
        ):
            stuck = int(repetition.stuck)
            if stuck:
                self._fail(end, (stuck & -stuck).bit_length())
                return
        if sums.gyro_missing or sums.accelerometer_missing or sums.axis_missing:
            return
        self._moved = self._moved + 1 if self._moves(seconds) else 0
        if self._moved >= MOVED_S:
            self._fail(CalibrationEnd.BASE_MOVED)

    def _moves(self, seconds: float) -> bool:
        """Return whether the base seems to move in a second."""
        sums = self._sums[0]
        table = np.array([sums.turn[2], -sums.turn[3], sums.turn[0]])
        turned: Floats = sums.rotation_s - table
        off = _sensed(sums) - self.computer.gravity * seconds
        is_turning = np.linalg.norm(turned) > TURN_LIMIT * seconds
        return bool(is_turning or abs(off) > FORCE_LIMIT * seconds)

    def results(self) -> Values:
        """Return the results so far."""
        state = self.computer.state
        size = len(record_of(state, self._sums[0], 0))
        found: dict[str, Value] = {
            "state": int(self.state),
            "end": int(self._end),
            "sensor": self._sensor,
            "position": min(self._position, 255),
            "seconds": len(self.computer.calibration_record) // size,
            "second_bytes": size,
            "period_ns": self.computer.period_ns,
        }
        return found


def _sensed(sums: TableSums) -> float:
    """Return the amount of the velocity of a second, m/s, as if the table had not turned in it.

    A turn of θ within the second makes the sum of a constant vector across it shorter, by sin(θ/2)
    over θ/2.
    """
    turn = max(abs(float(sums.turn[0])), abs(float(sums.turn[1])), 1e-9)
    chord = math.sin(0.5 * turn) / (0.5 * turn)
    axis = np.array([0.0, 0.0, 1.0])
    if abs(sums.turn[1]) > abs(sums.turn[0]):
        axis = np.array([sums.turn[2], -sums.turn[3], 0.0]) / sums.turn[1]
    along = float(axis @ sums.velocity_s)
    across = float(np.linalg.norm(sums.velocity_s - along * axis)) / chord
    return math.hypot(along, across)
