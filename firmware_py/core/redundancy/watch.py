"""Compares the sensors in every epoch, leaves out the one that fails, and repairs the history.

Part of the compiled step, in constant time: sums and the tests of short windows in each epoch,
the rest once a second, kind after kind.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats
from rrins.firmware_py.core.navigation import alignment
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ABSOLUTE,
    ACCELEROMETERS,
    WINDOWS_S,
    Found,
    Parity,
    Redundancy,
)
from rrins.firmware_py.core.redundancy import (
    bank,
    blocks,
    drift,
    isolation,
    learning,
    readmission,
    recent,
    reference,
    repair,
    standing,
    suspicion,
    windows,
)
from rrins.firmware_py.core.redundancy import parity as parities

_STANDING, _PARITY = int(Found.STANDING), int(Found.PARITY)
_STUCK, _ABSENT = int(Found.STUCK), int(Found.ABSENT)
_REFERENCE = int(Found.REFERENCE)
_FULL_SCALE = int(Found.FULL_SCALE)
_CLEAR_AFTER_S = 10
_APART_S = 20
"""Seconds after which sensors that stand, and do not measure it, are an alarm: two that fail may
cancel each other in the parity, and a vehicle that moves so little for so long is rare."""
_AT_ONCE_S = 5
"""Seconds after the begin of an alarm in which a fault may show itself at once."""
_SIGNIFICANT = 4.0  # standard deviations
_LITTLE = 0.5  # of what a sensor at the end of its range says


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
    state: Ram, parity: Parity, fusion: Fusion, valid: int, measured: Floats, own: Floats
) -> None:
    """Take an epoch of a kind; it counts if all compared sensors are valid.

    Sums of a second have those epochs alone of which the expectation is known, too, unless it is
    not known for long.
    """
    redundancy = state.redundancy
    other, expected = state.dv_s, redundancy.expected_dtheta_s
    if parity.kind == ACCELEROMETERS:
        other, expected = state.dtheta_s, redundancy.expected_dv_s
    for k in range(fusion.count):
        parity.unlearned[k] = 0.0
    if valid != parity.sensors or not fusion.solvable or fusion.used != valid:
        parity.lost_epochs += 1
        return
    lost, parity.lost_epochs = parity.lost_epochs, 0
    if lost > 0:
        parities.allow_for_gap(parity, fusion, redundancy.second_epochs)
    unknown = redundancy.unknown_epochs
    counts = unknown == 0 or not redundancy.navigated or unknown > redundancy.second_epochs
    dt = state.parameters.period_ns * 1e-9
    regressors = parities.regress(parity, fusion, own, other, redundancy.outer_turn, dt)
    ratio = parities.take(parity, fusion, measured, own, regressors, counts)
    if redundancy.expected_known:
        standing.take(parity, own, expected, redundancy.outer_turn)
        parity.known_epochs += 1
    if 0 < lost < redundancy.second_epochs:  # a fault has worked in these, too
        for k in range(fusion.count):
            parity.unlearned[k] *= 1.0 + lost
    if ratio > 1.0:
        _raise(state, parity, True)
        parity.ratio = max(parity.ratio, ratio)
        parity.peak = max(parity.peak, ratio)
    if readmission.is_there(state, parity):
        readmission.take(state, parity, fusion, measured, own, other)


@compiled
def _raise(state: Ram, parity: Parity, shown: bool) -> None:
    """Begin an alarm, or go on with it; `shown` if the parity is beyond its threshold."""
    if not parity.alarm:
        parity.alarm = True
        parity.alarm_shown = False
        parity.alarm_epoch = state.epoch
        recent.remember(parity, state.epoch)
    parity.alarm_shown |= shown
    parity.clear_seconds = 0


@compiled_with(is_unit=True)
def close_second(state: Ram, parity: Parity, fusion: Fusion) -> tuple[int, int]:
    """Test the windows that end with this second; return which sensors fail, and how it shows.

    One bit each.
    """
    redundancy = state.redundancy
    sensors, how = 0, _STANDING
    slow = redundancy.aligning or standing.slow(state)
    redundancy.was_fast |= not slow
    count = int(fusion.count)
    regressors = ABSOLUTE + count
    if parities.is_full(parity, redundancy.second_epochs):
        suspects = suspicion.lasts(state, int(parity.kind))
        parity.ratio = windows.close_second(parity, count, regressors, suspects)
        known = 2 * parity.known_epochs > parity.used_epochs and not standing.is_driven(state)
        even = bool(redundancy.turns_evenly)
        if standing.close_second(parity, fusion, regressors, known, slow and not suspects, even):
            redundancy.moved = True
            if parity.kind == ACCELEROMETERS:  # its attitude errs otherwise now
                standing.forget(parity)
        windows.keep(parity, count)
        _close_alarm(state, parity)
        recent.note(parity, count, state.epoch, state.parameters.period_ns * 1e-9)
        alarm_s = (state.epoch - parity.alarm_epoch) / redundancy.second_epochs
        at_once = not parity.alarm or alarm_s <= _AT_ONCE_S
        sensors = isolation.standing(parity, fusion, redundancy.moved, slow, at_once)
        if parity.apart > _APART_S and _vouches(redundancy, parity):
            _raise(state, parity, False)
        if sensors == 0 and parity.alarm:
            sensors, how = isolation.by_parity(parity, count), _PARITY
        parities.begin_second(parity)
    if readmission.tests(state, parity):
        readmission.close_second(state, parity, fusion)
    return sensors, how


@compiled
def _vouches(redundancy: Redundancy, parity: Parity) -> bool:
    """Return whether gyros that do not measure a standstill must fail: it has always stood.

    What is expected of accelerometers depends on what the gyros' errors have tilted.
    """
    still = parity.redundant and not redundancy.moved and not redundancy.was_fast
    return bool(still and parity.kind != ACCELEROMETERS)


@compiled
def _close_alarm(state: Ram, parity: Parity) -> None:
    """Begin an alarm where the last second says so, or end it some time after."""
    if parity.ratio > 1.0:
        _raise(state, parity, True)
    elif parity.alarm:
        parity.clear_seconds += 1
        if parity.clear_seconds > _CLEAR_AFTER_S:
            parity.alarm = False


@compiled
def _at_full_scale(parity: Parity, fusion: Fusion, saturated: int, measured: Floats) -> int:
    """Return the saturated sensors of which the others say that they measure much less."""
    own = saturated & parity.sensors
    if own == 0 or not fusion.solvable:
        return 0
    wrong = 0
    for sensor in range(fusion.count):
        if own >> sensor & 1:
            along = 0.0
            for used in range(fusion.count):
                share = 0.0
                for axis in range(3):
                    share += fusion.H[sensor, axis] * fusion.gain[axis, used]
                along += share * measured[used]
            if abs(along) < _LITTLE * abs(measured[sensor]):
                wrong |= 1 << sensor
    return wrong


@compiled
def _known(
    state: Ram, parity: Parity, fusion: Fusion, stuck: int, absent: int, full_scale: int
) -> tuple[int, int]:
    """Return a sensor that repeats itself, has been useless for a second, or fails by reference.

    -1 where there is none. Useless is what is flagged as absent, or at full scale where it should
    measure little. Three sensors cannot say which one fails: only who can be spared.
    """
    useless = absent | full_scale
    parity.useless_epochs = parity.useless_epochs + 1 if useless & parity.sensors else 0
    if parity.useless_epochs <= state.redundancy.second_epochs:
        useless = 0
    known = (stuck | useless) & parity.sensors
    for sensor in range(parity.residual.shape[0]):
        if known >> sensor & 1 == 0:
            continue
        if parities.spares(parity, fusion, sensor):
            if stuck >> sensor & 1:
                return sensor, _STUCK
            return sensor, _ABSENT if absent >> sensor & 1 else _FULL_SCALE
        suspicion.keep(state, parity, sensor)
    is_shown = parity.alarm and parity.alarm_shown  # as the fault of a single sensor is
    sensor = bank.found(state.redundancy.bank, parity.kind) if is_shown else -1
    return sensor if sensor >= 0 and parities.spares(parity, fusion, sensor) else -1, _REFERENCE


@compiled
def _share(parity: Parity, sensors: int, sensor: int) -> float:
    """Return by how much leaving out a sensor among some changes more than leaving it out alone.

    From the sums of the window in which the fault is most significant; of two sensors at most.
    """
    sums, own = (
        parity.window_sum[windows.begun_level(parity, 0.0)],
        parity.projector[sensor, sensor],
    )
    for other in range(parity.residual.shape[0]):
        if other != sensor and sensors >> other & 1 and sums[sensor] != 0.0:
            shared = parity.projector[sensor, other]
            others = parity.projector[other, other]
            least = own * others - shared * shared
            return float(own * (others - shared * sums[other] / sums[sensor]) / least)
    return 1.0


@compiled
def _begun_s(parity: Parity, sensor: int, how: int) -> float:
    """Return for how many seconds the fault seems to last: where its sum is most significant.

    Of a sensor that shows itself, only where it is significant at all.
    """
    suspect, least = max(0, int(parity.suspect)), 0.0
    if how in (_STUCK, _ABSENT, _FULL_SCALE):
        suspect, least = sensor, _SIGNIFICANT * _SIGNIFICANT
    level = windows.significant_level(parity, suspect, least)
    return float(WINDOWS_S[level]) * max(1, parity.closed_s)


@compiled
def _leave_out(state: Ram, parity: Parity, fusion: Fusion, sensors: int, how: int) -> None:
    """Leave sensors out from now on if they can be spared, and order the repair of the history.

    One bit each, two at most. What was learned of the parity is taken off the other sensors from
    now on, so that without these they give what all gave: what is usual of sound sensors, for
    nothing is learned of it any more. Not what little was learned since power-on: it may be of the
    fault.
    """
    redundancy = state.redundancy
    count = parity.residual.shape[0]
    for sensor in range(count):
        if sensors >> sensor & 1 and not parities.spares(parity, fusion, sensor):
            return
    learning.copy(parity.kept, parity.parity)
    if parity.learning:
        learning.confine(parity.parity, ABSOLUTE + int(fusion.count))
        for k in range(fusion.count):
            for j in range(parity.correction.shape[1]):
                taken_off = parity.parity.coefficients[k, j]
                parity.correction[k, j] += taken_off
                parity.kept.coefficients[k, j] -= taken_off
        parity.corrected = True
    first = 0
    while sensors >> first & 1 == 0:
        first += 1
    seconds = _begun_s(parity, first, how)
    if how == _REFERENCE:
        parity.alarm_epoch = redundancy.bank.doubt_since[parity.kind]
    seconds = max(seconds, (state.epoch - parity.alarm_epoch) / redundancy.second_epochs)
    parity.excluded |= sensors
    parity.isolated_epoch = state.epoch
    parity.how = how
    parity.found_epoch = parity.alarm_epoch
    parity.alarm = False
    repairs = False
    if redundancy.navigated and redundancy.aligning:
        state.estimator.begins_anew = True
        state.modes.epochs = 0
        suspicion.begin(state)
    elif redundancy.navigated:
        is_one = sensors & (sensors - 1) == 0
        undone = suspicion.was_aided(state, parity.kind, seconds)
        if is_one:
            undone = suspicion.settle(state, parity, first, seconds)
        if not undone:
            repairs = True
            parity.repaired_epoch = state.epoch - int(seconds) * redundancy.second_epochs
    elif redundancy.aligning:
        if not state.alignment.done:
            alignment.begin(state.alignment)
        redundancy.aligned_epochs = 0
        standing.forget(redundancy.gyros)
        standing.forget(redundancy.accelerometers)
    for sensor in range(count):
        if sensors >> sensor & 1:
            parity.isolated = sensor
            if repairs:
                share = _share(parity, sensors, sensor)
                repair.order(redundancy.repair, parity.kind, sensor, seconds, share)


@compiled
def _judge(
    state: Ram,
    parity: Parity,
    fusion: Fusion,
    controlled: int,
    stuck: int,
    absent: int,
    saturated: int,
    measured: Floats,
) -> None:
    """Leave out the sensors that fail, once they are known; compare those that are left.

    `controlled` are those that an operator excludes for a while, one bit each.
    """
    redundancy = state.redundancy
    full_scale = _at_full_scale(parity, fusion, saturated, measured)
    sensor, how = _known(state, parity, fusion, stuck, absent, full_scale)
    sensors = 1 << sensor if sensor >= 0 else 0
    if redundancy.epochs == 0:
        found, shown = close_second(state, parity, fusion)
        if sensors == 0:
            sensors, how = found, shown
    if sensors != 0:
        _raise(state, parity, False)
        _leave_out(state, parity, fusion, sensors, how)
    everything = (1 << fusion.count) - 1 & ~(parity.excluded | controlled)
    if parity.sensors != everything:
        parities.compare(parity, fusion, everything, redundancy.second_epochs, state.ins.work)
        if parity.excluded and parity.isolated_epoch == state.epoch:
            parities.inherit(parity, int(fusion.count))
        else:
            readmission.hand_over(state, parity)
    if readmission.tests(state, parity):
        readmission.compare(state, parity, fusion, everything)


@compiled_with(is_unit=True)
def watch(state: Ram, navigating: bool, aligning: bool) -> None:
    """Compare the sensors of this epoch; called between fusion and navigation.

    An alignment begins anew without a sensor that fails in it. Both flags are set in the fine
    alignment.
    """
    redundancy, assembly, diagnostics = state.redundancy, state.assembly, state.diagnostics
    history = redundancy.repair
    if navigating and not redundancy.navigated:
        redundancy.navigation_epoch = state.epoch - 1 - state.modes.epochs
        blocks.begin(history, state.gyros.count, state.accelerometers.count, state.epoch - 1)
        reference.begin(state)
        suspicion.begin(state)
        # Seconds end with those of SYNC, at which most receivers measure.
        redundancy.epochs = (state.epoch - 1) % redundancy.second_epochs
        parities.begin_second(redundancy.gyros)
        parities.begin_second(redundancy.accelerometers)
    elif navigating and redundancy.aligning and not aligning:
        redundancy.navigation_epoch = state.epoch - 1 - state.modes.epochs
    if navigating != redundancy.navigated or aligning != redundancy.aligning:
        redundancy.aligned_epochs = 0
        redundancy.moved = False
        redundancy.was_fast = False
        standing.forget(redundancy.gyros)
        standing.forget(redundancy.accelerometers)
        if navigating and redundancy.navigated and state.estimator.running:
            standing.expect_aligned(state)
    redundancy.navigated = navigating
    redundancy.aligning = aligning
    redundancy.expected_known = False
    if redundancy.readmission.order != 0:
        readmission.follow(state)
    if navigating:
        standing.expect(state)
    elif aligning:
        standing.expect_constant(state)
    redundancy.unknown_epochs = 0 if redundancy.expected_known else redundancy.unknown_epochs + 1
    parity, fusion, own = redundancy.gyros, state.gyros, state.dtheta_s
    valid, measured = assembly.gyro_valid, assembly.gyro_dtheta
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, fusion, own = redundancy.accelerometers, state.accelerometers, state.dv_s
            valid, measured = assembly.accelerometer_valid, assembly.accelerometer_dv
        _take(state, parity, fusion, valid, measured, own)
        if navigating:
            first = 3 * int(state.gyros.count) * kind
            blocks.note(history, state.ins.C_s_n, fusion, parity, first, redundancy.work[0])
    redundancy.epochs += 1
    if redundancy.epochs == redundancy.second_epochs:
        redundancy.epochs = 0
        standing.note_rates(state)
        standing.note_velocity(state)
    if navigating:
        dt = state.parameters.period_ns * 1e-9
        if state.estimator.enabled:
            blocks.note_feedback(history, state.estimator.fed_back)
        blocks.note_motion(history, state.ins, state.dtheta_s, state.dv_s, dt)
        reference.follow(state)
        if redundancy.epochs == 0:
            blocks.close(history, state.epoch)
            if state.estimator.enabled:
                blocks.note_unsure(state)
    parity, fusion, controlled = redundancy.gyros, state.gyros, diagnostics.excluded_gyros
    stuck, absent = diagnostics.gyro_repetition.stuck, assembly.gyro_absent
    unusable, measured = assembly.received & ~assembly.gyro_usable, assembly.gyro_dtheta
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, fusion = redundancy.accelerometers, state.accelerometers
            controlled = diagnostics.excluded_accelerometers
            stuck = diagnostics.accelerometer_repetition.stuck
            absent = assembly.accelerometer_absent
            unusable = assembly.received & ~assembly.accelerometer_usable
            measured = assembly.accelerometer_dv
        saturated = unusable & ~absent
        _judge(state, parity, fusion, controlled, stuck, absent, saturated, measured)
        if redundancy.epochs == 0:
            compared = state.calibration.gyros
            if kind == ACCELEROMETERS:
                compared = state.calibration.accelerometers
            drift.compare(compared, parity, fusion, state.epoch)
    if navigating:
        if redundancy.epochs == 0:
            blocks.note_uncertain(history, redundancy.gyros, redundancy.accelerometers)
        if history.active:
            repair.advance(state)
        suspicion.follow(state)
        bank.follow(state)
