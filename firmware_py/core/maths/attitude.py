"""Rotations: quaternions (scalar first), direction cosine matrices, Euler and gimbal angles.

Functions write into their first argument and allocate nothing. Conventions: `firmware_py`.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.maths.angles import Angle, turn_to

_SERIES_BELOW = 1e-4  # rad²: the neglected terms are below 1e-17


@compiled
def cross(out: Floats, a: Floats, b: Floats) -> None:
    """Write the vector product of `a` and `b`, shape (3,), to `out`, distinct from both."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@compiled
def rotate(out: Floats, C: Floats, v: Floats) -> None:
    """Write ``C @ v``, shapes (3, 3) and (3,), to `out`, distinct from `v`."""
    for i in range(3):
        out[i] = C[i, 0] * v[0] + C[i, 1] * v[1] + C[i, 2] * v[2]


@compiled
def quaternion_of_vector(out: Floats, phi: Floats) -> None:
    """Write the quaternion, shape (4,), of a rotation vector, shape (3,), rad."""
    squared = phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2
    if squared < _SERIES_BELOW:
        quarter = squared / 4.0
        cosine = 1.0 - quarter / 2.0 * (1.0 - quarter / 12.0)
        sine_ratio = 0.5 * (1.0 - quarter / 6.0 * (1.0 - quarter / 20.0))
    else:
        angle = math.sqrt(squared)
        cosine = math.cos(angle / 2.0)
        sine_ratio = math.sin(angle / 2.0) / angle
    out[0] = cosine
    for i in range(3):
        out[1 + i] = sine_ratio * phi[i]


@compiled
def turn_back(phi: Floats, by: Floats, work: Floats) -> None:
    """Undo the turn `by` before that of `phi`, both rotation vectors, rad; in place.

    `work` is scratch, shape (3, 4).
    """
    quaternion_of_vector(work[1], phi)
    quaternion_of_vector(work[2], by)
    for i in range(3):
        work[2, 1 + i] = -work[2, 1 + i]
    multiply(work[0], work[1], work[2])
    sine = math.sqrt(work[0, 1] ** 2 + work[0, 2] ** 2 + work[0, 3] ** 2)
    ratio = 2.0
    if sine > _SERIES_BELOW:
        ratio = 2.0 * math.atan2(sine, work[0, 0]) / sine
    for i in range(3):
        phi[i] = ratio * work[0, 1 + i]


@compiled
def multiply(out: Floats, p: Floats, q: Floats) -> None:
    """Write the quaternion product ``p q`` to `out`, distinct from both."""
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]


@compiled
def normalise(q: Floats) -> None:
    """Normalise a quaternion of nearly unit length, in place."""
    squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]  # Python rounds `**2` otherwise
    scale = 1.0 / math.sqrt(squared)
    for i in range(4):
        q[i] *= scale


@compiled
def matrix_of_quaternion(C: Floats, q: Floats) -> None:
    """Write the direction cosine matrix, shape (3, 3), of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    C[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    C[0, 1] = 2.0 * (x * y - w * z)
    C[0, 2] = 2.0 * (x * z + w * y)
    C[1, 0] = 2.0 * (x * y + w * z)
    C[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    C[1, 2] = 2.0 * (y * z - w * x)
    C[2, 0] = 2.0 * (x * z - w * y)
    C[2, 1] = 2.0 * (y * z + w * x)
    C[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@compiled
def quaternion_of_matrix(q: Floats, C: Floats) -> None:
    """Write the unit quaternion of a direction cosine matrix (Shepperd's method)."""
    trace = C[0, 0] + C[1, 1] + C[2, 2]
    k = -1
    largest = trace
    for i in range(3):
        if C[i, i] > largest:
            k, largest = i, C[i, i]
    if k < 0:
        q[0] = math.sqrt(1.0 + trace) / 2.0
        scale = 0.25 / q[0]
        q[1] = (C[2, 1] - C[1, 2]) * scale
        q[2] = (C[0, 2] - C[2, 0]) * scale
        q[3] = (C[1, 0] - C[0, 1]) * scale
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        q[1 + k] = math.sqrt(1.0 + 2.0 * C[k, k] - trace) / 2.0
        scale = 0.25 / q[1 + k]
        q[0] = (C[j, i] - C[i, j]) * scale
        q[1 + i] = (C[i, k] + C[k, i]) * scale
        q[1 + j] = (C[j, k] + C[k, j]) * scale
    normalise(q)


@compiled
def gimbal_matrix(C_s_b: Floats, inner: float, outer: float) -> None:
    """Write ``C_s_b = Rx(outer) Rz(inner)`` for the axes' angles in rad. Paper, (22)."""
    _set_gimbals(C_s_b, math.cos(inner), math.sin(inner), math.cos(outer), math.sin(outer))


@compiled
def turn_gimbals(C_s_b: Floats, axis: Records[Angle], inner: float, outer: float) -> None:
    """Write `gimbal_matrix`; `axis` are the two axes where they were."""
    turn_to(axis[0], inner)
    turn_to(axis[1], outer)
    _set_gimbals(C_s_b, axis[0].cosine, axis[0].sine, axis[1].cosine, axis[1].sine)


@compiled
def _set_gimbals(C_s_b: Floats, ci: float, si: float, co: float, so: float) -> None:
    C_s_b[0, 0], C_s_b[0, 1], C_s_b[0, 2] = ci, -si, 0.0
    C_s_b[1, 0], C_s_b[1, 1], C_s_b[1, 2] = co * si, co * ci, -so
    C_s_b[2, 0], C_s_b[2, 1], C_s_b[2, 2] = so * si, so * ci, co


@compiled
def matrix_of_euler(C_b_n: Floats, roll: float, pitch: float, heading: float) -> None:
    """Write ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)`` for angles in rad."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    ch, sh = math.cos(heading), math.sin(heading)
    C_b_n[0, 0], C_b_n[0, 1], C_b_n[0, 2] = ch * cr + sh * sp * sr, sh * cp, ch * sr - sh * sp * cr
    C_b_n[1, 0], C_b_n[1, 1], C_b_n[1, 2] = (
        -sh * cr + ch * sp * sr,
        ch * cp,
        -sh * sr - ch * sp * cr,
    )
    C_b_n[2, 0], C_b_n[2, 1], C_b_n[2, 2] = -cp * sr, sp, cp * cr


@compiled
def euler_of_matrix(C_b_n: Floats) -> tuple[float, float, float]:
    """Return (roll, pitch, heading) in rad; heading in [0, 2π)."""
    roll = math.atan2(-C_b_n[2, 0], C_b_n[2, 2])
    pitch = math.asin(min(1.0, max(-1.0, C_b_n[2, 1])))
    heading = math.atan2(C_b_n[0, 1], C_b_n[1, 1])
    if heading < 0.0:
        heading += 2.0 * math.pi
        if heading >= 2.0 * math.pi:  # a heading just below zero rounds up to a full turn
            heading = 0.0
    return roll, pitch, heading


@compiled
def multiply_transposed(out: Floats, A: Floats, B: Floats) -> None:
    """Write ``A @ B.T``, shapes (3, 3), to `out`, distinct from both."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[j, 0] + A[i, 1] * B[j, 1] + A[i, 2] * B[j, 2]
