"""Compares redundant sensors with each other: whether one of them must be wrong.

The residual of a sensor is what it measures less the fused vector along its input axis, as a mean
over 10 s. A bias b of one sensor leaves (1 - h · g) b in its own residual, h its input axis and g
its column of the fusion's gain: a quarter with four on a tetrahedron, whose residuals are then all
equally large. Three sensors fit each other whatever they measure.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

MEAN_S = 10.0
"""Time constant of the mean."""

_REDUNDANT_FROM = 4


@njit(cache=True)
def _follow(
    fusion: Any,
    measured: Any,
    vector_s: Any,
    usable: int,
    stuck: int,
    residual: Any,
    apart: int,
    share: float,
) -> tuple[int, float]:
    """Go on with the mean residuals.

    Returns
    -------
    tuple
        The sensors that are usable and left out of the fusion, a bit each, and the root sum of
        squares of the others' residuals, negative where there are too few to tell.
    """
    used = fusion.used & usable
    if stuck != 0:  # who is wrong is known
        residual[:] = 0.0
        return apart, -1.0
    if not fusion.solvable or used != fusion.used:
        return apart, -1.0
    count, total = 0, 0.0
    for k in range(fusion.count):
        if usable >> k & 1 == 0:
            continue
        along = 0.0
        for i in range(3):
            along += fusion.H[k, i] * vector_s[i]
        if used >> k & 1 and apart >> k & 1:
            residual[k] = 0.0
        residual[k] += (measured[k] - along - residual[k]) * share
        if used >> k & 1:
            count += 1
            total += residual[k] * residual[k]
    return usable & ~used, math.sqrt(total) if count >= _REDUNDANT_FROM else -1.0


@njit(cache=True)
def gyros(
    fusion: Any, measured: Any, dtheta_s: Any, usable: int, stuck: int, monitor: Any
) -> float:
    """Return by how much the gyros disagree (rad in an epoch); negative where nobody can tell."""
    monitor.gyro_apart, disagreement = _follow(
        fusion,
        measured,
        dtheta_s,
        usable,
        stuck,
        monitor.gyro_residual,
        monitor.gyro_apart,
        monitor.residual_share,
    )
    return disagreement


@njit(cache=True)
def accelerometers(
    fusion: Any, measured: Any, dv_s: Any, usable: int, stuck: int, monitor: Any
) -> float:
    """Return by how much the accelerometers disagree (m/s in an epoch); see `gyros`."""
    monitor.accelerometer_apart, disagreement = _follow(
        fusion,
        measured,
        dv_s,
        usable,
        stuck,
        monitor.accelerometer_residual,
        monitor.accelerometer_apart,
        monitor.residual_share,
    )
    return disagreement
