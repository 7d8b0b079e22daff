"""Increments of the body from those of the turning sensors: for navigators that know no table.

Over an epoch the body turns by ``q_s_b(begin) q(φ_s) q_s_b(end)*``, φ_s the rotation vector of the
sensors and q_s_b the table by its encoders; its velocity changes, in the body's axes at the epoch's
beginning, by ``C_s_b(begin) Δv_s``. The increments written are those for which a navigator's own
corrections (coning, rotation and sculling for rates linear in time; Savage, "Strapdown Inertial
Navigation Integration Algorithm Design", 1998) give just these: what gyros and accelerometers fixed
in the body would have given.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Bool, Floats, Record, Records
from rrins.firmware_py.core.maths.attitude import (
    cross,
    gimbal_matrix,
    multiply,
    quaternion_of_matrix,
    quaternion_of_vector,
    rotate,
)
from rrins.firmware_py.core.navigation.strapdown import rotation_vector, velocity_in_start_frame
from rrins.firmware_py.core.records.memory import Ins
from rrins.host_tools.vehicle.fused import FusedIncrements

_ITERATIONS = 4  # each leaves dtheta² / 6 of the error before, less than 1e-4
_SMALL = 1e-8  # rad, half of the angle: sine and angle are the same to rounding


class _Derotation(Record):
    """State carried from epoch to epoch."""

    begun: Bool  #: whether there is an epoch before
    C_s_b: Annotated[Floats, (3, 3)]  #: of the table at the end of the epoch before
    q_s_b: Annotated[Floats, 4]  #: the same
    C_s_b_now: Annotated[Floats, (3, 3)]  #: at the end of this epoch
    q_b_s_now: Annotated[Floats, 4]  #: the inverse of the same
    dtheta_b: Annotated[Floats, 3]  #: rad, of the epoch before
    dv_b: Annotated[Floats, 3]  #: m/s, of the epoch before
    work: Annotated[Floats, (6, 3)]  #: scratch
    work_q: Annotated[Floats, (2, 4)]  #: scratch


@compiled
def _vector_of_quaternion(out: Floats, q: Floats) -> None:
    """Write the rotation vector of a quaternion, of either sign, shorter than a half turn."""
    sine, cosine = math.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2), abs(q[0])
    ratio = 2.0 / cosine if sine < _SMALL else 2.0 * math.atan2(sine, cosine) / sine
    ratio = math.copysign(ratio, q[0])
    for i in range(3):
        out[i] = ratio * q[1 + i]


@compiled
def _solve(out: Floats, a: Floats, y: Floats) -> None:
    """Write the x of ``x + a x x = y`` (the second a vector product) to `out`."""
    cross(out, a, y)
    along = a[0] * y[0] + a[1] * y[1] + a[2] * y[2]
    scale = 1.0 + a[0] ** 2 + a[1] ** 2 + a[2] ** 2
    for i in range(3):
        out[i] = (y[i] - out[i] + a[i] * along) / scale


@compiled
def _turn(memory: _Derotation, phi_s: Floats, phi_b: Floats) -> None:
    """Write the rotation vector of the body in the epoch."""
    turn, product = memory.work_q[0], memory.work_q[1]
    quaternion_of_vector(turn, phi_s)
    multiply(product, memory.q_s_b, turn)
    multiply(turn, product, memory.q_b_s_now)
    _vector_of_quaternion(phi_b, turn)


@compiled
def _invert(
    memory: _Derotation, phi_b: Floats, dv_start_b: Floats, dtheta: Floats, dv: Floats
) -> None:
    """Write the increments whose corrections give a rotation vector and a velocity change."""
    a, y, twice = memory.work[3], memory.work[4], memory.work[5]
    for i in range(3):
        a[i] = memory.dtheta_b[i] / 12.0
    _solve(dtheta, a, phi_b)
    cross(y, memory.dv_b, dtheta)
    for i in range(3):
        dv_start_b[i] -= y[i] / 12.0
        a[i] += dtheta[i] / 2.0
        dv[i] = dv_start_b[i]
    for _ in range(_ITERATIONS):
        cross(y, dtheta, dv)
        cross(twice, dtheta, y)
        for i in range(3):
            y[i] = dv_start_b[i] - twice[i] / 6.0
        _solve(dv, a, y)


@compiled
def _derotate(
    memory: _Derotation, ins: Ins, row: FusedIncrements, dtheta_b: Floats, dv_b: Floats
) -> None:
    gimbal_matrix(memory.C_s_b_now, math.radians(row.inner_deg), math.radians(row.outer_deg))
    quaternion_of_matrix(memory.q_b_s_now, memory.C_s_b_now)
    for i in range(1, 4):
        memory.q_b_s_now[i] = -memory.q_b_s_now[i]
    if memory.begun:
        phi_s, dv_start_s, phi_b = memory.work[0], memory.work[1], memory.work[2]
        rotation_vector(phi_s, row.dtheta_s, ins.dtheta_s_previous)
        velocity_in_start_frame(ins, dv_start_s, row.dtheta_s, row.dv_s)
        _turn(memory, phi_s, phi_b)
        rotate(phi_s, memory.C_s_b, dv_start_s)
        _invert(memory, phi_b, phi_s, dtheta_b, dv_b)
    else:  # the sample before navigation: at rest
        rotate(dtheta_b, memory.C_s_b_now, row.dtheta_s)
        rotate(dv_b, memory.C_s_b_now, row.dv_s)
    memory.begun = True
    memory.q_s_b[0] = memory.q_b_s_now[0]
    for i in range(3):
        memory.q_s_b[1 + i] = -memory.q_b_s_now[1 + i]
        memory.dtheta_b[i], memory.dv_b[i] = dtheta_b[i], dv_b[i]
        ins.dtheta_s_previous[i], ins.dv_s_previous[i] = row.dtheta_s[i], row.dv_s[i]
        for j in range(3):
            memory.C_s_b[i, j] = memory.C_s_b_now[i, j]


@compiled
def _derotate_all(
    memories: Records[_Derotation],
    scratch: Records[Ins],
    rows: Records[FusedIncrements],
    dtheta_b: Floats,
    dv_b: Floats,
) -> None:
    for k in range(len(rows)):
        _derotate(memories[0], scratch[0], rows[k], dtheta_b[k], dv_b[k])


class Derotator:
    """Turns the increments of the sensors into those of the body, piece by piece of a run."""

    def __init__(self) -> None:
        self._memory = _Derotation.zeros()
        self._ins = Ins.zeros()

    def of_body(self, rows: Records[FusedIncrements]) -> tuple[Floats, Floats]:
        """Return angle (rad) and velocity (m/s) increments of the body, shape (n, 3) each.

        The rows continue those of the call before. The very first is taken as at rest.
        """
        dtheta_b, dv_b = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
        _derotate_all(self._memory, self._ins, rows, dtheta_b, dv_b)
        return dtheta_b, dv_b
