"""Increments that an ideal RIMU senses on the turning table of a moving vehicle.

::

    Δθ^s = ∫ [C_b^s ω_ib^b + Rz(-αI) Eᵀ x αO' + (z + ...) αI'] dt,      Δv^s = ∫ C_b^s f^b dt

with ``C_s_b = Rx(αO) E(αI) Rz(αI)``; E, the tilt and wobble of the inner axis, is the identity for
a true table. Within an epoch an axis' angle is the cubic through the angles and rates at its ends,
ω_ib^b and f^b are polynomials (`rrins.host_tools.hardware.motion`) or constant. Gauss-Legendre
integration of two points for a vehicle at rest and slow turns, else of four, leaves out less than
2e-16 of the increments.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.host_tools.hardware import motion, size_effect
from rrins.host_tools.hardware.memory import INNER, OUTER, Plant, TableErrors, TurntableAxis

# Abramowitz and Stegun, table 25.4, n = 2 and 4, moved to [0, 1].
_NODES_2 = (0.5 - 0.288675134594812882255, 0.5 + 0.288675134594812882255)
_WEIGHTS_2 = (0.5, 0.5)
_NODES_4 = (
    0.5 - 0.430568155797026287612,
    0.5 - 0.169990521792428132401,
    0.5 + 0.169990521792428132401,
    0.5 + 0.430568155797026287612,
)
_WEIGHTS_4 = (
    0.173927422568726928687,
    0.326072577431273071313,
    0.326072577431273071313,
    0.173927422568726928687,
)
# Two points leave out (turn⁴ + 3 (change of turn)²) / 4320 of a vector turned in an epoch, rad.
_SLOW_TURN = 1e-3
_SLOW_CHANGE = 1e-7


@compiled
def _angle_at(axis: TurntableAxis, t: float, dt: float) -> float:
    """Return an axis' angle at `t` in [0, 1] of the epoch: the cubic through its ends."""
    moved = axis.angle - axis.angle_before
    before, after = axis.rate_before * dt, axis.rate * dt
    square, cube = 3.0 * moved - 2.0 * before - after, before + after - 2.0 * moved
    return axis.angle_before + t * (before + t * (square + t * cube))


@compiled
def _face(plant: Plant, inner: float, outer: float) -> None:
    """Have cosine and sine of the axes' angles at hand; an axis that rests keeps those it has."""
    for index in (INNER, OUTER):
        axis = plant.axis[index]
        angle = inner if index == INNER else outer
        if angle != axis.trig_angle or axis.cosine == 0.0:  # which no cosine of a number is
            axis.trig_angle = angle
            axis.cosine, axis.sine = math.cos(angle), math.sin(angle)


@compiled
def _turned_at(axis: TurntableAxis, t: float, dt: float) -> float:
    """Return an axis' rate at `t` in [0, 1], in rad per epoch."""
    moved = axis.angle - axis.angle_before
    before, after = axis.rate_before * dt, axis.rate * dt
    square, cube = 3.0 * moved - 2.0 * before - after, before + after - 2.0 * moved
    return before + t * (2.0 * square + 3.0 * t * cube)


@compiled
def _tilt(table: TableErrors, inner: float) -> tuple[float, float, float, float]:
    """Return the inner axis' small rotation about x and y, and its derivative by the angle."""
    n = table.wobble_per_turn
    cosine, sine = table.wobble * math.cos(n * inner), table.wobble * math.sin(n * inner)
    return cosine, table.non_orthogonality + sine, -n * sine, n * cosine


@compiled
def _tilted(ex: float, ey: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return ``Eᵀ v``, E the rotation by the vector (ex, ey, 0), to second order."""
    cx, cy, cz = ey * z, -ex * z, ex * y - ey * x  # e x v
    return (
        x - cx + 0.5 * ey * cz,
        y - cy - 0.5 * ex * cz,
        z - cz + 0.5 * (ex * cy - ey * cx),
    )


@compiled
def _add_run_out(plant: Plant, dt: float) -> None:
    """Add the lever-arm effect of sensors off the axes: centripetal and tangential."""
    inner, outer = plant.axis[INNER], plant.axis[OUTER]
    if inner.run_out != 0.0:
        mean_square = (inner.rate**2 + inner.rate * inner.rate_before + inner.rate_before**2) / 3.0
        plant.dv_s[0] -= inner.run_out * mean_square * dt
        plant.dv_s[1] += inner.run_out * (inner.rate - inner.rate_before)
    if outer.run_out != 0.0:
        mean_square = (outer.rate**2 + outer.rate * outer.rate_before + outer.rate_before**2) / 3.0
        radial = -outer.run_out * mean_square * dt  # along y of the gimbal
        angle = _angle_at(inner, 0.5, dt)
        plant.dv_s[0] += math.sin(angle) * radial
        plant.dv_s[1] += math.cos(angle) * radial
        plant.dv_s[2] += outer.run_out * (outer.rate - outer.rate_before)


@compiled
def _rate_at_end(plant: Plant, dt: float) -> tuple[float, float, float]:
    """Return the rate of the sensor frame at the end of the epoch, rad/s."""
    inner, outer = plant.axis[INNER], plant.axis[OUTER]
    _face(plant, inner.angle, outer.angle)
    x, y, z = _turned(plant, 1.0, 1.0, dt)
    return x / dt, y / dt, z / dt + inner.rate


@compiled
def _turned(plant: Plant, t: float, share: float, dt: float) -> tuple[float, float, float]:
    """Return what the sensor frame turns in `share` of the epoch, with the axes as they face.

    rad, all but the inner axis' own turn about z.
    """
    inner, outer = plant.axis[INNER], plant.axis[OUTER]
    ci, si, co, so = inner.cosine, inner.sine, outer.cosine, outer.sine
    w = plant.omega_ib_b
    weight = share * dt
    # Rx(-outer), then Eᵀ, then Rz(-inner)
    wx = weight * w[0] + share * _turned_at(outer, t, dt)
    wy, wz = weight * (co * w[1] + so * w[2]), weight * (co * w[2] - so * w[1])
    if plant.table.is_crooked:
        ex, ey, dx, dy = _tilt(plant.table, inner.trig_angle)
        wx, wy, wz = _tilted(ex, ey, wx, wy, wz)
        # E's own turning, e' - e x e' / 2 per inner angle
        inner_turn = share * _turned_at(inner, t, dt)
        wx += dx * inner_turn
        wy += dy * inner_turn
        wz -= 0.5 * (ex * dy - ey * dx) * inner_turn
    return ci * wx + si * wy, ci * wy - si * wx, wz


@compiled
def _add_at(plant: Plant, inner: float, outer: float, t: float, share: float, dt: float) -> None:
    """Add `share` of the epoch, with the axes at these angles, to the increments.

    All but the inner axis' own turn about z.
    """
    _face(plant, inner, outer)
    x, y, z = _turned(plant, t, share, dt)
    plant.dtheta_s[0] += x
    plant.dtheta_s[1] += y
    plant.dtheta_s[2] += z
    if plant.accelerometers.displaced:
        part = share * dt
        z += share * _turned_at(plant.axis[INNER], t, dt)
        size_effect.add(plant, x / part, y / part, z / part, part)
    ci, si = plant.axis[INNER].cosine, plant.axis[INNER].sine
    co, so = plant.axis[OUTER].cosine, plant.axis[OUTER].sine
    f = plant.specific_force_b
    weight = share * dt
    fx, fy, fz = weight * f[0], weight * (co * f[1] + so * f[2]), weight * (co * f[2] - so * f[1])
    if plant.table.is_crooked:
        ex, ey, _, _ = _tilt(plant.table, inner)
        fx, fy, fz = _tilted(ex, ey, fx, fy, fz)
    plant.dv_s[0] += ci * fx + si * fy
    plant.dv_s[1] += ci * fy - si * fx
    plant.dv_s[2] += fz


@compiled
def _add_resting(plant: Plant, dt: float) -> None:
    """Add an epoch in which neither the axes nor the vehicle moves."""
    _add_at(plant, plant.axis[INNER].angle, plant.axis[OUTER].angle, 0.0, 1.0, dt)


@compiled
def _add_turning(
    plant: Plant, nodes: tuple[float, ...], weights: tuple[float, ...], dt: float
) -> None:
    """Add an epoch in which the axes turn and the vehicle rests."""
    for k in range(len(nodes)):
        inner = _angle_at(plant.axis[INNER], nodes[k], dt)
        outer = _angle_at(plant.axis[OUTER], nodes[k], dt)
        _add_at(plant, inner, outer, nodes[k], weights[k], dt)


@compiled
def _add_moving(plant: Plant, piece: Floats, begin: float, dt: float) -> None:
    """Add an epoch in which the vehicle moves, from `begin` in its piece."""
    for k in range(4):
        t = _NODES_4[k]
        u = begin + t / plant.piece_epochs
        for i in range(3):
            plant.omega_ib_b[i] = motion.value(piece, motion.RATE + i, u)
            plant.specific_force_b[i] = motion.value(piece, motion.FORCE + i, u)
        inner = _angle_at(plant.axis[INNER], t, dt)
        outer = _angle_at(plant.axis[OUTER], t, dt)
        _add_at(plant, inner, outer, t, _WEIGHTS_4[k], dt)
    if plant.accelerometers.displaced:
        for i in range(3):
            u = begin + 1.0 / plant.piece_epochs
            plant.omega_ib_b[i] = motion.value(piece, motion.RATE + i, u)


@compiled
def _is_slow(axis: TurntableAxis, dt: float) -> bool:
    """Return whether two points are enough for the epoch's turn of an axis."""
    change = abs(axis.rate - axis.rate_before) * dt
    return abs(axis.angle - axis.angle_before) < _SLOW_TURN and change < _SLOW_CHANGE


@compiled
def integrate(plant: Plant, pieces: Floats, dt: float) -> None:
    """Write `dtheta_s` (rad) and `dv_s` (m/s) of the epoch that the axes have just moved over.

    `pieces` is the vehicle's motion, shape (n, 15, 8), n at least 1; `plant.piece_count` of them
    count, none for a vehicle at rest.
    """
    inner, outer = plant.axis[INNER], plant.axis[OUTER]
    axes_rest = (
        inner.rate == 0.0
        and inner.rate_before == 0.0
        and outer.rate == 0.0
        and outer.rate_before == 0.0
    )
    index = motion.piece_of(plant, plant.epoch)
    displaced = plant.accelerometers.displaced
    if axes_rest and index < 0 and plant.held:
        if displaced:
            size_effect.rest(plant)
        return
    if index < 0 and plant.piece_count > 0 and plant.epoch > plant.motion_start:
        motion.set_rest(plant, pieces[plant.piece_count - 1], 1.0)
    plant.held = axes_rest and index < 0
    for i in range(3):
        plant.dtheta_s[i] = 0.0
        plant.dv_s[i] = 0.0
    if displaced:
        size_effect.begin(plant)
    if index >= 0:
        _add_moving(plant, pieces[index], motion.begin_of(plant, plant.epoch), dt)
    elif plant.held:
        _add_resting(plant, dt)
    elif _is_slow(inner, dt) and _is_slow(outer, dt):
        _add_turning(plant, _NODES_2, _WEIGHTS_2, dt)
    else:
        _add_turning(plant, _NODES_4, _WEIGHTS_4, dt)
    plant.dtheta_s[2] += inner.angle - inner.angle_before
    _add_run_out(plant, dt)
    if displaced:
        x, y, z = _rate_at_end(plant, dt)
        size_effect.end(plant, x, y, z)
