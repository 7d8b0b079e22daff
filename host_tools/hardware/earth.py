"""The Earth of the truth: rotation and normal gravity of WGS-84.

References
----------
Moritz, "Geodetic Reference System 1980", *Journal of Geodesy* 74 (2000), for the closed form of
normal gravity and its expansion in height; NIMA TR8350.2 (3rd ed., 2000), table 3.4, for the
numbers.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

ROTATION_RATE = 7.292115e-5  # rad/s
EQUATORIAL_RADIUS = 6378137.0  # m
POLAR_RADIUS = 6356752.3142451795  # m
GRAVITY_EQUATOR = 9.7803253359  # m/s²
GRAVITY_POLE = 9.8321849378636  # m/s²
GM = 3.986004418e14  # m³/s²


def normal_gravity(latitude: float, height: float) -> float:
    """Return normal gravity, m/s², at a geodetic latitude (rad) and ellipsoidal height (m)."""
    a, b = EQUATORIAL_RADIUS, POLAR_RADIUS
    c2, s2 = math.cos(latitude) ** 2, math.sin(latitude) ** 2
    on_ellipsoid = (a * GRAVITY_EQUATOR * c2 + b * GRAVITY_POLE * s2) / math.sqrt(
        a * a * c2 + b * b * s2
    )
    flattening = (a - b) / a
    m = ROTATION_RATE**2 * a * a * b / GM
    return on_ellipsoid * (
        1 - 2 * (1 + flattening + m - 2 * flattening * s2) * height / a + 3 * (height / a) ** 2
    )


def rotation_n(latitude: float) -> NDArray[np.float64]:
    """Return the Earth's angular rate in east-north-up, shape (3,), rad/s."""
    return np.array([0.0, ROTATION_RATE * math.cos(latitude), ROTATION_RATE * math.sin(latitude)])
