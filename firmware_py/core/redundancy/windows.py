"""Tests of the parity over windows from 1 to 1024 s, and of its variance over 32 s.

The sum of what is not learned over a window of sound sensors has zero mean and a variance that
follows from the data sheet: white noise, counts, drift, and the uncertainty of what was learned.
Windows of up to 128 s end and begin at any second, longer ones begin every 16 s.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.redundancy_records import (
    COARSE_CAPACITY,
    COARSE_S,
    FINE_CAPACITY,
    FINE_LEVELS,
    LATE_S,
    NOISE_S,
    SECOND_LEVELS,
    WINDOWS_S,
    Parity,
    Sums,
)
from rrins.firmware_py.core.redundancy import learning
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM, LEARNED_S, clear_levels

_MUCH_LEARNED = 0.1
"""Variance of what a second taught, in variances of its noise, from which on open windows that are
shorter begin again: their sums are of what was not learned before."""

_MOST_FITTED = 0.75
"""Share of a step's information that may go to what is learned at once."""

_LEARNS_BELOW = 0.6
"""Share of the threshold above which nothing is learned: a test is pending."""


@compiled
def _keep(sums: Sums, now: Sums, count: int) -> None:
    for i in range(count):
        sums.parity[i] = now.parity[i]
        sums.residual[i] = now.residual[i]
    for k in range(now.regressors.shape[0]):
        sums.regressors[k] = now.regressors[k]
    for i in range(3):
        sums.vector[i] = now.vector[i]
    sums.leverage = now.leverage
    sums.stretch = now.stretch
    sums.vector_leverage = now.vector_leverage
    sums.turned = now.turned
    sums.square_variance = now.square_variance
    sums.standing = now.standing


@compiled
def keep(parity: Parity, count: int) -> None:
    """Keep the sums as the begin of later windows."""
    _keep(parity.fine[parity.seconds % FINE_CAPACITY], parity.now, count)


@compiled
def begin_of(parity: Parity, level: int) -> Sums:
    """Return the sums where the window of a level that ends now begins."""
    begin = parity.seconds - WINDOWS_S[level]
    if level < FINE_LEVELS:
        return parity.fine[begin % FINE_CAPACITY]
    return parity.coarse[begin // COARSE_S % COARSE_CAPACITY]


@compiled
def is_due(parity: Parity, level: int) -> bool:
    """Return whether a window of a level ends now."""
    if parity.seconds < WINDOWS_S[level]:
        return False
    return level < FINE_LEVELS or parity.seconds % COARSE_S == 0


@compiled
def close_second(parity: Parity, count: int, regressors: int, suspects: bool) -> float:
    """Add a second to the sums, test, and learn; return the largest parity over its threshold.

    Nothing is learned by a unit that `suspects` an earlier fault to last: it may be quiet by now.
    """
    learner, now = parity.parity, parity.now
    parity.seconds += 1
    _learn_ahead(parity, count, regressors)
    uncertain = learning.leverage(learner, parity.regressors, regressors)
    for k in range(regressors):
        now.regressors[k] += parity.regressors[k]
    for i in range(count):
        now.residual[i] += parity.residual[i]
        known = learning.expected(learner, i, parity.regressors, regressors)
        parity.residual[i] -= known  # what is not learned from here on
    parity.uncertain = uncertain
    _sum_windows(parity, count, regressors)
    _fit_steps(parity, count, regressors)
    largest, noise = _largest(parity, count), _noise(parity, count)
    sound = largest < _LEARNS_BELOW and noise < 1.0 and not suspects
    if sound and parity.frozen > LEARNED_S:  # a fault that passed, learned at once
        learning.copy(parity.ahead, learner)
        parity.fits_from = parity.seconds
    parity.frozen = 0 if sound else parity.frozen + 1
    _settle(parity, count, regressors, sound)
    return max(largest, noise)


@compiled
def _late_s(parity: Parity) -> int:
    """Return after how many seconds something is learned; in the beginning there are fewer."""
    return 1 + min(LATE_S - 1, int(parity.seconds) // 4)


@compiled
def _is_much(parity: Parity, uncertain: float, count: int) -> bool:
    """Return whether what was not known of a second counts beside its noise."""
    for i in range(count):
        noise = _MUCH_LEARNED * parity.second_variance[i]
        if (
            parity.projector[i, i] > CHECKED_FROM
            and uncertain * parity.learning_variance[i] > noise
        ):
            return True
    return False


@compiled
def _variance_of_second(parity: Parity, sensor: int, uncertain: float) -> float:
    """Return the variance of a second's parity; `uncertain` in the learner's unit."""
    known = parity.second_variance[sensor] + parity.drift_second[sensor]
    return float(known + parity.learning_variance[sensor] * uncertain)


@compiled
def _is_beyond(parity: Parity, residual: Floats, count: int, uncertain: float) -> bool:
    """Return whether a second by itself shows what is not to be learned."""
    limit = (_LEARNS_BELOW * parity.second_factor) ** 2
    for i in range(count):
        variance = _variance_of_second(parity, i, uncertain)
        if parity.projector[i, i] > CHECKED_FROM and residual[i] ** 2 > limit * variance:
            return True
    return False


@compiled
def _settle(parity: Parity, count: int, regressors: int, sound: bool) -> None:
    """Learn from a second that is some time ago if nothing is suspicious since, nor was in it.

    A fault that passes would otherwise be what is usual, and its end a fault.
    """
    second = int(parity.seconds) - _late_s(parity)
    if second <= parity.settled:
        return
    learner, now = parity.parity, parity.now
    residual, difference = parity.late_residual, parity.late_second
    before = parity.fine[(second - 1) % FINE_CAPACITY]
    end = parity.fine[second % FINE_CAPACITY]
    for k in range(regressors):
        difference[k] = end.regressors[k] - before.regressors[k]
    uncertain = learning.leverage(learner, difference, regressors)
    now.stretch += math.sqrt(uncertain)
    for i in range(count):
        known = learning.expected(learner, i, difference, regressors)
        residual[i] = end.residual[i] - before.residual[i] - known
        now.parity[i] += residual[i]
    parity.settled = second
    if sound and not _is_beyond(parity, residual, count, uncertain):
        learning.learn(learner, residual, count, uncertain, regressors)
        learning.age(learner, regressors)
        now.leverage += now.stretch**2
        now.stretch = 0.0
        for k in range(regressors):
            parity.learned_regressors[k] = end.regressors[k]
        parity.learned = second
        parity.learning = learner.seconds >= LEARNED_S
        if _is_much(parity, uncertain, count):
            clear_levels(parity)
    for i in range(count):
        end.parity[i] = now.parity[i]
    end.leverage = now.leverage
    end.stretch = now.stretch
    if second % COARSE_S == 0:
        _keep(parity.coarse[second // COARSE_S % COARSE_CAPACITY], end, count)


@compiled
def _learn_ahead(parity: Parity, count: int, regressors: int) -> None:
    """Learn from the present second, whatever it shows; note its squares."""
    learner, residual = parity.ahead, parity.late_residual
    for i in range(count):
        known = learning.expected(learner, i, parity.regressors, regressors)
        residual[i] = parity.residual[i] - known
    uncertain = learning.leverage(learner, parity.regressors, regressors)
    _note_squares(parity, count, uncertain)
    learning.learn(learner, residual, count, uncertain, regressors)
    learning.age(learner, regressors)


@compiled
def _sum_windows(parity: Parity, count: int, regressors: int) -> None:
    """Sum what is not learned over the windows that end now; note how uncertain it is.

    Since something was learned last, as uncertain as the sum of the regressors: what a turn of the
    table brings goes with the next ones. Before, innovations are independent.
    """
    learner, now = parity.parity, parity.now
    settled = parity.fine[parity.settled % FINE_CAPACITY]
    difference = parity.late_second
    for level in range(SECOND_LEVELS):
        if not is_due(parity, level):
            continue
        begin, second = begin_of(parity, level), parity.seconds - WINDOWS_S[level]
        since, learned_since, before = settled, parity.learned_regressors, 0.0
        if second >= parity.settled:
            since = begin
        if second >= parity.learned:
            learned_since = begin.regressors
        else:
            before = now.leverage - begin.leverage - begin.stretch**2
        for k in range(regressors):
            difference[k] = now.regressors[k] - since.regressors[k]
        for i in range(count):
            total = now.residual[i] - since.residual[i]
            total -= learning.expected(learner, i, difference, regressors)
            if second < parity.settled:
                total += now.parity[i] - begin.parity[i]
            parity.window_sum[level, i] = total
        spread = before + learning.spread(learner, learned_since, now.regressors, regressors)
        parity.window_spread[level] = spread
        parity.window_uncertain[level] = spread


@compiled
def _fit_steps(parity: Parity, count: int, regressors: int) -> None:
    """Fit a step to each window that ends now, with what sound sensors put there, where better.

    With the coefficients c and covariance P that were learned up to now, as if there were no step,
    least squares give the step ``(r - c s) / (w - s P s)`` for the sums r of the parity and s of
    the regressors over w seconds, and its variance ``1 / (w - s P s)``. Willsky and Jones, *IEEE
    Transactions on Automatic Control* 21 (1976) 108. Not where a test was pending before the window
    began: then a step may have been learned as what is usual, and its end would look like another.
    """
    learner, now, difference = parity.ahead, parity.now, parity.late_second
    for level in range(SECOND_LEVELS):
        begun = parity.seconds - WINDOWS_S[level]
        fits = parity.fits_from <= begun <= parity.seconds - parity.frozen
        if not (fits and is_due(parity, level)):
            continue
        begin, seconds = begin_of(parity, level), float(WINDOWS_S[level])
        learned = learning.spread(learner, begin.regressors, now.regressors, regressors)
        if learned > _MOST_FITTED * seconds:
            continue
        larger = seconds / (seconds - learned)
        drift = 0.0
        for i in range(count):
            if parity.projector[i, i] > CHECKED_FROM:
                variance = parity.variance[i, level] - seconds * parity.second_variance[i]
                drift = max(drift, variance / parity.learning_variance[i])
        uncertain = learned * larger + drift * (larger**2 - 1.0)
        if uncertain >= parity.window_uncertain[level]:
            continue
        parity.window_uncertain[level] = uncertain
        for k in range(regressors):
            difference[k] = now.regressors[k] - begin.regressors[k]
        for i in range(count):
            total = now.residual[i] - begin.residual[i]
            total -= learning.expected(learner, i, difference, regressors)
            parity.window_sum[level, i] = larger * total


@compiled
def _note_squares(parity: Parity, count: int, uncertain: float) -> None:
    """Note the normalised squares of a second's innovations.

    What is not learned yet errs alike from second to second, and not like noise: such a second
    counts as no more than a usual one.
    """
    alike = min(parity.frozen + 1, NOISE_S)
    is_much = _is_much(parity, uncertain, count)
    for i in range(count):
        variance = _variance_of_second(parity, i, uncertain * alike)
        square = parity.late_residual[i] ** 2 / variance if variance > 0.0 else 0.0
        if is_much:
            square = min(square, 1.0)
        parity.squares[parity.seconds % NOISE_S, i] = square


@compiled
def _noise(parity: Parity, count: int) -> float:
    """Return the largest mean of normalised squares over its threshold."""
    if parity.seconds < NOISE_S:
        return 0.0
    largest = 0.0
    for i in range(count):
        if parity.projector[i, i] <= CHECKED_FROM:
            continue
        total = 0.0
        for second in range(NOISE_S):
            total += parity.squares[second, i]
        largest = max(largest, total / NOISE_S)
    return largest / parity.noise_limit


@compiled
def variance_of(parity: Parity, level: int, sensor: int) -> float:
    """Return the variance of a sensor's parity over a level's window that ends now."""
    uncertain = parity.window_uncertain[level]
    return float(parity.variance[sensor, level] + uncertain * parity.learning_variance[sensor])


@compiled
def uncertain_second(parity: Parity) -> float:
    """Return the variance of what is not known of a second, as if it were noise.

    In the learner's unit. So large that sums over the seconds since learning stopped are right.
    """
    largest = float(parity.uncertain)
    for level in range(SECOND_LEVELS):
        seconds = WINDOWS_S[level]
        if seconds <= parity.frozen + _late_s(parity) and is_due(parity, level):
            largest = max(largest, parity.window_spread[level] / seconds)
    return largest


@compiled
def _largest(parity: Parity, count: int) -> float:
    """Return the largest parity over its threshold; notes window and sensor."""
    largest = 0.0
    for level in range(SECOND_LEVELS):
        if not is_due(parity, level):
            continue
        for i in range(count):
            if parity.projector[i, i] <= CHECKED_FROM:
                continue
            total = parity.window_sum[level, i]
            variance = variance_of(parity, level, i)
            ratio = math.sqrt(total * total / variance) / parity.second_factor
            if ratio > largest:
                largest = ratio
                parity.suspect = i
                parity.window_s = float(WINDOWS_S[level])
    return largest


@compiled
def begun_level(parity: Parity, least: float) -> int:
    """Return the window in which the suspect's sum is most significant: the fault seems as old."""
    return significant_level(parity, max(0, int(parity.suspect)), least)


@compiled
def significant_level(parity: Parity, sensor: int, least: float) -> int:
    """Return the window in which a sensor's sum is most significant; else the shortest.

    Of sums with a chi-square of more than `least`; a sensor that is left out has none.
    """
    most, found = least, 0
    for level in range(SECOND_LEVELS):
        if not is_due(parity, level):
            continue
        total = parity.window_sum[level, sensor]
        variance = variance_of(parity, level, sensor)
        if variance > 0.0 and total * total > most * variance:
            most, found = total * total / variance, level
    return found
