"""Initial attitude: given, or by coarse self-alignment at standstill.

For a vehicle that moves: `inertial_alignment`.
At standstill the mean specific force points up and the mean angular rate is the Earth's; the two
give the attitude (TRIAD). Groves (2nd ed., 2013), sections 5.6.1 and 5.6.2.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.attitude import cross
from rrins.firmware_py.core.records.memory import Alignment

FORCE_TOLERANCE = 0.02
"""Of gravity; beyond, an accelerometer is faulty, or the vehicle moves more than it may."""

LARGEST_HEADING_SIGMA = math.radians(3.0)
"""That motion and noise may leave; the filter after an alignment is linear."""

_LEAST_EPOCHS = 10

_NOISE_TIMES = 9.0
"""Times its mean, the mean square of the deviation that noise does not exceed."""

_RATE_OF_UNEVEN = 15.0
"""By how much the mean rate may be off, times the length of the alignment, over the deviation: 1.4
of a vehicle that sways, 14 of a gyro that changes in the middle, more nearer to the ends."""

SETS_OFF_S = 1.0
_SETS_OFF_MPS = 1.0
"""Velocity that a vehicle gains within about this time if it sets off, and not if it sways."""

_SMALLEST_HORIZONTAL = 1e-3  # of the Earth's rate; below, north is undefined


@compiled
def begin(alignment: Alignment) -> None:
    """Start a new alignment."""
    alignment.epochs = 0
    alignment.done = False
    alignment.failed = False
    alignment.velocity_sigma = 0.0
    alignment.position_sigma = 0.0
    alignment.rate_sigma = 0.0
    alignment.force_sigma = 0.0
    alignment.angle_square = 0.0
    alignment.increment_square = 0.0
    for i in range(3):
        alignment.noise_sigma[i] = 0.0
        alignment.gained_s[i] = 0.0
        alignment.dtheta_s[i] = 0.0
        alignment.dv_s[i] = 0.0
        alignment.angle_sum[i] = 0.0
        alignment.angle_moment[i] = 0.0


@compiled
def accumulate(alignment: Alignment, dtheta_s: Floats, dv_s: Floats) -> None:
    """Add one epoch's increments at standstill, each of shape (3,)."""
    alignment.epochs += 1
    for i in range(3):
        alignment.dtheta_s[i] += dtheta_s[i]
        alignment.dv_s[i] += dv_s[i]
        alignment.angle_sum[i] += alignment.dtheta_s[i]
        alignment.angle_moment[i] += alignment.epochs * alignment.dtheta_s[i]
        alignment.angle_square += alignment.dtheta_s[i] ** 2
        alignment.increment_square += dtheta_s[i] ** 2


@compiled
def sets_off(alignment: Alignment, dv_s: Floats) -> bool:
    """Return whether the vehicle sets off; called in each epoch that an alignment waits.

    `dv_s` is that of the epoch, shape (3,), m/s, and already added.
    """
    for i in range(3):
        alignment.gained_s[i] += dv_s[i] - alignment.dv_s[i] / alignment.epochs
    return gained_velocity(alignment) > _SETS_OFF_MPS


@compiled
def gained_velocity(alignment: Alignment) -> float:
    """Return the velocity that the vehicle has gained while the alignment waited, m/s."""
    gained = alignment.gained_s
    return math.sqrt(gained[0] * gained[0] + gained[1] * gained[1] + gained[2] * gained[2])


@compiled
def set_given(alignment: Alignment, C_b_n: Floats, C_s_b: Floats) -> None:
    """Finish with a given body attitude, turned through the table's angles."""
    for i in range(3):
        for j in range(3):
            alignment.C_s_n[i, j] = (
                C_b_n[i, 0] * C_s_b[0, j] + C_b_n[i, 1] * C_s_b[1, j] + C_b_n[i, 2] * C_s_b[2, j]
            )
    alignment.done = True


@compiled
def find(alignment: Alignment, dt: float, gravity: float, work: Floats) -> None:
    """Find the attitude from the increments added so far.

    `alignment.done` or `alignment.failed` is the outcome; it fails when the mean specific force
    differs from gravity, when the Earth's rate has no horizontal component to find north, or when
    the vehicle moved, or a gyro changed, by so much that north is not known.
    `work` is scratch of shape (at least 3, 3).
    """
    seconds = alignment.epochs * dt
    east_s, north_s, up_s = work[0], work[1], work[2]
    for i in range(3):
        up_s[i] = alignment.dv_s[i]
    length = _normalise(up_s)
    if not abs(length - gravity * seconds) < FORCE_TOLERANCE * gravity * seconds:
        alignment.failed = True
        return
    cross(east_s, alignment.dtheta_s, up_s)
    horizontal = _normalise(east_s)
    if not horizontal > _SMALLEST_HORIZONTAL * earth.RATE * seconds:
        alignment.failed = True
        return
    uneven = math.sqrt(_uneven(alignment))
    heading_sigma = math.hypot(_RATE_OF_UNEVEN * uneven, alignment.rate_sigma * seconds)
    heading_sigma /= horizontal
    if heading_sigma > LARGEST_HEADING_SIGMA:
        alignment.failed = True
        return
    level_sigma = math.hypot(uneven, alignment.force_sigma / gravity)
    alignment.noise_sigma[0] = level_sigma
    alignment.noise_sigma[1] = level_sigma
    alignment.noise_sigma[2] = heading_sigma
    cross(north_s, up_s, east_s)
    for i in range(3):
        alignment.C_s_n[0, i] = east_s[i]
        alignment.C_s_n[1, i] = north_s[i]
        alignment.C_s_n[2, i] = up_s[i]
    alignment.done = True


@compiled
def _slope(alignment: Alignment, axis: int) -> float:
    """Return the angle in an epoch, rad, of the line that fits the summed angles best."""
    n = alignment.epochs
    mean = alignment.angle_sum[axis] / n
    moment = alignment.angle_moment[axis] - mean * n * (n + 1) / 2.0
    return float(moment / (n * (n * n - 1) / 12.0))


@compiled
def _uneven(alignment: Alignment) -> float:
    """Return the mean square of the angle's deviation from a line beyond that of noise, rad².

    Of a vehicle that stands, and gyros that do not change, the angle is a line and the sum of white
    noise, whose mean square about its line is ``n v / 15``, v the variance of an increment.
    """
    n = alignment.epochs
    if n < _LEAST_EPOCHS:
        return 0.0
    square, noise = alignment.angle_square, alignment.increment_square
    for i in range(3):
        slope = _slope(alignment, i)
        square -= alignment.angle_sum[i] ** 2 / n + slope * slope * n * (n * n - 1) / 12.0
        noise -= alignment.dtheta_s[i] ** 2 / n
    return float(max(0.0, square / n - _NOISE_TIMES * noise / 15.0))


@compiled
def _normalise(v: Floats) -> float:
    """Normalise a vector in place; return its former length."""
    length = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if length > 0.0:
        for i in range(3):
            v[i] /= length
    return length


@compiled
def apply_held_back(alignment: Alignment, resolution: float, work: Floats) -> None:
    """Correct the attitude for the fraction of a count that the gyros retain at the end.

    Counted angles scatter about the true ones by up to half a count; the attitude must start on
    the line through their scatter, or the last deviation remains as a tilt (1e-9 rad is a
    centimetre after half a Schuler period). At standstill the line is the least squares fit of the
    summed angles over the epochs; the correction is limited to one count, `resolution` in rad, so
    that neither noise nor motion can do harm. `work` is scratch of shape (at least 2, 3).
    """
    n = alignment.epochs
    if n < 3:
        return
    held_back_s, row_n = work[0], work[1]
    for i in range(3):
        on_line = alignment.angle_sum[i] / n + _slope(alignment, i) * (n - 1) / 2.0
        difference = alignment.dtheta_s[i] - on_line
        held_back_s[i] = min(resolution, max(-resolution, difference))
    for i in range(3):
        cross(row_n, alignment.C_s_n[i], held_back_s)
        for j in range(3):
            alignment.C_s_n[i, j] += row_n[j]
