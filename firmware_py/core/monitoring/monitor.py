"""Finds faults, debounces them and takes freeze frames, once in every epoch.

Part of the compiled step. Failures are bits in one word per kind of fault; only the trouble
codes of bits that fail, or failed recently, are processed.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.dbc.values import AxisState
from rrins.firmware_py.core.frames_in import senders
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, is_lost, navigating
from rrins.firmware_py.core.monitoring import consistency
from rrins.firmware_py.core.navigation import bridging
from rrins.firmware_py.core.records import trouble_table
from rrins.firmware_py.core.records.calibration_records import DriftState
from rrins.firmware_py.core.records.diagnostic_records import (
    ATTENTION_TROUBLES,
    DiagnosticState,
    Snapshot,
)
from rrins.firmware_py.core.records.encoder_records import AngleSource
from rrins.firmware_py.core.records.estimator_records import NO_TRUST, Aid
from rrins.firmware_py.core.records.memory import INNER, OUTER, Ram
from rrins.firmware_py.core.records.redundancy_records import ACCELEROMETERS, ParityBefore
from rrins.firmware_py.core.records.troubles import (
    AidingFault,
    AxisFault,
    Kind,
    Source,
    Status,
    SystemFault,
)

COUNTER_ONE = 1 << 16
COUNTER_CEILING, COUNTER_FLOOR = 127 * COUNTER_ONE, -128 * COUNTER_ONE
"""Limits of the fault detection counter: failed and passed (ISO 14229-1, D.1)."""

_FIRST = np.array(trouble_table.FIRST, dtype=np.int64)
_PARITY_ROW = np.full(len(trouble_table.TROUBLES), -1)
_PARITY_ROW[list(trouble_table.PARITY_KIND)] = np.arange(len(trouble_table.PARITY_KIND))
_OF_ACCELEROMETERS = np.array(list(trouble_table.PARITY_KIND.values())) == ACCELEROMETERS
_KINDS = len(Kind)
_BITS = 23  # of a kind's word, at most

_SILENT, _STALE = int(Kind.SILENT), int(Kind.STALE)
_CRC, _COUNTER = int(Kind.CRC), int(Kind.COUNTER)
_TWO_SENDERS = int(Kind.TWO_SENDERS)
_GYRO = int(Kind.GYRO_ABSENT)  # absent, saturated, stuck
_ACCELEROMETER = int(Kind.ACCELEROMETER_ABSENT)
_AXIS, _SYSTEM, _AIDING = int(Kind.AXIS), int(Kind.SYSTEM), int(Kind.AIDING)

_INNER_SHIFT = int(Source.AXIS_INNER)
_AXES = 3 << _INNER_SHIFT
_ALTIMETER = 1 << Source.ALTIMETER
_SYNC = 1 << Source.SYNC
_COMMAND = 1 << Source.MODE_COMMAND
_GNSS = 1 << Source.GNSS
_ODOMETER = 1 << Source.ODOMETER
_GNSS_LOST = 1 << AidingFault.GNSS_LOST
_ODOMETER_LOST = 1 << AidingFault.ODOMETER_LOST
_GATE_OPENED = 1 << AidingFault.GATE_OPENED
_REJECTED = (
    (int(Aid.ZERO_VELOCITY), 1 << AidingFault.ZERO_VELOCITY_REJECTED),
    (int(Aid.KNOWN_POSITION), 1 << AidingFault.KNOWN_POSITION_REJECTED),
    (int(Aid.GNSS_POSITION), 1 << AidingFault.GNSS_REJECTED),
    (int(Aid.GNSS_VELOCITY), 1 << AidingFault.GNSS_REJECTED),
    (int(Aid.ODOMETER), 1 << AidingFault.ODOMETER_REJECTED),
    (int(Aid.ALTIMETER), 1 << AidingFault.ALTIMETER_REJECTED),
)

_NOT_FOLLOWING, _DRIVE = int(AxisFault.NOT_FOLLOWING), int(AxisFault.DRIVE)
_ENCODER, _LIMIT = int(AxisFault.ENCODER), int(AxisFault.LIMIT)
_ABANDONED = int(AxisFault.ABANDONED)
_DRIVE_FAULT = int(AxisState.FAULT)
_BY_ENCODER = int(AngleSource.ENCODER)
_OVERSPEED, _OVERSPEED_DPS = 1.25, 0.5

_OVERRUN = 1 << SystemFault.OVERRUN
_BUS_LOAD = 1 << SystemFault.BUS_LOAD
_ERROR_PASSIVE = 1 << SystemFault.ERROR_PASSIVE
_BUS_OFF = 1 << SystemFault.BUS_OFF
_MEMORY = (
    1 << SystemFault.PARAMETER_COPY_DAMAGED
    | 1 << SystemFault.PARAMETERS_LOST
    | 1 << SystemFault.PARAMETER_OUT_OF_LIMITS
)
_SELF_TEST = 1 << SystemFault.SELF_TEST_FAILED
_ALIGNMENT = 1 << SystemFault.ALIGNMENT_FAILED
_NOT_CONVERGED = 1 << SystemFault.ALIGNMENT_NOT_CONVERGED
_SENSORS_LOST = 1 << SystemFault.SENSORS_LOST
_IMPLAUSIBLE = 1 << SystemFault.NAVIGATION_IMPLAUSIBLE
_CLOCK_JUMP = 1 << SystemFault.CLOCK_JUMP
_OFF_NOMINAL = 1 << SystemFault.CLOCK_OFF_NOMINAL
_GYROS_INCONSISTENT = 1 << SystemFault.GYROS_INCONSISTENT
_ACCELEROMETERS_INCONSISTENT = 1 << SystemFault.ACCELEROMETERS_INCONSISTENT

_GYROS_NOT_REDUNDANT = 1 << SystemFault.GYROS_NOT_REDUNDANT
_ACCELEROMETERS_NOT_REDUNDANT = 1 << SystemFault.ACCELEROMETERS_NOT_REDUNDANT
_GYROS_DRIFTED = 1 << SystemFault.GYRO_CALIBRATION_DRIFTED
_ACCELEROMETERS_DRIFTED = 1 << SystemFault.ACCELEROMETER_CALIBRATION_DRIFTED
_KEPT, _DRIFTED = int(DriftState.KEPT), int(DriftState.DRIFTED)
_GYRO_LEFT_OUT = int(Kind.GYRO_LEFT_OUT)
_ACCELEROMETER_LEFT_OUT = int(Kind.ACCELEROMETER_LEFT_OUT)
_BRIDGED = 1 << SystemFault.NAVIGATION_BRIDGED
_RESTARTED = 1 << SystemFault.RESTARTED

_LOAD_LIMIT = 0.8
_NOT_CONVERGED_AFTER = 2  # times the alignment's own time

_FAILED = int(Status.TEST_FAILED)
_SET_BY_FAILURE = int(
    Status.TEST_FAILED
    | Status.TEST_FAILED_THIS_OPERATION_CYCLE
    | Status.PENDING
    | Status.CONFIRMED
    | Status.TEST_FAILED_SINCE_LAST_CLEAR
)
_AGES = int(Status.PENDING | Status.CONFIRMED)
_COMPLETED = 0xFF & ~int(  # all other bits
    Status.TEST_NOT_COMPLETED_SINCE_LAST_CLEAR | Status.TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE
)
_PASSED = _COMPLETED & ~_FAILED  # bits that remain when a test passes


@compiled
def _look_at_frames(state: Ram, monitor: DiagnosticState) -> None:
    """Check the frames of each source; if SYNC is missing, too, blame no source."""
    assembly = state.assembly
    failing, tested = monitor.failing, monitor.tested
    groups = max(state.gyros.count, state.accelerometers.count)
    sources = (1 << groups) - 1 | _AXES
    came = np.int64(assembly.received)
    came |= np.int64(assembly.axis_received[INNER]) << _INNER_SHIFT
    came |= np.int64(assembly.axis_received[OUTER]) << (_INNER_SHIFT + 1)
    wrong = monitor.crc_wrong | monitor.counter_wrong | monitor.stale
    two = _second_senders(state, int(came))
    tested[_SILENT] = tested[_STALE] = tested[_CRC] = tested[_COUNTER] = 0
    tested[_TWO_SENDERS] = 0
    if state.clock.synchronised:
        tested[_STALE] = sources | _ALTIMETER
        others = _ALTIMETER | _SYNC | _COMMAND | _GNSS | _ODOMETER
        tested[_CRC] = tested[_COUNTER] = sources | others
        tested[_TWO_SENDERS] = sources | _ALTIMETER | _SYNC
        tested[_SILENT] = _SYNC
        failing[_SILENT] = _SYNC
        if state.clock.sync_seen:
            tested[_SILENT] |= sources
            failing[_SILENT] = sources & ~(came | wrong)
            _look_at_cyclic_frames(state, monitor, wrong)
    failing[_STALE] = monitor.stale & ~two
    failing[_CRC] = monitor.crc_wrong
    failing[_COUNTER] = monitor.counter_wrong & ~two
    failing[_TWO_SENDERS] = two


@compiled
def _second_senders(state: Ram, came: int) -> int:
    """Return the sources with two senders; `came` are the sensors and axes that were heard."""
    if state.assembly.altimeter_received:
        came |= _ALTIMETER
    if state.clock.sync_seen:
        came |= _SYNC
    return senders.second_senders(state, came)


@compiled
def _look_at_cyclic_frames(state: Ram, monitor: DiagnosticState, wrong: int) -> None:
    """Check the frames that are not sent in every epoch: MODE_COMMAND and aiding."""
    failing, tested = monitor.failing, monitor.tested
    patience = monitor.patience_epochs
    command_heard = monitor.command_seen or wrong & _COMMAND != 0
    monitor.command_silence = 0 if command_heard else monitor.command_silence + 1
    altimeter_heard = state.assembly.altimeter_received or wrong & _ALTIMETER != 0
    monitor.altimeter_silence = 0 if altimeter_heard else monitor.altimeter_silence + 1
    if state.mode_command_counter > 0:
        tested[_SILENT] |= _COMMAND
        if monitor.command_silence > patience:
            failing[_SILENT] |= _COMMAND
    if state.parameters.altimeter:
        tested[_SILENT] |= _ALTIMETER
        if monitor.altimeter_silence > patience:
            failing[_SILENT] |= _ALTIMETER
    if state.gnss.interval_epochs > 0:
        tested[_SILENT] |= _GNSS
        if state.gnss.silent_epochs > 2 * state.gnss.interval_epochs:
            failing[_SILENT] |= _GNSS
    if state.odometer.interval_epochs > 0:
        tested[_SILENT] |= _ODOMETER
        if state.odometer.silent_epochs > 2 * state.odometer.interval_epochs:
            failing[_SILENT] |= _ODOMETER


@compiled
def _look_at_aiding(state: Ram, monitor: DiagnosticState) -> None:
    """Check whether the sources of aiding say anything, and whether the estimator believes it."""
    failing = tested = 0
    gnss, odometer = state.gnss, state.odometer
    if gnss.interval_epochs > 0:
        tested |= _GNSS_LOST
        if gnss.lost:
            failing |= _GNSS_LOST
    if odometer.interval_epochs > 0:
        tested |= _ODOMETER_LOST
        if odometer.lost:
            failing |= _ODOMETER_LOST
    estimator = state.estimator
    if estimator.running:
        tested |= _GATE_OPENED
        for aid, rejected in _REJECTED:
            tested |= rejected
            if estimator.sources[aid].distrust >= NO_TRUST:
                failing |= rejected
        if estimator.reopened:
            failing |= _GATE_OPENED
    monitor.failing[_AIDING] = failing
    monitor.tested[_AIDING] = tested


@compiled
def _look_at_sensors(state: Ram, monitor: DiagnosticState) -> None:
    failing, tested = monitor.failing, monitor.tested
    came = int(state.assembly.received)
    gyros = came & ((1 << state.gyros.count) - 1)
    accelerometers = came & ((1 << state.accelerometers.count) - 1)
    for offset in range(3):
        tested[_GYRO + offset] = gyros
        tested[_ACCELEROMETER + offset] = accelerometers
    failing[_GYRO] = monitor.gyro_absent
    failing[_GYRO + 1] = monitor.gyro_saturated
    failing[_ACCELEROMETER] = monitor.accelerometer_absent
    failing[_ACCELEROMETER + 1] = monitor.accelerometer_saturated
    failing[_GYRO + 2] = monitor.gyro_repetition.stuck
    failing[_ACCELEROMETER + 2] = monitor.accelerometer_repetition.stuck


@compiled
def _look_at_parities(state: Ram, monitor: DiagnosticState) -> tuple[int, int]:
    """Return the failures and the tests run for redundancy; note the sensors left out."""
    redundancy = state.redundancy
    if not redundancy.enabled:
        return 0, 0
    gyros, accelerometers = redundancy.gyros, redundancy.accelerometers
    monitor.tested[_GYRO_LEFT_OUT] = (1 << state.gyros.count) - 1
    monitor.failing[_GYRO_LEFT_OUT] = gyros.excluded
    monitor.tested[_ACCELEROMETER_LEFT_OUT] = (1 << state.accelerometers.count) - 1
    monitor.failing[_ACCELEROMETER_LEFT_OUT] = accelerometers.excluded
    failing = 0
    tested = _GYROS_NOT_REDUNDANT | _ACCELEROMETERS_NOT_REDUNDANT
    if gyros.alarm:
        failing |= _GYROS_INCONSISTENT
    if accelerometers.alarm:
        failing |= _ACCELEROMETERS_INCONSISTENT
    if (gyros.excluded != 0 or gyros.redundant) and not gyros.redundancy_left:
        failing |= _GYROS_NOT_REDUNDANT
    compared = accelerometers.excluded != 0 or accelerometers.redundant
    if compared and not accelerometers.redundancy_left:
        failing |= _ACCELEROMETERS_NOT_REDUNDANT
    if state.calibration.gyros.state >= _KEPT:
        tested |= _GYROS_DRIFTED
        if state.calibration.gyros.state == _DRIFTED:
            failing |= _GYROS_DRIFTED
    if state.calibration.accelerometers.state >= _KEPT:
        tested |= _ACCELEROMETERS_DRIFTED
        if state.calibration.accelerometers.state == _DRIFTED:
            failing |= _ACCELEROMETERS_DRIFTED
    return failing, tested | failing


@compiled
def _look_at_redundancy(state: Ram, monitor: DiagnosticState) -> tuple[int, int]:
    """Return the failures and the tests run for disagreeing sensors."""
    came, assembly = int(state.assembly.received), state.assembly
    usable = came & ~(monitor.gyro_absent | monitor.gyro_saturated)
    gyros = consistency.gyros(
        state.gyros,
        assembly.gyro_dtheta,
        state.dtheta_s,
        usable,
        monitor.failing[_GYRO + 2],
        monitor,
    )
    usable = came & ~(monitor.accelerometer_absent | monitor.accelerometer_saturated)
    accelerometers = consistency.accelerometers(
        state.accelerometers,
        assembly.accelerometer_dv,
        state.dv_s,
        usable,
        monitor.failing[_ACCELEROMETER + 2],
        monitor,
    )
    failing, tested = _look_at_parities(state, monitor)
    if gyros >= 0.0:
        tested |= _GYROS_INCONSISTENT
        if gyros > state.parameters.gyro_consistency:
            failing |= _GYROS_INCONSISTENT
    if accelerometers >= 0.0:
        tested |= _ACCELEROMETERS_INCONSISTENT
        if accelerometers > state.parameters.accelerometer_consistency:
            failing |= _ACCELEROMETERS_INCONSISTENT
    return failing, tested


@compiled
def _look_at_axes(state: Ram, monitor: DiagnosticState) -> None:
    assembly, sequencer = state.assembly, state.sequencer
    limit_dps = _OVERSPEED * state.parameters.turn_rate_dps + _OVERSPEED_DPS
    failing = tested = 0
    for axis in range(2):
        if state.encoders.source[axis] != _BY_ENCODER:
            failing |= 1 << (_ENCODER + axis)
        if sequencer.not_following[axis]:
            failing |= 1 << (_NOT_FOLLOWING + axis)
        if sequencer.running or sequencer.not_following[axis]:
            tested |= 1 << (_NOT_FOLLOWING + axis)
        if sequencer.abandoned[axis]:
            failing |= 1 << (_ABANDONED + axis)
        tested |= 1 << (_ABANDONED + axis)
        if assembly.axis_received[axis]:
            tested |= 1 << (_DRIVE + axis) | 1 << (_LIMIT + axis) | 1 << (_ENCODER + axis)
            if assembly.axis_state[axis] == _DRIVE_FAULT:
                failing |= 1 << (_DRIVE + axis)
            if abs(assembly.encoder_rate_dps[axis]) > limit_dps:
                failing |= 1 << (_LIMIT + axis)
    monitor.failing[_AXIS] = failing
    monitor.tested[_AXIS] = tested


@compiled
def _look_at_clock(state: Ram, monitor: DiagnosticState) -> tuple[int, int]:
    """Return the failures and the tests run for overruns and the loop's clock."""
    failing = tested = 0
    if state.clock.synchronised:
        tested = _OVERRUN | _CLOCK_JUMP | _OFF_NOMINAL
    if state.faults.overruns != monitor.overruns_before:
        failing |= _OVERRUN
    if state.clock.jumps != monitor.jumps_before:
        failing |= _CLOCK_JUMP
    off_q16 = state.clock.period_q16 - (state.parameters.period_ns << 16)
    if abs(off_q16) > monitor.clock_tolerance_q16:
        failing |= _OFF_NOMINAL
    monitor.overruns_before = state.faults.overruns
    monitor.jumps_before = state.clock.jumps
    return failing, tested


@compiled
def _look_at_mode(state: Ram) -> tuple[int, int]:
    """Return the failures and the tests run for the modes."""
    mode, fault = state.modes.mode, state.modes.fault
    tested = 0
    if mode in (Mode.STANDBY, Mode.ALIGNMENT) or navigating(state):
        tested |= _SELF_TEST
    failing = 0
    if navigating(state):
        tested |= _ALIGNMENT | _NOT_CONVERGED | _SENSORS_LOST | _IMPLAUSIBLE | _BRIDGED | _RESTARTED
        if is_lost(state):
            failing |= _RESTARTED
        if bridging.is_degraded(state.bridging):
            failing |= _BRIDGED
    if fault == FirmwareFault.SELF_TEST_FAILED:
        failing |= _SELF_TEST
    elif fault == FirmwareFault.ALIGNMENT_FAILED:
        failing |= _ALIGNMENT
    elif fault == FirmwareFault.SENSORS_LOST:
        failing |= _SENSORS_LOST
    elif fault == FirmwareFault.NAVIGATION_DIVERGED:
        failing |= _IMPLAUSIBLE
    limit = _NOT_CONVERGED_AFTER * state.parameters.alignment_epochs + 1
    if mode == Mode.ALIGNMENT and not state.alignment.done and state.modes.epochs > limit:
        failing |= _NOT_CONVERGED
    return failing, tested | failing


@compiled
def _look_at_system(state: Ram, monitor: DiagnosticState) -> None:
    failing, tested = _look_at_clock(state, monitor)
    mode_failing, mode_tested = _look_at_mode(state)
    sensors_failing, sensors_tested = _look_at_redundancy(state, monitor)
    failing |= mode_failing | sensors_failing | monitor.memory_faults
    tested |= mode_tested | sensors_tested | _BUS_LOAD | _ERROR_PASSIVE | _BUS_OFF | _MEMORY
    if monitor.frames_mean > _LOAD_LIMIT * monitor.frames_capacity:
        failing |= _BUS_LOAD
    if monitor.bus_state_worst == 1:
        failing |= _ERROR_PASSIVE
    elif monitor.bus_state_worst == 2:
        failing |= _BUS_OFF
    monitor.bus_state_worst = monitor.bus_state
    monitor.failing[_SYSTEM] = failing
    monitor.tested[_SYSTEM] = tested


@compiled
def _freeze(state: Ram, snapshot: Snapshot) -> None:
    """Take a freeze frame."""
    output = state.navigation
    snapshot.epoch = state.epoch
    snapshot.modes.mode = state.modes.mode
    snapshot.modes.fault = state.modes.fault
    for axis in range(2):
        snapshot.assembly.encoder_angle_deg[axis] = state.assembly.encoder_angle_deg[axis]
    snapshot.navigation.latitude = output.latitude
    snapshot.navigation.longitude = output.longitude
    snapshot.navigation.height = output.height
    for i in range(3):
        snapshot.navigation.velocity_n[i] = output.velocity_n[i]
    snapshot.navigation.roll = output.roll
    snapshot.navigation.pitch = output.pitch
    snapshot.navigation.heading = output.heading


@compiled
def _freeze_parity(state: Ram, row: int, frozen: ParityBefore) -> None:
    """Add to a freeze frame what the parity was before its last alarm."""
    before = state.redundancy.gyros.before
    if _OF_ACCELEROMETERS[row]:
        before = state.redundancy.accelerometers.before
    frozen.epoch = before.epoch
    for k in range(frozen.ratio.shape[0]):
        frozen.ratio[k] = before.ratio[k]
    for k in range(frozen.residual.shape[0]):
        frozen.residual[k] = before.residual[k]


@compiled
def _fail(state: Ram, monitor: DiagnosticState, index: int) -> None:
    """Note that a test has newly failed."""
    memory = monitor.troubles
    if memory.occurrences[index] == 0:
        _freeze(state, memory.snapshots[index, 0])
    _freeze(state, memory.snapshots[index, 1])
    row = _PARITY_ROW[index]
    if row >= 0:
        if memory.occurrences[index] == 0:
            _freeze_parity(state, row, memory.parities[row, 0])
        _freeze_parity(state, row, memory.parities[row, 1])
    memory.occurrences[index] += 1
    memory.aging[index] = 0
    memory.status[index] = (memory.status[index] | _SET_BY_FAILURE) & _COMPLETED
    monitor.attention |= ATTENTION_TROUBLES


@compiled
def _pass(monitor: DiagnosticState, index: int) -> None:
    """Note that a test has passed; request storage if that changes its aging."""
    status = monitor.troubles.status[index]
    passed = status & _PASSED
    if passed != status and passed & _AGES != 0:
        monitor.attention |= ATTENTION_TROUBLES
    monitor.troubles.status[index] = passed


@compiled
def _debounce(state: Ram, monitor: DiagnosticState, kind: int, touched: int) -> None:
    """Count the fault detection counters of a kind's bits up or down."""
    failing = monitor.failing[kind]
    status = monitor.troubles.status
    for bit in range(_BITS):
        if touched >> bit & 1 == 0:
            continue
        index = _FIRST[kind] + bit
        counter = monitor.counter[index]
        if failing >> bit & 1:
            counter = min(max(counter, 0) + monitor.up[index], COUNTER_CEILING)
            monitor.unsettled[kind] |= 1 << bit
            if counter == COUNTER_CEILING and status[index] & _FAILED == 0:
                _fail(state, monitor, index)
        else:
            counter = max(counter - monitor.down[index], COUNTER_FLOOR)
            if counter == COUNTER_FLOOR:
                _pass(monitor, index)
                monitor.unsettled[kind] &= ~(1 << bit)
        monitor.counter[index] = counter


@compiled_with(is_unit=True)
def watch(state: Ram, frames: int) -> None:
    """Check an epoch at its end; `frames` is the number of frames on the bus in it."""
    monitor = state.diagnostics
    monitor.frames_mean += (frames - monitor.frames_mean) * monitor.frames_share
    _look_at_frames(state, monitor)
    _look_at_sensors(state, monitor)
    _look_at_axes(state, monitor)
    _look_at_aiding(state, monitor)
    _look_at_system(state, monitor)
    if not monitor.held:
        for kind in range(_KINDS):
            touched = monitor.tested[kind] & (monitor.failing[kind] | monitor.unsettled[kind])
            if touched != 0:
                _debounce(state, monitor, kind, touched)
    monitor.crc_wrong = 0
    monitor.counter_wrong = 0
    monitor.stale = 0
    monitor.command_seen = False
    monitor.gyro_absent = 0
    monitor.gyro_saturated = 0
    monitor.accelerometer_absent = 0
    monitor.accelerometer_saturated = 0
