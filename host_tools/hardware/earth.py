"""The Earth of the truth: rotation, curvature and normal gravity of WGS-84.

Latitudes and heights are numbers or arrays of one shape; results have that shape.

References
----------
Moritz, "Geodetic Reference System 1980", *Journal of Geodesy* 74 (2000), for the closed form of
normal gravity and its expansion in height; NIMA TR8350.2 (3rd ed., 2000), table 3.4, for the
numbers; Torge, *Geodesy* (4th ed., 2012), section 4.1.1, for the radii of curvature.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled

ROTATION_RATE = 7.292115e-5  # rad/s
EQUATORIAL_RADIUS = 6378137.0  # m
POLAR_RADIUS = 6356752.3142451795  # m
GRAVITY_EQUATOR = 9.7803253359  # m/s²
GRAVITY_POLE = 9.8321849378636  # m/s²
GM = 3.986004418e14  # m³/s²

_Real = TypeVar("_Real", float, NDArray[np.float64])


def _squared_norm(latitude: _Real) -> _Real:
    """Return a² cos² + b² sin² of the latitude, m²."""
    a, b = EQUATORIAL_RADIUS, POLAR_RADIUS
    return (a * np.cos(latitude)) ** 2 + (b * np.sin(latitude)) ** 2


def curvature_radii(latitude: _Real) -> tuple[_Real, _Real]:
    """Return the radii of curvature, m, in the meridian and in the prime vertical."""
    a, b = EQUATORIAL_RADIUS, POLAR_RADIUS
    norm = np.sqrt(_squared_norm(latitude))
    return (a * b) ** 2 / norm**3, a * a / norm


@compiled
def metres_per_rad(latitude: float, height: float) -> tuple[float, float]:
    """Return the way north and the way east, m, of a rad of latitude and of longitude."""
    a, b = EQUATORIAL_RADIUS, POLAR_RADIUS
    norm = math.hypot(a * math.cos(latitude), b * math.sin(latitude))
    meridian, prime_vertical = (a * b) ** 2 / norm**3, a * a / norm
    return meridian + height, (prime_vertical + height) * math.cos(latitude)


def curvature_slopes(latitude: _Real) -> tuple[_Real, _Real]:
    """Return the derivatives of both radii of curvature with respect to latitude, m/rad."""
    a, b = EQUATORIAL_RADIUS, POLAR_RADIUS
    norm = np.sqrt(_squared_norm(latitude))
    rise = (a * a - b * b) * np.sin(latitude) * np.cos(latitude)
    return 3 * (a * b) ** 2 * rise / norm**5, a * a * rise / norm**3


def normal_gravity(latitude: _Real, height: _Real) -> _Real:
    """Return normal gravity, m/s², at a geodetic latitude (rad) and ellipsoidal height (m)."""
    a, b = EQUATORIAL_RADIUS, POLAR_RADIUS
    c2, s2 = np.cos(latitude) ** 2, np.sin(latitude) ** 2
    on_ellipsoid = (a * GRAVITY_EQUATOR * c2 + b * GRAVITY_POLE * s2) / np.sqrt(
        _squared_norm(latitude)
    )
    flattening = (a - b) / a
    m = ROTATION_RATE**2 * a * a * b / GM
    return on_ellipsoid * (
        1 - 2 * (1 + flattening + m - 2 * flattening * s2) * height / a + 3 * (height / a) ** 2
    )


def rotation_n(latitude: float) -> NDArray[np.float64]:
    """Return the Earth's angular rate in east-north-up, shape (3,), rad/s."""
    return np.array([0.0, ROTATION_RATE * math.cos(latitude), ROTATION_RATE * math.sin(latitude)])
