"""Which sensor fails, in motion: the one without which the navigation agrees with a reference.

Four sensors of a kind have one parity, which cannot tell. While its alarm lasts, filters of the
navigation's error run over the stored seconds, from before the alarm: each leaves one sensor out,
one leaves none out, one takes off by what all may be off alike. Others leave out one of two that
fail, and have the effect of the second as a state. While both kinds have an alarm, each leaves out
one of either: two faults at once may look most like that of a third sensor. References are a
velocity and a stretch of the odometer, each once a second. The likelihood of a hypothesis is that
of its filter's innovations since the fault may have begun (Magill, *IEEE Transactions on Automatic
Control* 10, 1965; Groves, 2nd ed., 2013, section 17.4). A few of these steps run in an epoch.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.estimator import covariance, transition
from rrins.firmware_py.core.estimator.transition import (
    ATTITUDE,
    CHANGE,
    FILTER_SIZE,
    TURN,
    VELOCITY,
)
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    BANK_SENSORS,
    BANK_STATES,
    GYROS,
    WINDOWS_S,
    Bank,
    Hypothesis,
    Parity,
)
from rrins.firmware_py.core.redundancy import alike, blocks, hypotheses, pairs, windows
from rrins.firmware_py.core.redundancy.isolation import RATIO
from rrins.firmware_py.core.sensors.data_sheet import SCALE_TURN

STEPS_PER_EPOCH = 8
"""Filters that take a block in one epoch, at most: as many as a hundred seconds in a second."""

_BEFORE_S = 300
"""Seconds before the alarm from which on the filters run: they learn attitude and biases there."""

_DOUBT_S = 200
"""Seconds after an alarm in which one of the sensors is still taken to fail: a small fault raises
it now and then."""

_EARLIER_S = 4
"""Seconds by which a fault may have begun before the window that shows it best."""

_WAIT_S = 3
"""Seconds that a block waits for its reference: the latency of a receiver, and a block."""

SCALE, YAW = FILTER_SIZE, FILTER_SIZE + 1
"""States of the odometer."""

_OUTLIER = 16.0
"""Square of a normalised innovation beyond which a stretch does not agree with a filter: it counts
that much against it, and no more."""

_SLIPS_S = 30
"""Seconds for which no stretch is used once one agrees with no filter: the wheel slips, or is
locked, or points elsewhere, whichever sensor fails."""

_REST = 5.0
"""Largest deviation of the innovations' squares, standard deviations of chi-square."""

_OVER_PAIRS = 2.0 * math.log(1e2)
"""Twice the logarithm of the likelihood ratio to two others that are off: that is rarer, by as much
as is missing. Not once a sensor is left out: what seems another fault may be two.
Nor may two be likelier by more than one of them alone."""

_LEVEL, _HEADING, _VELOCITY = 1e-3, 1e-2, 30.0
"""Uncertainty of the navigation at the beginning: rad, rad, m/s."""


@compiled_with(is_unit=True)
def follow(state: Ram) -> None:
    """Run the filters on by some steps while an alarm lasts that the parity cannot resolve."""
    bank, repair = state.redundancy.bank, state.redundancy.repair
    doubts = _doubt(state, state.redundancy.gyros)
    doubts |= _doubt(state, state.redundancy.accelerometers)
    bank.found = 0
    if doubts == 0:
        bank.active = False
        return
    if not bank.active or doubts & ~bank.doubts:
        _begin(state, doubts)
    for _ in range(STEPS_PER_EPOCH):
        if bank.at >= repair.count:
            return
        at = blocks.place(repair, bank.at)
        block = repair.blocks[at : at + repair.stride]
        others = repair.stride - blocks.OTHERS
        is_due = bank.at + _WAIT_S < repair.count
        begins = bank.turn == 0 and not bank.measuring
        if begins and bank.at <= bank.fault_at:
            _forget_evidence(bank)
        if begins and bank.at >= bank.fault_at:
            accelerometers_at = 3 * int(state.gyros.count)
            pairs.size_fault(state.redundancy.gyros, bank, block, 0)
            pairs.size_fault(state.redundancy.accelerometers, bank, block, accelerometers_at)
        if begins and not is_due and _waits(state, block):
            return
        if not bank.measuring:
            _approach(state, bank.filters[bank.turn], block)
        else:
            _pass(state, bank.filters[bank.turn], block)
        bank.turn += 1
        if bank.turn < bank.count:
            continue
        bank.turn = 0
        bank.measuring = not bank.measuring and block[others + blocks.DISTANCE_VARIANCE] > 0.0
        if bank.measuring:
            _watch_wheel(bank)
            continue
        measured = _components(state) * (block[others + blocks.VARIANCE] > 0.0) + 2 * bank.fits
        bank.at += 1
        bank.fits = False
        if measured > 0 and bank.at > bank.fault_at:
            bank.measurements += measured
            gyros, accelerometers = state.redundancy.gyros, state.redundancy.accelerometers
            is_second = gyros.excluded | accelerometers.excluded != 0
            bank.found = _decide(bank, RATIO if is_second else _OVER_PAIRS)
            if bank.found > 0:
                return


@compiled
def _forget_evidence(bank: Bank) -> None:
    """Weigh the hypotheses anew: before the fault may have begun, all sensors are sound."""
    bank.measurements = 0
    for index in range(bank.count):
        bank.filters[index].squares = 0.0
        bank.filters[index].score = 0.0


@compiled
def _watch_wheel(bank: Bank) -> None:
    """Distrust the odometer for a while if what it says of this block agrees with no filter."""
    if not bank.fits and bank.at >= bank.slips_until:
        bank.slips_until = bank.at + _SLIPS_S
        for index in range(bank.count):
            bank.filters[index].P[SCALE, SCALE] += wheel.SCALE_SIGMA**2
            bank.filters[index].P[YAW, YAW] += wheel.MOUNTING_SIGMA**2


@compiled
def _waits(state: Ram, block: Floats) -> bool:
    """Return whether a reference of this block may still come."""
    others = state.redundancy.repair.stride - blocks.OTHERS
    fix, stretch = block[others + blocks.VARIANCE], block[others + blocks.DISTANCE_VARIANCE]
    has_odometer = state.odometer.interval_epochs > 0
    if state.gnss.interval_epochs > 0 or not has_odometer:
        return bool(fix == 0.0 or (has_odometer and stretch == 0.0))
    return bool(stretch == 0.0)


@compiled
def found(bank: Bank, kind: int) -> int:
    """Return the sensor of a kind that fails, -1 if none is known."""
    one = bank.filters[bank.found]
    known = bank.active and bank.found > 0 and bank.found_kind == kind
    return int(one.sensor[kind]) if known else -1


@compiled
def _doubt(state: Ram, parity: Parity) -> int:
    """Return a bit for the kind if one of its sensors fails, and the parity has one direction.

    Forgets the reference of the past where other sensors are used: the navigation has changed then,
    for the history is repaired within the next block.
    """
    bank, kind = state.redundancy.bank, int(parity.kind)
    if bank.sensors[kind] != parity.sensors:
        bank.sensors[kind] = parity.sensors
        bank.first = state.redundancy.repair.count + 2
        bank.active = False
        bank.doubt_until[kind] = 0
    if parity.alarm:
        if state.epoch >= bank.doubt_until[kind]:
            bank.doubt_since[kind] = parity.alarm_epoch
        bank.doubt_until[kind] = state.epoch + _DOUBT_S * state.redundancy.second_epochs
    compared = 0
    for k in range(parity.residual.shape[0]):
        compared += parity.sensors >> k & 1
    doubt = parity.redundant and compared == BANK_SENSORS
    return 1 << kind if doubt and state.epoch < bank.doubt_until[kind] else 0


@compiled
def _begin(state: Ram, doubts: int) -> None:
    """Set up the filters, some time before now."""
    bank, repair = state.redundancy.bank, state.redundancy.repair
    bank.active = True
    bank.doubts = doubts
    bank.at = max(bank.first, repair.count - _BEFORE_S, repair.count - repair.capacity + 2)
    bank.turn = 0
    bank.measuring = False
    bank.fits = False
    bank.slips_until = 0
    gyros, accelerometers = state.redundancy.gyros, state.redundancy.accelerometers
    parity = accelerometers if doubts >> ACCELEROMETERS & 1 else gyros
    since_s = (state.epoch - bank.doubt_since[parity.kind]) / state.redundancy.second_epochs
    level = windows.begun_level(parity, parity.second_factor**2)
    lasts_s = since_s + 1.5 * WINDOWS_S[level] + _EARLIER_S
    bank.fault_at = max(bank.at, repair.count - int(lasts_s))
    bank.fault_variance[:] = 0.0
    hypotheses.set_up(bank, gyros, accelerometers)
    for index in range(bank.count):
        one = bank.filters[index]
        one.x[:] = 0.0
        one.P[:] = 0.0
        one.P[SCALE, SCALE] = wheel.SCALE_SIGMA**2
        one.P[YAW, YAW] = wheel.MOUNTING_SIGMA**2
        for i in range(3):
            one.P[ATTITUDE + i, ATTITUDE + i] = _LEVEL**2
            one.P[VELOCITY + i, VELOCITY + i] = _VELOCITY**2
            one.P[TURN + i, TURN + i] = gyros.bias_variance
            one.P[CHANGE + i, CHANGE + i] = accelerometers.bias_variance
        one.P[ATTITUDE + 2, ATTITUDE + 2] = _HEADING**2
    _forget_evidence(bank)


@compiled
def _share(block: Floats, others: int, after: int, variance: int) -> float:
    """Return the share of a block up to the time of a reference in it; 1 where there is none."""
    if block[others + variance] == 0.0:
        return 1.0
    return float(min(1.0, block[others + after] / block[others + blocks.TIME]))


@compiled
def _approach(state: Ram, one: Hypothesis, block: Floats) -> None:
    """Take a block up to its stretch, or all of it if there is none, and compare that."""
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    pairs.widen(state, one)
    for i in range(FILTER_SIZE):  # in the order of the states
        one.x[i] -= block[others + blocks.FED_BACK + i]
    fix_at = _share(block, others, blocks.MEASURED_AFTER, blocks.VARIANCE)
    stretch_at = _share(block, others, blocks.STRETCH_AFTER, blocks.DISTANCE_VARIANCE)
    one.reached = 0.0
    if fix_at <= stretch_at and block[others + blocks.VARIANCE] > 0.0:
        _reach(state, one, block, fix_at)
        _measure_velocity(state, one, block)
    _reach(state, one, block, stretch_at)
    if block[others + blocks.DISTANCE_VARIANCE] > 0.0 and bank.at >= bank.slips_until:
        bank.fits |= _measure_stretch(state, one, block, False)


@compiled
def _pass(state: Ram, one: Hypothesis, block: Floats) -> None:
    """Measure the stretch of a block if it is used, and take the rest of the block."""
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    if bank.fits:
        _measure_stretch(state, one, block, True)
    fix_at = _share(block, others, blocks.MEASURED_AFTER, blocks.VARIANCE)
    if fix_at > one.reached and block[others + blocks.VARIANCE] > 0.0:
        _reach(state, one, block, fix_at)
        _measure_velocity(state, one, block)
    _reach(state, one, block, 1.0)


@compiled
def _reach(state: Ram, one: Hypothesis, block: Floats, share: float) -> None:
    """Propagate a filter to a share of the block."""
    if share > one.reached:
        _propagate(state, one, block, share - one.reached)
        one.reached = share


@compiled
def _is_free(state: Ram) -> bool:
    """Return whether errors of the vertical velocity last."""
    return bool(state.parameters.height_channel == strapdown.HEIGHT_FREE)


@compiled
def _components(state: Ram) -> int:
    """Return how many components of a velocity tell something."""
    return 3 if _is_free(state) else 2


@compiled
def _measure_velocity(state: Ram, one: Hypothesis, block: Floats) -> None:
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    for i in range(_components(state)):
        innovation, expected = covariance.measure(
            one.x,
            one.P,
            VELOCITY + i,
            block[others + blocks.MEASURED + i],
            block[others + blocks.VARIANCE],
            bank.gain,
            bank.work,
        )
        square = innovation * innovation / expected
        one.squares += square
        one.score += square + math.log(expected)


@compiled
def _measure_stretch(state: Ram, one: Hypothesis, block: Floats, uses: bool) -> bool:
    """Compare the way along and across the vehicle's forward axis with the odometer's.

    Returns whether both agree. With `uses` the filter takes them as measurements.
    """
    bank, others = state.redundancy.bank, state.redundancy.repair.stride - blocks.OTHERS
    seconds, row, fits = block[others + blocks.STRETCH_S], bank.row, True
    for i in range(3):
        bank.way_b[i] = block[others + blocks.STRETCH_WAY + i]
        for k in range(3):
            integral = block[others + blocks.STRETCH_ATTITUDE + 3 * i + k]
            bank.attitude_b[i, k] = integral / seconds
    for axis in (wheel.FORWARD_AXIS, wheel.RIGHT_AXIS):
        row[:] = 0.0
        wheel.fill_row(row, ATTITUDE, VELOCITY, bank.attitude_b, bank.way_b, seconds, axis)
        innovation = -bank.way_b[axis]
        variance = block[others + blocks.SLIP_VARIANCE]
        if axis == wheel.FORWARD_AXIS:
            row[SCALE] = -block[others + blocks.TRAVELLED]
            innovation += block[others + blocks.TRAVELLED]
            variance = block[others + blocks.DISTANCE_VARIANCE]
        else:
            row[YAW] = -bank.way_b[wheel.FORWARD_AXIS]
        for i in range(BANK_STATES):
            innovation -= row[i] * one.x[i]
        expected = covariance.expect(one.P, BANK_STATES, row, variance, bank.gain)
        square = innovation * innovation / expected
        fits = fits and square < _OUTLIER
        if uses:
            covariance.update(one.x, one.P, BANK_STATES, bank.gain, innovation, expected)
            one.squares += min(_OUTLIER, square)
            one.score += min(_OUTLIER, square) + math.log(expected)
    return fits


@compiled
def _propagate(state: Ram, one: Hypothesis, block: Floats, share: float) -> None:
    """Propagate a filter over a share of a block."""
    bank, ins = state.redundancy.bank, state.ins
    others = state.redundancy.repair.stride - blocks.OTHERS
    force, way, noise = bank.inputs[0], bank.inputs[1], bank.inputs[4]
    turn, change = bank.inputs[2], bank.inputs[3]
    dt = block[others + blocks.TIME] * share
    for i in range(3):
        force[i] = block[others + blocks.FORCE + i] * share
        way[i] = block[others + blocks.WAY + i] * share
        turn[i] = _changed(bank, one, GYROS, block, i) * share
        change[i] = (
            _changed(bank, one, ACCELEROMETERS, block, 3 * int(state.gyros.count) + i) * share
        )
        for k in range(3):
            bank.attitude_s[i, k] = block[others + blocks.ATTITUDE + 3 * i + k] * share
    transition.fill(bank.response, force, way, dt, ins.latitude, ins.height, _is_free(state))
    transition.of_biases(bank.transition, bank.response, bank.attitude_s)
    for i in range(FILTER_SIZE):
        total = 0.0
        for k in range(FILTER_SIZE):
            total += bank.transition[i, k] * one.x[k]
        if i < TURN:
            for k in range(3):
                total += bank.response[i, TURN + k] * turn[k]
                total += bank.response[i, CHANGE + k] * change[k]
        bank.gain[i] = total
    copy(one.x[:FILTER_SIZE], bank.gain)
    covariance.propagate(one.P, BANK_STATES, FILTER_SIZE, bank.transition, bank.work)
    _add_noise(state, one, block[others + blocks.TURNED], share)
    one.P[SCALE, SCALE] += wheel.SCALE_WALK**2 * dt
    parity, into = state.redundancy.gyros, ATTITUDE
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, into = state.redundancy.accelerometers, VELOCITY
        shown = int(one.sensor[kind])
        if kind == ACCELEROMETERS and one.noisy >= 0:
            shown = int(one.noisy)
        if shown == -1:
            continue
        direction_s = bank.direction_s
        sensor = alike.direct(parity, shown, bank.alike[kind], direction_s)
        for i in range(3):  # of the residual that takes the sensor's place
            noise[i] = 0.0
            for k in range(3):
                noise[i] += bank.attitude_s[i, k] * direction_s[k] / dt
        uncertain = block[others + blocks.UNCERTAIN + kind]
        learned = parity.learning_variance[sensor] * uncertain
        covariance.add_along(one.P, into, noise, (parity.second_variance[sensor] + learned) * share)


@compiled
def _changed(bank: Bank, one: Hypothesis, kind: int, block: Floats, first: int) -> float:
    """Return a component of the change of the vector that a hypothesis makes in a block."""
    total = 0.0
    for k in range(SENSOR_GROUPS):
        if bank.sensors[kind] >> k & 1:
            weight = alike.weight_of(int(one.sensor[kind]), bank.alike[kind], k)
            total += weight * block[first + 3 * k]
    return total


@compiled
def _add_noise(state: Ram, one: Hypothesis, turned: float, share: float) -> None:
    """Add the noise of the fused vectors, and that the biases change."""
    gyros, accelerometers = state.redundancy.gyros, state.redundancy.accelerometers
    attitude = (gyros.vector_variance + gyros.slope_variance * SCALE_TURN * turned) * share
    velocity = accelerometers.vector_variance * share
    for i in range(3):
        one.P[ATTITUDE + i, ATTITUDE + i] += attitude
        one.P[VELOCITY + i, VELOCITY + i] += velocity
        one.P[TURN + i, TURN + i] += gyros.parity.walk[0] * share
        one.P[CHANGE + i, CHANGE + i] += accelerometers.parity.walk[0] * share


@compiled
def _is_single(one: Hypothesis) -> bool:
    """Return whether it leaves out a sensor, or one of each kind, and no other fails."""
    gyro, accelerometer = one.sensor[GYROS], one.sensor[ACCELEROMETERS]
    is_pair = one.second[GYROS] >= 0 or one.second[ACCELEROMETERS] >= 0
    return bool(max(gyro, accelerometer) >= 0 and not is_pair)


@compiled
def _decide(bank: Bank, over_pairs: float) -> int:
    """Return the filter of the sensor that explains the reference far better than all without it.

    `found_kind` is then the kind of that sensor. 0 where that is not clear: where one by which it
    is sound explains it nearly as well, that of none included, or two sensors far better, or where
    nothing does. Than two sensors it has to explain more by `over_pairs`.
    """
    best, least, misfit = 0, math.inf, 1.0
    for k in range(bank.count):
        one = bank.filters[k]
        single = _is_single(one)
        least = min(least, one.score - pairs.fitted(one))
        if single and (best == 0 or one.score < bank.filters[best].score):
            best = k
    one = bank.filters[best]
    excess = one.squares - bank.measurements
    if one.score - least > _OVER_PAIRS or excess > _REST * math.sqrt(2.0 * bank.measurements):
        return 0
    if bank.measurements > 0:
        misfit = max(1.0, one.squares / bank.measurements)  # by how much all variances are short
    for kind in range(2):
        clear = bank.doubts >> kind & 1 != 0
        for k in range(bank.count):
            other = bank.filters[k]
            fails = one.sensor[kind] == other.sensor[kind] or one.sensor[kind] == other.second[kind]
            wanted = over_pairs if other.second[kind] >= 0 else RATIO
            less = other.score - pairs.fitted(other) - one.score
            clear = clear and (fails or less > wanted * misfit)
        if clear:
            bank.found_kind = kind
            return best
    return 0
