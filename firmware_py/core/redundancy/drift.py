"""Compares what was learned of the parity with the calibration: whether it still holds.

A sensor whose scale factor is off by λ and whose input axis h by Δh puts ``P[i, j] (λ h + Δh)``
into the dependence of parity i on the vector. What is learned of it is not the truth: least squares
with a prior give ``ĉ = A c + noise`` with ``A = I - P_c P_0⁻¹`` and the noise's covariance
``A P_c``, of the prior's covariance P_0 and that of the estimate, P_c; Kay, *Fundamentals of
Statistical Signal Processing: Estimation Theory* (1993), chapter 12. So the covariance of ĉ of
sensors that are as they were calibrated is ``A S Aᵀ + A P_c``, S from the standard deviations of
the calibration and the stability of the data sheet; of all else that is learned, S is the prior.
Its Mahalanobis distance is compared with a limit.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.calibration_records import Drift, DriftSize, DriftState
from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import ABSOLUTE, Learner, Parity
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM, LEARNED_S

_LEARNING, _KEPT = int(DriftState.LEARNING), int(DriftState.KEPT)
_DRIFTED = int(DriftState.DRIFTED)
_LARGEST = int(DriftSize.ABOVE_320_PPM)
_SMALLEST = 10e-6  # from which on a drift is not of the smallest size; each size ends at its double
_SLOPE = 1  # first regressor of the own vector
_TOLD = 0.25
"""Share of the prior's variance below which the parity tells something of a direction."""

_ROUNDING = 1e-16  # (0.01 ppm)²: where nothing has been learned, nothing differs


@compiled
def _respond(drift: Drift, learner: Learner, count: int) -> None:
    """Find how what is learned responds, its noise, and of which directions it tells something."""
    regressors = ABSOLUTE + count
    drift.told = 0
    for r in range(3):
        row = _SLOPE + r
        for k in range(regressors):
            response = 1.0 if k == row else 0.0
            if learner.prior[k] > 0.0:
                response -= learner.covariance[row, k] * learner.unit / learner.prior[k]
            drift.response[r, k] = response
        if learner.covariance[row, row] * learner.unit < _TOLD * learner.prior[row]:
            drift.told |= 1 << r
    for r in range(3):
        for s in range(3):
            total = 0.0
            for k in range(regressors):
                total += drift.response[r, k] * learner.covariance[k, _SLOPE + s]
                if k < _SLOPE or k >= _SLOPE + 3:
                    prior = learner.prior[k] / learner.unit
                    total += drift.response[r, k] * drift.response[s, k] * prior
            drift.noise[r, s] = total


@compiled
def _square(drift: Drift, parity: Parity, row: int, count: int) -> float:
    """Return the squared distance of what was learned of a parity from what was calibrated."""
    variance = drift.variance
    for r in range(3):
        drift.learned[r] = parity.parity.coefficients[row, _SLOPE + r]
        for s in range(3):
            total = parity.learning_variance[row] * drift.noise[r, s]
            for k in range(3):
                for m in range(3):
                    allowed = 0.0
                    for j in range(count):
                        allowed += parity.projector[row, j] ** 2 * drift.axis_variance[j, k, m]
                    shown = drift.response[r, _SLOPE + k] * drift.response[s, _SLOPE + m]
                    total += shown * allowed
            variance[r, s] = total
        variance[r, r] += _ROUNDING
    square = 0.0
    for r in range(3):  # Gaussian elimination
        square += drift.learned[r] ** 2 / variance[r, r]
        for s in range(r + 1, 3):
            factor = variance[s, r] / variance[r, r]
            drift.learned[s] -= factor * drift.learned[r]
            for k in range(r, 3):
                variance[s, k] -= factor * variance[r, k]
    return square


@compiled
def compare(drift: Drift, parity: Parity, fusion: Fusion, epoch: int) -> None:
    """Compare, once a second; after a sensor was left out, what was found before stays."""
    learner, count = parity.parity, int(fusion.count)
    if not drift.known or not parity.redundant or parity.corrected:
        return
    if learner.seconds < LEARNED_S:
        drift.state = _LEARNING
        return
    _respond(drift, learner, count)
    largest, change = 0.0, 0.0
    for row in range(count):
        own = parity.projector[row, row]
        if own <= CHECKED_FROM:
            continue
        square = _square(drift, parity, row, count)
        if square > largest:
            largest, total = square, 0.0
            for r in range(3):
                if drift.told >> r & 1:
                    total += learner.coefficients[row, _SLOPE + r] ** 2
            change = math.sqrt(total) / own
    drift.distance = math.sqrt(largest)
    drift.change = change
    if drift.distance > drift.limit:
        if drift.state != _DRIFTED:
            drift.since_epoch = epoch
        drift.state = _DRIFTED
    else:
        drift.state = _KEPT if drift.told != 0 else _LEARNING


@compiled
def size_of(drift: Drift) -> int:
    """Return the `DriftSize` of what was found last."""
    if drift.state != _DRIFTED:
        return 0
    size, bound = 1, _SMALLEST
    while size < _LARGEST and drift.change >= bound:
        size += 1
        bound *= 2.0
    return size
