"""Functions ``f(θ) = f0 + f1 cos θ + f2 sin θ``: their zeros, and integrals of their products.

While one axis turns, every sensor input has this form in the angle of that axis, and so does the
projection of the sensor's error into the body frame.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.rotation.kinematics import cos_sin

_FLAT = 1e-14
"""An amplitude below this share of the largest coefficient counts as rounding error."""


def value(f: Floats, angle_deg: float) -> float:
    """Return f at an angle in degrees; `f` has shape (3,)."""
    cosine, sine = cos_sin(angle_deg)
    return float(f[0] + f[1] * cosine + f[2] * sine)


def zeros(f: Floats, start_deg: float, end_deg: float) -> list[float]:
    """Return the angles strictly between two angles at which f changes sign, ascending, deg."""
    amplitude = math.hypot(f[1], f[2])
    largest = float(np.max(np.abs(f)))
    if amplitude <= _FLAT * largest or abs(f[0]) >= amplitude:
        return []
    middle = math.degrees(math.atan2(f[2], f[1]))
    aside = math.degrees(math.acos(-f[0] / amplitude))
    low, high = sorted((start_deg, end_deg))
    found = []
    for root in (middle - aside, middle + aside):
        first = root + 360.0 * math.ceil((low - root) / 360.0)
        found += [angle for angle in np.arange(first, high, 360.0) if low < angle < high]
    return sorted(float(angle) for angle in found)


def _products(start_deg: float, end_deg: float) -> Floats:
    """Return the integrals over θ (rad) of the products of (1, cos θ, sin θ), shape (3, 3)."""
    (cosine_1, sine_1), (cosine_2, sine_2) = cos_sin(start_deg), cos_sin(end_deg)
    angle = math.radians(end_deg - start_deg)
    of_cosine = sine_2 - sine_1
    of_sine = cosine_1 - cosine_2
    double = (sine_2 * cosine_2 - sine_1 * cosine_1) / 2
    of_both = (sine_2**2 - sine_1**2) / 2
    return np.array(
        [
            [angle, of_cosine, of_sine],
            [of_cosine, angle / 2 + double, of_both],
            [of_sine, of_both, angle / 2 - double],
        ]
    )


def product_integral(f: Floats, p: Floats, start_deg: float, end_deg: float) -> Floats:
    """Return the integral over θ (rad) of f times each function p.

    Parameters
    ----------
    f : array, shape (3,)
    p : array, shape (3, n)
        Coefficients of n functions, one in each column.
    start_deg, end_deg : float

    Returns
    -------
    array, shape (n,)
    """
    integral: Floats = f @ _products(start_deg, end_deg) @ p
    return integral
