"""Means of the firmware's own tests under a fault, without noise.

The parity of a step on one sensor is put through the firmware's learning and its windows, as sound
sensors would be. So what the mean loses to learning, and when learning stops, is the firmware's.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import (
    ABSOLUTE,
    FINE_LEVELS,
    SECOND_LEVELS,
    SETTLED_S,
    WINDOWS_S,
    Parity,
)
from rrins.firmware_py.core.redundancy import isolation, standing, windows
from rrins.firmware_py.core.redundancy import parity as parities


@compiled
def _note_standing(parity: Parity, fusion: Fusion, sensor: int, level: int, out: Floats) -> None:
    """Write statistic, closest rival and what a motion leaves, of a window that ends now."""
    n = isolation.weigh(parity, fusion, level)
    a, last = parity.matrix, parity.matrix.shape[1] - 1
    weighted, rival = 0.0, 0.0
    for j in range(n):
        weighted += a[sensor, j] * a[j, last]
        if j != sensor:
            rival = max(rival, abs(a[sensor, j]) / math.sqrt(a[sensor, sensor] * a[j, j]))
    out[0] = weighted / math.sqrt(a[sensor, sensor])
    out[1] = rival
    out[2] = isolation.left_by_motion(parity, int(fusion.count), level)


@compiled
def follow(
    parity: Parity,
    fusion: Fusion,
    sensor: int,
    step: float,
    seconds: int,
    alone: Floats,
    at_rest: Floats,
) -> None:
    """Follow a step on one sensor for some seconds, at rest, all sensors compared.

    Parameters
    ----------
    parity : Parity
        Of the kind; goes on from its state.
    fusion : Fusion
    sensor : int
    step : float
        rad or m/s in a second; 0 to learn.
    seconds : int
    alone : array, shape (seconds, SECOND_LEVELS)
        Mean of the parity's sum over each window that ends with a second, in standard deviations.
        Windows that do not end there keep the value before.
    at_rest : array, shape (seconds, FINE_LEVELS, 3)
        Of the test at standstill: the mean, too; the largest correlation with another sensor's; and
        the chi-square that a motion of the vehicle would leave. Zero where nothing ends.
    """
    count = int(fusion.count)
    regressors = ABSOLUTE + count
    for second in range(seconds):
        parity.regressors[0] = 1.0
        for i in range(count):
            parity.residual[i] = parity.projector[i, sensor] * step
        for axis in range(3):
            parity.vector[axis] = fusion.gain[axis, sensor] * step
        ratio = windows.close_second(parity, count, regressors, False)
        standing.close_second(parity, fusion, regressors, True, True, True)
        parity.alarm = ratio > 1.0
        if step != 0.0:
            for level in range(SECOND_LEVELS):
                if windows.is_due(parity, level):
                    total = parity.window_sum[level, sensor]
                    variance = windows.variance_of(parity, level, sensor)
                    alone[second, level] = total / math.sqrt(variance) if variance > 0.0 else 0.0
                elif second > 0:
                    alone[second, level] = alone[second - 1, level]
            for level in range(FINE_LEVELS):
                if parity.now.standing >= WINDOWS_S[level] + SETTLED_S:
                    _note_standing(parity, fusion, sensor, level, at_rest[second, level])
        windows.keep(parity, count)
        parities.begin_second(parity)
