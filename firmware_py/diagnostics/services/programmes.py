"""The routines at work; `calibration` has a file of its own."""

from __future__ import annotations

from rrins.dbc.values import AxisState
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode
from rrins.firmware_py.core.records.diagnostic_records import RoutineRequest
from rrins.firmware_py.core.records.redundancy_records import (
    Readmission,
    ReadmissionOrder,
    ReadmissionState,
)
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.computer import AXIS_MODES, Computer
from rrins.firmware_py.diagnostics.reader import FieldReader
from rrins.firmware_py.diagnostics.refusal import RefusalError
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.routines import RoutineState
from rrins.firmware_py.diagnostics.writer import WriteJob

ARRIVED_DEG = 1.0
"""Distance at which a turn has arrived: the coarsest encoder steps by 1.4°."""

GRACE_S = 10.0
"""Of a turn, beside twice its time."""


class Programme:
    """A routine at work.

    Attributes
    ----------
    routine : Routine
        Of the table.
    ends_with_session : bool
        Whether it stops when the tool's session ends.
    """

    name = ""
    ends_with_session = False

    def __init__(self, computer: Computer) -> None:
        self.computer = computer
        self.routine = table.routine(self.name)
        self.state = RoutineState.NEVER_STARTED
        self._waits = False  # for the step that handles a request
        sourced = [field for field in self.routine.results if field.source]
        self._reader = FieldReader(computer.ram, sourced)

    @property
    def is_running(self) -> bool:
        """Whether it runs."""
        return self.state == RoutineState.RUNNING

    @property
    def can_be_stopped(self) -> bool:
        """Whether there is something to stop."""
        return self.is_running

    @property
    def was_started(self) -> bool:
        """Whether it has results."""
        return self.state != RoutineState.NEVER_STARTED

    def forget(self) -> None:
        """Return to the state after power-on."""
        self.state = RoutineState.NEVER_STARTED

    def may_start(self) -> bool:
        """Return whether the computer's mode allows it."""
        return True

    def start(self, arguments: Values) -> None:
        """Begin."""
        self.state = RoutineState.RUNNING

    def stop(self) -> None:
        """End early."""
        self.state = RoutineState.STOPPED

    def end_with_session(self) -> None:
        """End early, because the session of the tool has ended."""
        self.stop()

    def work(self) -> None:
        """Do one epoch's work, while it runs."""

    def is_settled(self) -> bool:
        """Return whether the response to a request can be given."""
        return not self._waits

    def results(self) -> Values:
        """Return the results so far."""
        return {"state": int(self.state)} | self._reader.read()


class _Requesting(Programme):
    """A routine that requests a mode, which takes effect in the next step."""

    routine_request = RoutineRequest.NONE
    modes_to_start: tuple[Mode, ...] = ()
    running = Mode.STANDBY

    def may_start(self) -> bool:
        """Return whether the mode allows it."""
        return self.computer.mode in self.modes_to_start

    def start(self, arguments: Values) -> None:
        """Begin."""
        super().start(arguments)
        self.computer.ask(self.routine_request)
        self._waits = True

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        self._waits = False  # the step has handled the request by now
        if self.computer.mode != self.running:
            self.state = self.ended()

    def ended(self) -> RoutineState:
        """Return the outcome once the mode has changed."""
        return RoutineState.DONE


class SelfTest(_Requesting):
    """The self-test."""

    name = "self_test"
    routine_request = RoutineRequest.SELF_TEST
    modes_to_start = (Mode.STANDBY, Mode.FAULT)
    running = Mode.SELF_TEST

    def ended(self) -> RoutineState:
        """Return the outcome once the mode has changed."""
        failed = self.computer.state.modes.fault == FirmwareFault.SELF_TEST_FAILED
        return RoutineState.FAILED if failed else RoutineState.DONE


class Alignment(_Requesting):
    """The alignment."""

    name = "alignment"
    routine_request = RoutineRequest.ALIGN
    modes_to_start = (Mode.STANDBY,)
    running = Mode.ALIGNMENT

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        super().work()
        if self.is_running and self.computer.state.alignment.done:
            self.state = RoutineState.DONE

    def stop(self) -> None:
        """End early."""
        super().stop()
        self.computer.ask(RoutineRequest.STANDBY)

    def ended(self) -> RoutineState:
        """Return the outcome once the mode has changed."""
        if self.computer.state.alignment.done:
            return RoutineState.DONE
        failed = self.computer.mode == Mode.FAULT
        return RoutineState.FAILED if failed else RoutineState.STOPPED


class Rotation(_Requesting):
    """The rotation scheme."""

    name = "rotation"
    routine_request = RoutineRequest.START_ROTATION
    modes_to_start = (Mode.NAVIGATION_STRAPDOWN,)
    running = Mode.NAVIGATION_ROTATING

    @property
    def can_be_stopped(self) -> bool:
        """Whether the scheme runs, whoever started it."""
        return self.computer.mode == Mode.NAVIGATION_ROTATING

    def stop(self) -> None:
        """End early."""
        super().stop()
        self.computer.ask(RoutineRequest.STOP_ROTATION)

    def ended(self) -> RoutineState:
        """Return the outcome once the mode has changed."""
        not_following = self.computer.state.sequencer.not_following.any()
        return RoutineState.FAILED if not_following else RoutineState.STOPPED


class Standby(_Requesting):
    """Back to STANDBY."""

    name = "standby"
    routine_request = RoutineRequest.STANDBY
    modes_to_start = (Mode.ALIGNMENT, Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING)

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        self._waits = False
        at_standby = self.computer.mode == Mode.STANDBY
        self.state = RoutineState.DONE if at_standby else RoutineState.FAILED


class ReadmitSensor(Programme):
    """The test of a sensor that is left out, and its return."""

    name = "readmit_sensor"

    @property
    def _readmission(self) -> Readmission:
        return self.computer.state.redundancy.readmission

    @property
    def can_be_stopped(self) -> bool:
        """Whether a sensor is being tested, whoever ordered it."""
        return bool(self._readmission.state == ReadmissionState.TESTING)

    def may_start(self) -> bool:
        """Return whether redundant sensors are compared, and none is being tested."""
        return bool(self.computer.state.redundancy.enabled) and not self.can_be_stopped

    def start(self, arguments: Values) -> None:
        """Begin."""
        super().start(arguments)
        readmission = self._readmission
        readmission["order_kind"] = arguments["kind"]
        readmission["order_sensor"] = arguments["sensor"]
        readmission["order_s"] = arguments["test_s"]
        readmission["order_anew"] = arguments["anew"]
        readmission.order = ReadmissionOrder.TEST
        self._waits = True

    def stop(self) -> None:
        """End early."""
        super().stop()
        self._readmission.order = ReadmissionOrder.STOP

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        self._waits = False  # the step has handled the order by now
        self.state = OUTCOMES[ReadmissionState(int(self._readmission.state))]


OUTCOMES = {
    ReadmissionState.NONE: RoutineState.RUNNING,  # no epoch with SYNC yet
    ReadmissionState.TESTING: RoutineState.RUNNING,
    ReadmissionState.READMITTED: RoutineState.DONE,
    ReadmissionState.REFUSED: RoutineState.FAILED,
    ReadmissionState.STOPPED: RoutineState.STOPPED,
}
"""States of the routine by those of the sensor's test."""


class AxisTurn(Programme):
    """A turn of one axis to an angle."""

    name = "go_to_axis_angle"
    ends_with_session = True

    def __init__(self, computer: Computer) -> None:
        super().__init__(computer)
        self._axis = 0
        self._target_deg = 0.0
        self._epochs_left = 0

    def may_start(self) -> bool:
        """Return whether the mode allows it."""
        return self.computer.mode in AXIS_MODES

    def start(self, arguments: Values) -> None:
        """Begin."""
        axis, target = arguments["axis"], arguments["angle_deg"]
        assert isinstance(axis, int)
        assert isinstance(target, float)
        super().start(arguments)
        self._axis, self._target_deg = axis, target
        state = self.computer.state
        turn_deg = abs(target - float(state.assembly.encoder_angle_deg[axis]))
        seconds = 2.0 * turn_deg / float(state.parameters.turn_rate_dps) + GRACE_S
        self._epochs_left = round(seconds * 1e9 / self.computer.period_ns)
        self.computer.turn_axis(axis, target)

    def stop(self) -> None:
        """End early."""
        super().stop()
        if self.computer.is_told(self._axis, self._target_deg):
            self.computer.hold_axis(self._axis)

    def work(self) -> None:
        """Do one epoch's work, while it runs."""
        self._epochs_left -= 1
        assembly = self.computer.state.assembly
        angle_deg = float(assembly.encoder_angle_deg[self._axis])
        holds = assembly.axis_state[self._axis] == AxisState.HOLDING
        if not self.computer.is_told(self._axis, self._target_deg):
            self.state = RoutineState.STOPPED  # another command replaced this one
        elif holds and abs(angle_deg - self._target_deg) <= ARRIVED_DEG:
            self.state = RoutineState.DONE
        elif self._epochs_left <= 0:
            self.state = RoutineState.FAILED
            self.computer.hold_axis(self._axis)

    def results(self) -> Values:
        """Return the results so far."""
        assembly = self.computer.state.assembly
        return {
            "state": int(self.state),
            "axis": self._axis,
            "encoder_angle_deg": float(assembly.encoder_angle_deg[self._axis]),
            "axis_state": int(assembly.axis_state[self._axis]),
        }


class RestoreSetUp(Programme):
    """Empties the parameter memory."""

    name = "restore_set_up"

    def __init__(self, computer: Computer) -> None:
        super().__init__(computer)
        self._job: WriteJob | None = None

    def start(self, arguments: Values) -> None:
        """Begin."""
        super().start(arguments)
        self._job = self.computer.parameters.replace({})

    def is_settled(self) -> bool:
        """Return whether the response to a request can be given."""
        if self._job is None:
            return True
        if not self._job.done:
            return False
        went_well = self.computer.parameters.finish(self._job)
        self._job = None
        self.state = RoutineState.DONE if went_well else RoutineState.FAILED
        if not went_well:
            raise RefusalError(Code.GENERAL_PROGRAMMING_FAILURE)
        return True
