"""Tests of the parity over windows from 1 to 1024 s, and of its variance over 32 s.

The sum of what is not learned over a window of sound sensors has zero mean and a variance that
follows from the data sheet: white noise, counts, drift, and the uncertainty of what was learned.
Windows of up to 128 s end and begin at any second, longer ones begin every 16 s.
"""

from __future__ import annotations

import math

from rrins.dbc.compilation import compiled
from rrins.firmware_py.core.redundancy import learning
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM, LEARNED_S, clear_levels
from rrins.firmware_py.core.redundancy_records import (
    COARSE_CAPACITY,
    COARSE_S,
    FINE_CAPACITY,
    FINE_LEVELS,
    NOISE_S,
    SECOND_LEVELS,
    Parity,
    Sums,
)

_MUCH_LEARNED = 0.1
"""Variance of what a second taught, in variances of its noise, from which on open windows that are
shorter begin again: their sums are of what was not learned before."""

_LEARNS_BELOW = 0.6
"""Share of the threshold above which nothing is learned: a test is pending."""


@compiled
def _keep(sums: Sums, now: Sums, count: int) -> None:
    for i in range(count):
        sums.parity[i] = now.parity[i]
    for i in range(3):
        sums.vector[i] = now.vector[i]
    sums.leverage = now.leverage
    sums.stretch = now.stretch
    sums.stretches = now.stretches
    sums.vector_leverage = now.vector_leverage
    sums.standing = now.standing


@compiled
def keep(parity: Parity, count: int) -> None:
    """Keep the sums as the begin of later windows."""
    _keep(parity.fine[parity.seconds % FINE_CAPACITY], parity.now, count)
    if parity.seconds % COARSE_S == 0:
        _keep(parity.coarse[parity.seconds // COARSE_S % COARSE_CAPACITY], parity.now, count)


@compiled
def begin_of(parity: Parity, level: int) -> Sums:
    """Return the sums where the window of a level that ends now begins."""
    begin = parity.seconds - (1 << level)
    if level < FINE_LEVELS:
        return parity.fine[begin % FINE_CAPACITY]
    return parity.coarse[begin // COARSE_S % COARSE_CAPACITY]


@compiled
def is_due(parity: Parity, level: int) -> bool:
    """Return whether a window of a level ends now."""
    if parity.seconds < 1 << level:
        return False
    return level < FINE_LEVELS or parity.seconds % COARSE_S == 0


@compiled
def close_second(parity: Parity, count: int, regressors: int) -> float:
    """Add a second to the sums, test, and learn; return the largest parity over its threshold."""
    learner = parity.parity
    uncertain = learning.leverage(learner, parity.regressors, regressors)
    for i in range(count):
        known = learning.expected(learner, i, parity.regressors, regressors)
        parity.residual[i] -= known  # the innovation from here on
        parity.now.parity[i] += parity.residual[i]
    parity.uncertain = uncertain
    parity.now.stretch += math.sqrt(uncertain)
    parity.seconds += 1
    _note_squares(parity, count, uncertain)
    largest, noise = _largest(parity, count), _noise(parity, count)
    if largest < _LEARNS_BELOW and noise < 1.0:
        learning.learn(learner, parity.residual, count, uncertain, regressors)
        learning.age(learner, regressors)
        parity.now.leverage += parity.now.stretch**2
        parity.now.stretch = 0.0
        parity.now.stretches += 1
        parity.frozen = 0
        parity.learning = learner.seconds >= LEARNED_S
        if uncertain > _MUCH_LEARNED:
            clear_levels(parity)
    else:
        parity.frozen += 1
    return max(largest, noise)


@compiled
def _note_squares(parity: Parity, count: int, uncertain: float) -> None:
    """Note the normalised squares of a second.

    What is not learned yet errs alike from second to second, and not like noise: such a second
    counts as no more than a usual one.
    """
    alike = min(parity.frozen + 1, NOISE_S)
    for i in range(count):
        variance = parity.second_variance[i] * (1.0 + uncertain * alike) + parity.drift_second[i]
        square = parity.residual[i] ** 2 / variance if variance > 0.0 else 0.0
        if uncertain > _MUCH_LEARNED:
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
def uncertainty_of(parity: Parity, level: int) -> float:
    """Return how uncertain a level's window is by what was learned, in variances of a second.

    What was learned errs alike in all seconds between two in which something was learned, and
    independently before and after.
    """
    now, begin = parity.now, begin_of(parity, level)
    if now.stretches == begin.stretches:
        return float((now.stretch - begin.stretch) ** 2)
    return float(now.leverage - begin.leverage + now.stretch**2 - begin.stretch**2)


@compiled
def variance_of(parity: Parity, level: int, sensor: int) -> float:
    """Return the variance of a sensor's parity over a level's window that ends now."""
    uncertain = uncertainty_of(parity, level)
    return parity.variance[sensor, level] + uncertain * parity.second_variance[sensor]


@compiled
def _largest(parity: Parity, count: int) -> float:
    """Return the largest parity over its threshold; notes window and sensor."""
    largest = 0.0
    for level in range(SECOND_LEVELS):
        if not is_due(parity, level):
            continue
        begin = begin_of(parity, level)
        for i in range(count):
            if parity.projector[i, i] <= CHECKED_FROM:
                continue
            total = parity.now.parity[i] - begin.parity[i]
            variance = variance_of(parity, level, i)
            ratio = math.sqrt(total * total / variance) / parity.second_factor
            if ratio > largest:
                largest = ratio
                parity.suspect = i
                parity.window_s = float(1 << level)
    return largest
