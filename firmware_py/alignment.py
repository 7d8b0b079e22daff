"""Initial attitude: given, or by coarse self-alignment at standstill.

At standstill the mean specific force points up and the mean angular rate is the Earth's; the two
give the attitude (TRIAD). Groves (2nd ed., 2013), sections 5.6.1 and 5.6.2.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from firmware_py import earth
from firmware_py.attitude import cross

_FORCE_TOLERANCE = 0.02  # of gravity: more, and the vehicle moves or an accelerometer is wrong
_SMALLEST_HORIZONTAL = 1e-3  # of the Earth's rate: less, and there is no north to find


@njit(cache=True)
def begin(alignment: Any) -> None:
    """Start a new alignment (record of dtype `firmware_py.memory.ALIGNMENT`)."""
    alignment.epochs = 0
    alignment.done = False
    alignment.failed = False
    for i in range(3):
        alignment.dtheta_s[i] = 0.0
        alignment.dv_s[i] = 0.0
        alignment.angle_sum[i] = 0.0
        alignment.angle_moment[i] = 0.0


@njit(cache=True)
def accumulate(alignment: Any, dtheta_s: Any, dv_s: Any) -> None:
    """Add one epoch's increments at standstill, each of shape (3,)."""
    alignment.epochs += 1
    for i in range(3):
        alignment.dtheta_s[i] += dtheta_s[i]
        alignment.dv_s[i] += dv_s[i]
        alignment.angle_sum[i] += alignment.dtheta_s[i]
        alignment.angle_moment[i] += alignment.epochs * alignment.dtheta_s[i]


@njit(cache=True)
def take_given(alignment: Any, C_b_n: Any, C_s_b: Any) -> None:
    """Finish with a given body attitude, turned through the table's angles."""
    for i in range(3):
        for j in range(3):
            alignment.C_s_n[i, j] = (
                C_b_n[i, 0] * C_s_b[0, j] + C_b_n[i, 1] * C_s_b[1, j] + C_b_n[i, 2] * C_s_b[2, j]
            )
    alignment.done = True


@njit(cache=True)
def find(alignment: Any, dt: float, gravity: float, work: Any) -> None:
    """Find the attitude from the increments added so far.

    `alignment.done` or `alignment.failed` tells the outcome; it fails when the mean specific
    force is not gravity's, or when no horizontal part of the Earth's rate is left to find north.
    `work` is scratch of shape (at least 3, 3).
    """
    seconds = alignment.epochs * dt
    east_s, north_s, up_s = work[0], work[1], work[2]
    for i in range(3):
        up_s[i] = alignment.dv_s[i]
    length = _normalise(up_s)
    if not abs(length - gravity * seconds) < _FORCE_TOLERANCE * gravity * seconds:
        alignment.failed = True
        return
    cross(east_s, alignment.dtheta_s, up_s)
    if not _normalise(east_s) > _SMALLEST_HORIZONTAL * earth.RATE * seconds:
        alignment.failed = True
        return
    cross(north_s, up_s, east_s)
    for i in range(3):
        alignment.C_s_n[0, i] = east_s[i]
        alignment.C_s_n[1, i] = north_s[i]
        alignment.C_s_n[2, i] = up_s[i]
    alignment.done = True


@njit(cache=True)
def _normalise(v: Any) -> float:
    """Bring a vector to unit length; return the length it had."""
    length = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if length > 0.0:
        for i in range(3):
            v[i] /= length
    return length


@njit(cache=True)
def take_held_back(alignment: Any, resolution: float, work: Any) -> None:
    """Correct the attitude for the fraction of a count that the gyros hold back at the end.

    Counted angles scatter about the true ones by up to half a count; the attitude must start on
    the line through their scatter, or the last one's stays as a tilt (1e-9 rad is a centimetre
    after half a Schuler period). At standstill the line is the least squares fit of the summed
    angles over the epochs; limited to one count, `resolution` in rad, so that neither noise nor
    motion can do harm by it. `work` is scratch of shape (at least 2, 3).
    """
    n = alignment.epochs
    if n < 3:
        return
    held_back_s, row_n = work[0], work[1]
    for i in range(3):
        mean = alignment.angle_sum[i] / n
        slope = (alignment.angle_moment[i] - mean * n * (n + 1) / 2.0) / (n * (n * n - 1) / 12.0)
        on_line = mean + slope * (n - 1) / 2.0
        difference = alignment.dtheta_s[i] - on_line
        held_back_s[i] = min(resolution, max(-resolution, difference))
    for i in range(3):
        cross(row_n, alignment.C_s_n[i], held_back_s)
        for j in range(3):
            alignment.C_s_n[i, j] += row_n[j]
