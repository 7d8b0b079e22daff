"""Which sensor fails: the one whose fault alone explains what is seen.

A hypothesis per sensor: its residual has an unknown mean, all others are noise. With the residuals
r of all sensors over a window and their covariance R, the likelihood ratio of sensor i against no
fault is ``exp(T_i / 2)``, ``T_i = (R⁻¹ r)_i² / (R⁻¹)_ii``. Groves (2nd ed., 2013), section 17.4;
Willsky, *Automatica* 12 (1976) 601.
"""

from __future__ import annotations

import math

from rrins.dbc.compilation import compiled
from rrins.firmware_py.core.memory import Fusion
from rrins.firmware_py.core.redundancy import windows
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM
from rrins.firmware_py.core.redundancy.standing import SETTLED_S
from rrins.firmware_py.core.redundancy_records import FINE_LEVELS, SECOND_LEVELS, Parity

_RATIO = 2.0 * math.log(1e4)
"""Twice the logarithm of the likelihood ratio that decides."""

_REST = 5.0
"""Largest deviation of what the decision leaves unexplained, standard deviations of chi-square."""


@compiled
def by_parity(parity: Parity, count: int) -> int:
    """Return the sensor that the parity alone points at, -1 where it does not decide.

    Needs five sensors: with four, all explain the parity alike.
    """
    for level in range(SECOND_LEVELS):
        if not windows.is_due(parity, level):
            continue
        begin = windows.begin_of(parity, level)
        best, first, second = -1, 0.0, 0.0
        for i in range(count):
            if parity.projector[i, i] <= CHECKED_FROM:
                continue
            total = parity.now.parity[i] - begin.parity[i]
            score = total * total / windows.variance_of(parity, level, i)
            if score > first:
                best, first, second = i, score, first
            elif score > second:
                second = score
        if first - second > _RATIO and first > parity.second_factor**2:
            return best
    return -1


@compiled
def _covariance(parity: Parity, fusion: Fusion, level: int) -> int:
    """Write the covariance of all sensors' residuals over a window; return their number.

    Each sensor's own noise, and what is not known of the expectation, alike in all directions.
    """
    begin = windows.begin_of(parity, level)
    seconds = 1 << level
    alike = min(parity.frozen + 1, seconds)
    own = (parity.now.vector_leverage - begin.vector_leverage) * alike * parity.vector_variance
    common = parity.expected_variance[level] + own
    common += (parity.tilt_error * seconds) ** 2
    learned = (parity.now.leverage - begin.leverage) * alike
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
        matrix[n, n] += (
            parity.white_variance[i] * seconds
            + parity.drift_variance[i, level]
            + parity.quantisation_variance
            + learned * parity.second_variance[i]
        )
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
            total = parity.now.parity[i] - begin.parity[i]
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
def _decide(parity: Parity, n: int) -> tuple[int, float, float]:
    """Return which of the compared sensors explains most, how much, and whether it is clear.

    The last is negative where a second one explains nearly as much, or much is left unexplained.
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
    unexplained = rest - (n - 1) > _REST * math.sqrt(2.0 * (n - 1))
    return best, first, -1.0 if unexplained or first - second <= _RATIO else first - second


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
def standing(parity: Parity, fusion: Fusion) -> int:
    """Return the sensor that fails while the vehicle stands, -1 where none does or it is unclear.

    Of windows of up to 128 s; the vehicle stood throughout and some time before.
    """
    if parity.now.standing == 0:
        return -1
    factor = parity.second_factor**2
    for level in range(FINE_LEVELS):
        if not windows.is_due(parity, level) or parity.now.standing < (1 << level) + SETTLED_S:
            continue
        n = _covariance(parity, fusion, level)
        _residuals(parity, fusion, level)
        _invert(parity, n)
        best, score, clear = _decide(parity, n)
        if clear > 0.0 and score > factor:
            return _sensor(parity, best)
    return -1
