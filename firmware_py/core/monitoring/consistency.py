"""Compares redundant sensors with each other, to detect that one is faulty.

The residual of a sensor is its measurement minus the fused vector along its input axis, averaged
over 10 s. A bias b of one sensor leaves (1 - h · g) b in its own residual, h its input axis and g
its column of the fusion's gain: a quarter with four on a tetrahedron, whose residuals are then all
equally large. Three sensors are always consistent.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.diagnostic_records import DiagnosticState
from rrins.firmware_py.core.records.memory import Fusion

MEAN_S = 10.0
"""Time constant of the mean."""

_REDUNDANT_FROM = 4


@compiled
def _follow(
    fusion: Fusion,
    measured: Floats,
    vector_s: Floats,
    usable: int,
    stuck: int,
    residual: Floats,
    apart: int,
    share: float,
) -> tuple[int, float]:
    """Update the mean residuals.

    Returns
    -------
    tuple
        The sensors that are usable but left out of the fusion, one bit each, and the root sum of
        squares of the others' residuals; negative if there are too few sensors.
    """
    used = fusion.used & usable
    if stuck != 0:  # the faulty sensor is known
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


@compiled
def gyros(
    fusion: Fusion,
    measured: Floats,
    dtheta_s: Floats,
    usable: int,
    stuck: int,
    monitor: DiagnosticState,
) -> float:
    """Return the disagreement of the gyros (rad per epoch); negative if it cannot be determined."""
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


@compiled
def accelerometers(
    fusion: Fusion,
    measured: Floats,
    dv_s: Floats,
    usable: int,
    stuck: int,
    monitor: DiagnosticState,
) -> float:
    """Return the disagreement of the accelerometers (m/s per epoch); see `gyros`."""
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
