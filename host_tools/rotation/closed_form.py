"""Integrals of every sensor error over a leg, by antiderivatives.

The paper's integrands are: bias (26), (27); gyro MESSF (29), (30), MEASF (32), (33), MEIE (34);
accelerometer MESSF (37), (38), MEASF (40), (41). The paper states the inner turn at an outer angle
of 0 and the outer turn at an inner angle of 0. Any other angle of the stationary axis is a constant
rotation: with ``a`` denoting h, the axis error or the projection,

    inner turn, θ = αI:   Rx(αO) [a_x cos θ - a_y sin θ,  a_x sin θ + a_y cos θ,  a_z]
    outer turn, θ = αO:   [ã_x,  ã_y cos θ - ã_z sin θ,  ã_y sin θ + ã_z cos θ],   ã = Rz(αI) a

so each integrand is a product of two harmonics in θ, and MEASF one between each two zeros of h x.
"""

from __future__ import annotations

from itertools import pairwise
from types import MappingProxyType
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.rotation import harmonics
from rrins.host_tools.rotation.errors import BIAS, ERRORS, MEASF, MEIE, MESSF, Sensors, error_rates
from rrins.host_tools.rotation.kinematics import INNER, Leg, attitude, rotation_x, rotation_z

EQUATIONS: Final = MappingProxyType(
    {
        ("gyro", "bias"): "(26), (27)",
        ("gyro", "MESSF"): "(29), (30)",
        ("gyro", "MEASF"): "(32), (33)",
        ("gyro", "MEIE"): "(34)",
        ("accelerometer", "bias"): "(26), (27)",
        ("accelerometer", "MESSF"): "(37), (38)",
        ("accelerometer", "MEASF"): "(40), (41)",
        ("accelerometer", "MEIE"): "(35)",
    }
)
"""Equation numbers of the integrands in the paper."""


def cycle_integral(legs: tuple[Leg, ...], sensors: Sensors, field_b: Floats) -> Floats:
    """Return the integral of each error over legs, shape (m, 4, 3), rad or m/s.

    Parameters
    ----------
    legs : Leg
    sensors : Sensors
    field_b : array, shape (3,)
        Input apart from the rotation, constant in the body frame: specific force in m/s² for
        accelerometers; for gyros the Earth's rate in rad/s, or zeros as in the paper.
    """
    total = np.zeros((len(sensors), len(ERRORS), 3))
    for leg in legs:
        total += leg_integral(leg, sensors, field_b)
    return total


def leg_integral(leg: Leg, sensors: Sensors, field_b: Floats) -> Floats:
    """Return the integral of each error over one leg, shape (m, 4, 3), rad or m/s."""
    if leg.axis is None:
        C_s_b = attitude(*leg.start_deg)[None]
        standing: Floats = error_rates(sensors, C_s_b, field_b @ C_s_b)[0] * leg.duration_s
        return standing
    return np.array([_turning(leg, sensors, i, field_b) for i in range(len(sensors))])


def _turning(leg: Leg, sensors: Sensors, i: int, field_b: Floats) -> Floats:
    assert leg.axis is not None
    start, end = leg.start_deg[leg.axis], leg.end_deg[leg.axis]
    felt = _felt(leg, sensors.H[i], sensors, field_b)
    projected = _projected(leg, sensors.projection[i])

    def over(f: Floats, low: float, high: float) -> Floats:
        """Integrate over time: dt = dθ / rate."""
        return harmonics.product_integral(f, projected, low, high) / leg.rate

    result = np.empty((len(ERRORS), 3))
    result[BIAS] = over(np.array([sensors.bias[i], 0.0, 0.0]), start, end)
    result[MESSF] = sensors.scale_error[i] * over(felt, start, end)
    result[MEIE] = over(_felt(leg, sensors.axis_error[i], sensors, field_b), start, end)
    bounds = [start, *harmonics.zeros(felt, start, end)[:: 1 if end > start else -1], end]
    result[MEASF] = sensors.asymmetric_scale_error[i] * sum(
        np.sign(harmonics.value(felt, (low + high) / 2)) * over(felt, low, high)
        for low, high in pairwise(bounds)
    )
    return result


def _harmonic(leg: Leg, a: Floats) -> Floats:
    """Return the components of the rotating ``a``, apart from Rx(αO): (3 terms, 3 axes)."""
    if leg.axis == INNER:
        return np.array([[0.0, 0.0, a[2]], [a[0], a[1], 0.0], [-a[1], a[0], 0.0]])
    x, y, z = rotation_z(leg.start_deg[0]) @ a
    return np.array([[x, 0.0, 0.0], [0.0, y, z], [0.0, -z, y]])


def _projected(leg: Leg, projection: Floats) -> Floats:
    """Return ``C_s_b`` times the projection in harmonics of the turning angle, shape (3, 3)."""
    harmonic = _harmonic(leg, projection)
    if leg.axis == INNER:
        harmonic = harmonic @ rotation_x(leg.start_deg[1]).T
    return harmonic


def _felt(leg: Leg, a: Floats, sensors: Sensors, field_b: Floats) -> Floats:
    """Return the input along an axis ``a`` in harmonics of the turning angle, shape (3,)."""
    felt: Floats = _projected(leg, a) @ field_b
    if sensors.kind == "gyro":
        # Its component along the turning axis, which the rotation leaves unchanged.
        felt[0] += _harmonic(leg, a)[0, 2 if leg.axis == INNER else 0] * leg.rate
    return felt
