"""Learns what sound sensors put into the parity: recursive least squares that forget slowly.

A Kalman filter whose states are the coefficients, each a random walk with a ceiling on its
variance; Gelb (ed.), *Applied Optimal Estimation* (1974), chapter 4. Variances are in units of
the noise of a second's sum, so that one covariance serves all rows.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.redundancy_records import REGRESSORS, Learner


@compiled
def noise(learner: Learner, white: float, instability: float) -> float:
    """Return the variance of a second's sum that the learner is to take for white noise.

    Bias instability of variance B² has the spectrum B²/(2 π f) (IEEE Std 952-1997, annex C). White
    noise R and a walk of the bias, q in a second, have R + q/(2 π f)², which is nowhere less if
    R q ≥ B⁴/4: so what is learned is never less certain than it is said to be.
    """
    walk = learner.walk[0]
    return max(white, 0.25 * instability**2 / walk) if walk > 0.0 else white


@compiled
def forget_all(learner: Learner, unit: float) -> None:
    """Start anew, with nothing learned; `unit` is the `noise` of a second's sum."""
    learner.seconds = 0
    learner.unit = unit
    for k in range(REGRESSORS):
        for j in range(REGRESSORS):
            learner.covariance[k, j] = 0.0
        learner.covariance[k, k] = learner.prior[k] / unit
    for i in range(learner.coefficients.shape[0]):
        for k in range(REGRESSORS):
            learner.coefficients[i, k] = 0.0


@compiled
def expected(learner: Learner, row: int, regressors: Floats, count: int) -> float:
    """Return what was learned of a row, for `count` regressors."""
    total = 0.0
    for k in range(count):
        total += learner.coefficients[row, k] * regressors[k]
    return total


@compiled
def leverage(learner: Learner, regressors: Floats, count: int) -> float:
    """Return the variance of what `expected` returns; prepares `learn`."""
    total = 0.0
    for k in range(count):
        projected = 0.0
        for j in range(count):
            projected += learner.covariance[k, j] * regressors[j]
        learner.gain[k] = projected
        total += regressors[k] * projected
    return total


@compiled
def spread(learner: Learner, begin: Floats, end: Floats, count: int) -> float:
    """Return the variance of what is expected between two sums of regressors.

    Four rows of the product with the covariance at a time: their sums do not wait for each other.
    """
    covariance, total = learner.covariance, 0.0
    for k in range(0, count, 4):
        first = second = third = fourth = 0.0
        for j in range(count):
            difference = end[j] - begin[j]
            first += covariance[j, k] * difference
            second += covariance[j, k + 1] * difference
            third += covariance[j, k + 2] * difference
            fourth += covariance[j, k + 3] * difference
        learner.gain[k], learner.gain[k + 1] = first, second
        learner.gain[k + 2], learner.gain[k + 3] = third, fourth
    for k in range(count):
        total += (end[k] - begin[k]) * learner.gain[k]
    return total


@compiled
def learn(learner: Learner, innovations: Floats, rows: int, variance: float, count: int) -> None:
    """Learn from a second's innovations, one per row; `variance` is what `leverage` returned."""
    scale = 1.0 / (1.0 + variance)
    for i in range(rows):
        for k in range(count):
            learner.coefficients[i, k] += learner.gain[k] * scale * innovations[i]
    covariance = learner.covariance
    for k in range(count):
        for j in range(REGRESSORS):
            covariance[k, j] -= learner.gain[k] * learner.gain[j] * scale
    learner.seconds += 1


@compiled
def age(learner: Learner, count: int) -> None:
    """Let a second pass: what was learned becomes less certain."""
    for k in range(count):
        if learner.covariance[k, k] * learner.unit < learner.prior[k]:
            learner.covariance[k, k] += learner.walk[k] / learner.unit


@compiled
def copy(learner: Learner, other: Learner) -> None:
    """Take over what another learner knows; its unit may differ."""
    scale = other.unit / learner.unit
    learner.seconds = other.seconds
    for k in range(REGRESSORS):
        for j in range(REGRESSORS):
            learner.covariance[k, j] = other.covariance[k, j] * scale
    for i in range(learner.coefficients.shape[0]):
        for k in range(REGRESSORS):
            learner.coefficients[i, k] = other.coefficients[i, k]


@compiled
def confine(learner: Learner, count: int) -> None:
    """Expect of each coefficient what is usual of sound sensors, no longer its limit.

    The prior of variance p becomes one of variance u as if zero had been measured of the
    coefficient with the variance ``u p / (p - u)``: the product of two normal densities.
    """
    covariance = learner.covariance
    for j in range(count):
        limit, usual = learner.prior[j] / learner.unit, learner.usual[j] / learner.unit
        if usual >= limit:
            continue
        scale = 1.0 / (covariance[j, j] + usual * limit / (limit - usual))
        for k in range(count):
            learner.gain[k] = covariance[k, j]
        for i in range(learner.coefficients.shape[0]):
            value = learner.coefficients[i, j]
            for k in range(count):
                learner.coefficients[i, k] -= learner.gain[k] * scale * value
        for k in range(count):
            for m in range(count):
                covariance[k, m] -= learner.gain[k] * learner.gain[m] * scale


@compiled
def resume(learner: Learner, other: Learner, seconds: float) -> None:
    """Know as well as another learner did some seconds ago."""
    copy(learner, other)
    for k in range(REGRESSORS):
        missing = learner.prior[k] - learner.covariance[k, k] * learner.unit
        if missing > 0.0:
            learner.covariance[k, k] += min(missing, learner.walk[k] * seconds) / learner.unit
