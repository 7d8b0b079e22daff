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
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    BANK_SENSORS,
    GYROS,
    WINDOWS_S,
    Bank,
    Hypothesis,
    Parity,
)
from rrins.firmware_py.core.redundancy import blocks, error_filter, hypotheses, pairs, windows
from rrins.firmware_py.core.redundancy.isolation import RATIO

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

_SLIPS_S = 30
"""Seconds for which no stretch is used once one agrees with no filter: the wheel slips, or is
locked, or points elsewhere, whichever sensor fails."""

_LEVELLED, _NEVER = math.radians(5.0), 2**31 - 1
"""Change of the level by the estimator in a second, rad, beyond which nothing is told: the filters'
errors were too large to be linear. Before the fault may have begun, the filters begin after it."""

_REST = 5.0
"""Largest deviation of the innovations' squares, standard deviations of chi-square."""

_OVER_PAIRS = 2.0 * math.log(1e2)
"""Twice the logarithm of the likelihood ratio to two others that are off: that is rarer, by as much
as is missing. Not once a sensor is left out: what seems another fault may be two.
Nor may two be likelier by more than one of them alone."""


@compiled_with(is_unit=True)
def follow(state: Ram) -> None:
    """Run the filters on by some steps while an alarm lasts that the parity cannot resolve."""
    bank, repair = state.redundancy.bank, state.redundancy.repair
    doubts = _doubt(state, state.redundancy.gyros)
    doubts |= _doubt(state, state.redundancy.accelerometers)
    bank.found = 0
    if doubts == 0:
        bank.first = min(bank.first, repair.count + 2)
    if doubts == 0 or bank.first >= repair.count:
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
        if begins and _is_levelled_anew(block[others : others + blocks.OTHERS]):
            bank.first = bank.at + 1 if bank.at < bank.fault_at else _NEVER
            bank.active = False
            return
        if begins and bank.at <= bank.fault_at:
            _forget_evidence(bank)
        if begins and bank.at >= bank.fault_at:
            accelerometers_at = 3 * int(state.gyros.count)
            pairs.size_fault(state.redundancy.gyros, bank, block, 0)
            pairs.size_fault(state.redundancy.accelerometers, bank, block, accelerometers_at)
        if begins and not is_due and _waits(state, block):
            return
        if not bank.measuring:
            error_filter.approach(state, bank.filters[bank.turn], block)
        else:
            error_filter.leave(state, bank.filters[bank.turn], block)
        bank.turn += 1
        if bank.turn < bank.count:
            continue
        bank.turn = 0
        bank.measuring = not bank.measuring and block[others + blocks.DISTANCE_VARIANCE] > 0.0
        if bank.measuring:
            _watch_wheel(bank)
            continue
        fixes = error_filter.components(state) * (block[others + blocks.VARIANCE] > 0.0)
        measured = fixes + 2 * bank.fits
        bank.at += 1
        bank.fits = False
        if measured > 0 and bank.at > bank.fault_at:
            bank.measurements += measured
            if bank.at + _WAIT_S < repair.count:
                continue  # more is known already
            gyros, accelerometers = state.redundancy.gyros, state.redundancy.accelerometers
            is_second = gyros.excluded | accelerometers.excluded != 0
            bank.found = _decide(bank, RATIO if is_second else _OVER_PAIRS)
            if bank.found > 0:
                return


@compiled
def _is_levelled_anew(block: Floats) -> bool:
    """Return whether the estimator turned the navigation's level further than filters follow."""
    fed_back = block[blocks.FED_BACK : blocks.FED_BACK + 2]
    return bool(fed_back[0] ** 2 + fed_back[1] ** 2 > _LEVELLED**2)


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
            error_filter.distrust_wheel(bank.filters[index])


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
    lasts_s = max(_fails_for_s(state, gyros, doubts), _fails_for_s(state, accelerometers, doubts))
    bank.fault_at = max(bank.at, repair.count - int(lasts_s))
    bank.fault_variance[:] = 0.0
    hypotheses.set_up(bank, gyros, accelerometers)
    begins = repair.blocks[blocks.place(repair, bank.at) + repair.stride - blocks.OTHERS :]
    for index in range(bank.count):
        error_filter.begin(bank.filters[index], gyros, accelerometers, begins)
    _forget_evidence(bank)


@compiled
def _fails_for_s(state: Ram, parity: Parity, doubts: int) -> float:
    """Return for how long one of a kind may have failed at most, s; 0 if none is in doubt."""
    if doubts >> parity.kind & 1 == 0:
        return 0.0
    since = state.epoch - state.redundancy.bank.doubt_since[parity.kind]
    level = windows.begun_level(parity, parity.second_factor**2)
    return float(since / state.redundancy.second_epochs + 1.5 * WINDOWS_S[level] + _EARLIER_S)


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
