"""Increments that an ideal RIMU feels on the turning table.

With the vehicle at rest, ω_ib^b and f^b are constant, and only the table's angles change::

    Δθ^s = ∫ [C_b^s ω_ib^b + Rz(-αI) x αO' + z αI'] dt,      Δv^s = ∫ C_b^s f^b dt

The angles are quadratic in time within an epoch (`host_tools.hardware.turntable`). Four-point
Gauss-Legendre integration leaves out less than 1e-17 of the increments up to 0.1 rad per epoch,
that is: nothing but rounding.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from host_tools.hardware.memory import INNER, OUTER

# Abramowitz and Stegun, table 25.4, n = 4, moved to [0, 1].
_NODES = (
    0.5 - 0.430568155797026287612,
    0.5 - 0.169990521792428132401,
    0.5 + 0.169990521792428132401,
    0.5 + 0.430568155797026287612,
)
_WEIGHTS = (
    0.173927422568726928687,
    0.326072577431273071313,
    0.326072577431273071313,
    0.173927422568726928687,
)


@njit(cache=True)
def _add_turned(plant: Any, inner: float, outer: float, weight: float) -> None:
    """Add `weight` times ω_ib and f, turned into the sensor frame, to the increments."""
    ci, si = math.cos(inner), math.sin(inner)
    co, so = math.cos(outer), math.sin(outer)
    w, f = plant.omega_ib_b, plant.specific_force_b
    # Rx(-outer), then Rz(-inner)
    wy, wz = co * w[1] + so * w[2], co * w[2] - so * w[1]
    fy, fz = co * f[1] + so * f[2], co * f[2] - so * f[1]
    plant.dtheta_s[0] += weight * (ci * w[0] + si * wy)
    plant.dtheta_s[1] += weight * (ci * wy - si * w[0])
    plant.dtheta_s[2] += weight * wz
    plant.dv_s[0] += weight * (ci * f[0] + si * fy)
    plant.dv_s[1] += weight * (ci * fy - si * f[0])
    plant.dv_s[2] += weight * fz


@njit(cache=True)
def integrate(plant: Any, dt: float) -> None:
    """Write `dtheta_s` (rad) and `dv_s` (m/s) of the epoch that the axes have just moved over."""
    inner, outer = plant.axis[INNER], plant.axis[OUTER]
    at_rest = (
        inner.rate == 0.0
        and inner.rate_before == 0.0
        and outer.rate == 0.0
        and outer.rate_before == 0.0
    )
    if at_rest and plant.held:
        return
    plant.held = at_rest
    for i in range(3):
        plant.dtheta_s[i] = 0.0
        plant.dv_s[i] = 0.0
    if at_rest:
        _add_turned(plant, inner.angle, outer.angle, dt)
        return
    for t, share in zip(_NODES, _WEIGHTS):  # noqa: B905 - the compiler has no `strict`
        inner_angle = inner.angle_before + dt * t * (
            inner.rate_before + 0.5 * t * (inner.rate - inner.rate_before)
        )
        outer_angle = outer.angle_before + dt * t * (
            outer.rate_before + 0.5 * t * (outer.rate - outer.rate_before)
        )
        _add_turned(plant, inner_angle, outer_angle, share * dt)
        outer_turn = share * dt * (outer.rate_before + t * (outer.rate - outer.rate_before))
        plant.dtheta_s[0] += outer_turn * math.cos(inner_angle)
        plant.dtheta_s[1] -= outer_turn * math.sin(inner_angle)
    plant.dtheta_s[2] += inner.angle - inner.angle_before
