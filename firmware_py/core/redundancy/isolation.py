"""Which sensor fails: the one whose fault alone explains what is seen.

A hypothesis per sensor: its residual has an unknown mean, all others are noise. With the residuals
r of all sensors over a window and their covariance R, the likelihood ratio of sensor i against no
fault is ``exp(T_i / 2)``, ``T_i = (R⁻¹ r)_i² / (R⁻¹)_ii``. Groves (2nd ed., 2013), section 17.4;
Willsky, *Automatica* 12 (1976) 601.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import (
    FINE_LEVELS,
    SECOND_LEVELS,
    SETTLED_S,
    WINDOWS_S,
    Parity,
)
from rrins.firmware_py.core.redundancy import windows
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM

RATIO = 2.0 * math.log(1e4)
"""Twice the logarithm of the likelihood ratio that decides."""

_REST = 5.0
"""Largest deviation of what the decision leaves unexplained, standard deviations of chi-square."""

MOTION = 2.0 * math.log(1e2)
"""By how much a sensor has to explain more, in chi-square, than a motion of the vehicle would.

A slight motion turns all sensors and leaves the parity alone; the fault of one shows in both."""


@compiled
def by_parity(parity: Parity, count: int) -> int:
    """Return the sensor that the parity alone points at, -1 where it does not decide.

    Needs five sensors: with four, all explain the parity alike.
    """
    for level in range(SECOND_LEVELS):
        if not windows.is_due(parity, level):
            continue
        best, first, second = -1, 0.0, 0.0
        for i in range(count):
            if parity.projector[i, i] <= CHECKED_FROM:
                continue
            total = parity.window_sum[level, i]
            score = total * total / windows.variance_of(parity, level, i)
            if score > first:
                best, first, second = i, score, first
            elif score > second:
                second = score
        if first - second > RATIO and first > parity.second_factor**2:
            return best
    return -1


@compiled
def _own_variance(parity: Parity, level: int, sensor: int) -> float:
    """Return the variance of a sensor's own noise over a window, with what was learned of it."""
    learned = parity.window_uncertain[level]
    return (
        parity.white_variance[sensor] * WINDOWS_S[level]
        + parity.drift_variance[sensor, level]
        + parity.quantisation_variance
        + learned * parity.learning_variance[sensor]
    )


@compiled
def left_by_motion(parity: Parity, count: int, level: int) -> float:
    """Return the least chi-square that no motion of the vehicle explains: that of the parity.

    Two lower bounds, the first exact if all sensors have the same noise, the second with four: a
    noisy sensor is in the parity of all.
    """
    squares, noisiest, single = 0.0, 0.0, 0.0
    for i in range(count):
        if parity.sensors >> i & 1:
            square = parity.window_sum[level, i] ** 2
            squares += square
            noisiest = max(noisiest, _own_variance(parity, level, i))
            if parity.projector[i, i] > CHECKED_FROM:
                single = max(single, square / windows.variance_of(parity, level, i))
    return max(squares / noisiest, single) if noisiest > 0.0 else 0.0


@compiled
def _covariance(parity: Parity, fusion: Fusion, level: int) -> int:
    """Write the covariance of all sensors' residuals over a window; return their number.

    Each sensor's own noise, and what is not known of the expectation, alike in all directions.
    """
    begin = windows.begin_of(parity, level)
    seconds = WINDOWS_S[level]
    alike = min(parity.frozen + 1, seconds)
    own = (parity.now.vector_leverage - begin.vector_leverage) * alike
    common = parity.expected_variance[level] + own * parity.vector_learning_variance
    common += (parity.tilt_error * seconds) ** 2
    matrix = parity.matrix
    n = 0
    for i in range(fusion.count):
        if parity.sensors >> i & 1 == 0:
            continue
        m = 0
        for j in range(fusion.count):
            if parity.sensors >> j & 1 == 0:
                continue
            total = 0.0
            for axis in range(3):
                total += fusion.H[i, axis] * fusion.H[j, axis]
            matrix[n, m] = total * common
            m += 1
        matrix[n, n] += _own_variance(parity, level, i)
        n += 1
    return n


@compiled
def _residuals(parity: Parity, fusion: Fusion, level: int) -> None:
    """Write the sums of the residuals of the compared sensors to the last column of `matrix`."""
    begin = windows.begin_of(parity, level)
    n = 0
    last = parity.matrix.shape[1] - 1
    for i in range(fusion.count):
        if parity.sensors >> i & 1:
            total = parity.window_sum[level, i]
            for axis in range(3):
                total += fusion.H[i, axis] * (parity.now.vector[axis] - begin.vector[axis])
            parity.matrix[n, last] = total
            n += 1


@compiled
def _invert(parity: Parity, n: int) -> None:
    """Replace the covariance by its inverse, in place (Gauss-Jordan; it is positive definite)."""
    a = parity.matrix
    for k in range(n):
        pivot = 1.0 / a[k, k]
        a[k, k] = 1.0
        for j in range(n):
            a[k, j] *= pivot
        for i in range(n):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= factor * a[k, j]


@compiled
def weigh(parity: Parity, fusion: Fusion, level: int) -> int:
    """Write the inverse covariance of the compared sensors' residuals, and these as last column.

    Over the window that ends now; into `matrix`. Returns the number of sensors.
    """
    n = _covariance(parity, fusion, level)
    _residuals(parity, fusion, level)
    _invert(parity, n)
    return n


@compiled
def _decide(parity: Parity, n: int, left: float) -> tuple[int, float, bool]:
    """Return which of the compared sensors explains most, how much, and whether it is clear.

    It is not where a second one, or a motion of the vehicle, explains nearly as much, or much is
    left unexplained. `left` is what `left_by_motion` returns.
    """
    a, last = parity.matrix, parity.matrix.shape[1] - 1
    best, first, second, whole = -1, 0.0, 0.0, 0.0
    for i in range(n):
        weighted = 0.0
        for j in range(n):
            weighted += a[i, j] * a[j, last]
        whole += weighted * a[i, last]
        score = weighted * weighted / a[i, i]
        if score > first:
            best, first, second = i, score, first
        elif score > second:
            second = score
    rest = whole - first
    explained = rest - (n - 1) <= _REST * math.sqrt(2.0 * (n - 1))
    clear = explained and first - second > RATIO and left - rest > MOTION
    return best, first, clear


@compiled
def _sensor(parity: Parity, index: int) -> int:
    """Return the sensor of an index among the compared ones."""
    n = -1
    for i in range(parity.residual.shape[0]):
        n += parity.sensors >> i & 1
        if n == index:
            return i
    return -1


@compiled
def standing(parity: Parity, fusion: Fusion, moved: bool) -> int:
    """Return the sensor that fails while the vehicle stands, -1 where none does or it is unclear.

    Of windows of up to 128 s; the vehicle stood throughout and some time before. Three sensors have
    no parity that would tell a fault from a slight motion: there, it has to last, and the vehicle
    must not have `moved` since navigation began, for then the expectation errs, too.
    """
    if moved and not parity.redundant:
        return -1
    found = _standing(parity, fusion)
    if parity.redundant:
        return found
    if found < 0 or found != parity.persistent_sensor:
        parity.persistent = 0
    parity.persistent += found >= 0
    parity.persistent_sensor = found
    return found if parity.persistent > SETTLED_S else -1


@compiled
def _standing(parity: Parity, fusion: Fusion) -> int:
    if parity.now.standing == 0:
        return -1
    factor = parity.second_factor**2
    for level in range(FINE_LEVELS):
        if not windows.is_due(parity, level) or parity.now.standing < WINDOWS_S[level] + SETTLED_S:
            continue
        left = math.inf
        if parity.redundant:
            left = left_by_motion(parity, int(fusion.count), level)
        n = weigh(parity, fusion, level)
        best, score, clear = _decide(parity, n, left)
        if clear and score > factor:
            return _sensor(parity, best)
    return -1
