"""Compares the sensors in every epoch, leaves out the one that fails, and repairs the history.

Part of the compiled step, in constant time: sums and the tests of short windows in each epoch,
the rest once a second, kind after kind.
"""

from __future__ import annotations

from rrins.dbc.compilation import compiled
from rrins.dbc.record import Floats
from rrins.firmware_py.core import fusion as least_squares
from rrins.firmware_py.core.memory import Fusion, Ram
from rrins.firmware_py.core.redundancy import isolation, repair, standing, windows
from rrins.firmware_py.core.redundancy import parity as parities
from rrins.firmware_py.core.redundancy_records import (
    ABSOLUTE,
    ACCELEROMETERS,
    SECOND_LEVELS,
    Found,
    Parity,
)

_STANDING, _PARITY = int(Found.STANDING), int(Found.PARITY)
_STUCK, _ABSENT = int(Found.STUCK), int(Found.ABSENT)
_CLEAR_AFTER_S = 10


@compiled
def correct(parity: Parity, fusion: Fusion, received: int, valid: int, measured: Floats) -> None:
    """Take what was learned of the parity off the increments, in place.

    Once a sensor has been left out, and in epochs in which one is missing: without it, the others
    then give what all gave. With the regressors of the previous epoch, which changes nothing over
    a turn and back.
    """
    missing = parity.learning and parity.redundant and valid & parity.sensors != parity.sensors
    if not (parity.corrected or missing):
        return
    regressors = ABSOLUTE + fusion.count
    for k in range(fusion.count):
        if received >> k & 1 == 0:
            continue
        total = 0.0
        for j in range(regressors):
            coefficient = parity.correction[k, j]
            if missing:
                coefficient += parity.parity.coefficients[k, j]
            total += coefficient * parity.epoch_regressors[j]
        measured[k] -= total


@compiled
def _take(
    state: Ram,
    parity: Parity,
    fusion: Fusion,
    valid: int,
    controlled: int,
    measured: Floats,
) -> None:
    """Take an epoch of a kind; it counts if all compared sensors are valid.

    `controlled` are those that an operator excludes for a while, one bit each.
    """
    redundancy = state.redundancy
    own, other = state.dtheta_s, state.dv_s
    expected = redundancy.expected_dtheta_s
    if parity.kind == ACCELEROMETERS:
        own, other, expected = other, own, redundancy.expected_dv_s
    parity.epochs += 1
    everything = (1 << fusion.count) - 1 & ~(parity.excluded | controlled)
    if parity.sensors != everything:
        parities.compare(parity, fusion, everything, redundancy.second_epochs, state.ins.work)
    usable = valid == everything and fusion.solvable and fusion.used == everything
    for k in range(fusion.count):
        parity.unlearned[k] = 0.0
    if usable:
        regressors = parities.regress(parity, fusion, own, other, state.parameters.period_ns * 1e-9)
        ratio = parities.take(parity, fusion, measured, own, regressors)
        if redundancy.expected_known:
            standing.take(parity, own, expected)
        if ratio > 1.0:
            _raise(state, parity)
            parity.ratio = max(parity.ratio, ratio)


@compiled
def _raise(state: Ram, parity: Parity) -> None:
    if not parity.alarm:
        parity.alarm = True
        parity.alarm_epoch = state.epoch
    parity.clear_seconds = 0


@compiled
def _close_second(state: Ram, parity: Parity, fusion: Fusion) -> None:
    """Test the windows that end with this second; decide which sensor fails."""
    redundancy = state.redundancy
    enough = 2 * parity.used_epochs > redundancy.second_epochs
    if enough:
        count = int(fusion.count)
        regressors = ABSOLUTE + count
        parity.ratio = windows.close_second(parity, count, regressors)
        known = redundancy.expected_known and standing.slow(state)
        standing.close_second(parity, fusion, regressors, known)
        windows.keep(parity, count)
        if parity.ratio > 1.0:
            _raise(state, parity)
        elif parity.alarm:
            parity.clear_seconds += 1
            if parity.clear_seconds > _CLEAR_AFTER_S:
                parity.alarm = False
        _isolate(state, parity, fusion)
    parities.begin_second(parity)


@compiled
def _isolate(state: Ram, parity: Parity, fusion: Fusion) -> None:
    """Leave out the sensor that fails, once it is known."""
    sensor, how = isolation.standing(parity, fusion), _STANDING
    if sensor < 0 and parity.alarm:
        sensor, how = isolation.by_parity(parity, int(fusion.count)), _PARITY
    if sensor >= 0:
        _raise(state, parity)
        leave_out(state, parity, fusion, sensor, how)


@compiled
def _leave_out_known(state: Ram, parity: Parity, fusion: Fusion, stuck: int, absent: int) -> None:
    """Leave out sensors that repeat themselves, or have been flagged as absent for a second."""
    parity.absent_epochs = parity.absent_epochs + 1 if absent & parity.sensors else 0
    if parity.absent_epochs <= state.redundancy.second_epochs:
        absent = 0
    for sensor in range(fusion.count):
        if (stuck | absent) & parity.sensors & 1 << sensor == 0:
            continue
        how = _STUCK if stuck >> sensor & 1 else _ABSENT
        if _spans(state, fusion, parity.sensors & ~(1 << sensor)):
            _raise(state, parity)
            leave_out(state, parity, fusion, sensor, how)


@compiled
def _begun_s(parity: Parity) -> float:
    """Return for how many seconds the fault seems to last: where its sum is most significant."""
    suspect = max(0, int(parity.suspect))
    best, seconds = 0.0, 1.0
    for level in range(SECOND_LEVELS):
        if not windows.is_due(parity, level):
            continue
        begin = windows.begin_of(parity, level)
        total = parity.now.parity[suspect] - begin.parity[suspect]
        variance = windows.variance_of(parity, level, suspect)
        if total * total > best * variance:
            best, seconds = total * total / variance, float(1 << level)
    return seconds


@compiled
def leave_out(state: Ram, parity: Parity, fusion: Fusion, sensor: int, how: int) -> None:
    """Leave a sensor out from now on, and order the repair of the history.

    What was learned of the parity is taken off the other sensors from now on, so that without it
    they give what all gave.
    """
    redundancy = state.redundancy
    remaining = parity.sensors & ~(1 << sensor)
    if not _spans(state, fusion, remaining):
        return
    for k in range(fusion.count):
        for j in range(parity.correction.shape[1]):
            parity.correction[k, j] += parity.parity.coefficients[k, j]
    parity.corrected = True
    seconds = _begun_s(parity)
    parity.excluded |= 1 << sensor
    parity.isolated = sensor
    parity.isolated_epoch = state.epoch
    parity.how = how
    parity.found_epoch = parity.alarm_epoch
    parity.alarm = False
    if redundancy.navigated:
        repair.order(redundancy.repair, parity.kind, sensor, seconds)
        parity.repaired_epoch = state.epoch - int(seconds) * redundancy.second_epochs
    parities.compare(parity, fusion, remaining, redundancy.second_epochs, state.ins.work)


@compiled
def _spans(state: Ram, fusion: Fusion, sensors: int) -> bool:
    """Return whether the axes of some sensors span space."""
    least_squares.prepare(fusion, sensors, state.ins.work)
    return bool(fusion.solvable)


@compiled
def watch(state: Ram, navigating: bool) -> None:
    """Compare the sensors of this epoch; called between fusion and navigation."""
    redundancy, assembly = state.redundancy, state.assembly
    dt = state.parameters.period_ns * 1e-9
    gyros, accelerometers = redundancy.gyros, redundancy.accelerometers
    if navigating and not redundancy.navigated:
        repair.begin(redundancy.repair, state.gyros.count, state.accelerometers.count)
        redundancy.navigation_epoch = state.epoch - 1
    redundancy.navigated = navigating
    redundancy.expected_known = False
    if navigating:
        standing.expect(state)
    _take(
        state,
        gyros,
        state.gyros,
        assembly.gyro_valid,
        state.diagnostics.excluded_gyros,
        assembly.gyro_dtheta,
    )
    _take(
        state,
        accelerometers,
        state.accelerometers,
        assembly.accelerometer_valid,
        state.diagnostics.excluded_accelerometers,
        assembly.accelerometer_dv,
    )
    if navigating:
        history, C_s_n = redundancy.repair, state.ins.C_s_n
        behind = 3 * state.gyros.count
        repair.note(history, C_s_n, state.gyros, gyros, 0, redundancy.work[0])
        repair.note(
            history, C_s_n, state.accelerometers, accelerometers, behind, redundancy.work[0]
        )
        others = behind + 3 * state.accelerometers.count
        repair.note_motion(history, state.ins, state.dv_s, dt, others)
    _leave_out_known(
        state,
        gyros,
        state.gyros,
        state.diagnostics.gyro_repetition.stuck,
        assembly.gyro_absent,
    )
    _leave_out_known(
        state,
        accelerometers,
        state.accelerometers,
        state.diagnostics.accelerometer_repetition.stuck,
        assembly.accelerometer_absent,
    )
    if gyros.epochs >= redundancy.second_epochs:
        standing.note_velocity(state)
        _close_second(state, gyros, state.gyros)
        _close_second(state, accelerometers, state.accelerometers)
        if navigating:
            repair.close_block(redundancy.repair)
        gyros.epochs = 0
        accelerometers.epochs = 0
    if navigating and redundancy.repair.active:
        repair.advance(state)
