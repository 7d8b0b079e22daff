"""WGS-84: shape, rotation and normal gravity.

References
----------
NIMA TR8350.2 (3rd ed., 2000), tables 3.1, 3.4; Groves, *Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems* (2nd ed., 2013), equations (2.105), (2.106), (2.134),
(2.139).
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths.angles import Angle

SEMI_MAJOR_AXIS = 6378137.0  # m
FLATTENING = 1 / 298.257223563
RATE = 7.292115e-5  # rad/s
GRAVITATIONAL_CONSTANT = 3.986004418e14  # m³/s²
GRAVITY_EQUATOR = 9.7803253359  # m/s²
SOMIGLIANA = 1.931852652458e-3  # k = b γp / (a γe) - 1

ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
_M = (  # ω² a² b / GM
    RATE**2 * SEMI_MAJOR_AXIS**3 * (1 - FLATTENING) / GRAVITATIONAL_CONSTANT
)


@compiled
def radii(latitude: float) -> tuple[float, float]:
    """Return the radii of curvature (meridian, prime vertical) in m. Groves (2.105), (2.106)."""
    return radii_at(math.sin(latitude))


@compiled
def radii_at(sine: float) -> tuple[float, float]:
    """Return `radii` for the sine of the latitude."""
    root = 1.0 - ECCENTRICITY_SQUARED * (sine * sine)
    prime_vertical = SEMI_MAJOR_AXIS / math.sqrt(root)
    return prime_vertical * (1.0 - ECCENTRICITY_SQUARED) / root, prime_vertical


@compiled
def turn(out: Floats, C_s_n: Floats, latitude: Angle, dt: float) -> None:
    """Write by how much the Earth turns the sensors in a time `dt` (s), rad in their frame."""
    north = RATE * latitude.cosine * dt
    up = RATE * latitude.sine * dt
    for i in range(3):
        out[i] = C_s_n[1, i] * north + C_s_n[2, i] * up


@compiled
def wrapped(longitude: float) -> float:
    """Return a longitude, or a difference of two, in [-π, π) rad."""
    if longitude >= math.pi:
        return longitude - 2.0 * math.pi
    if longitude < -math.pi:
        return longitude + 2.0 * math.pi
    return longitude


@compiled
def gravity(latitude: float, height: float) -> float:
    """Return normal gravity in m/s², downwards along the ellipsoid's normal.

    Somigliana's formula, Groves (2.134), continued to `height` (m) to second order, (2.139); its
    northward component above the ellipsoid, 8e-9 m/s² per metre, is neglected.
    """
    return gravity_at(math.sin(latitude), height)


@compiled
def gravity_at(sine: float, height: float) -> float:
    """Return `gravity` for the sine of the latitude."""
    sine_squared = sine * sine
    surface = (
        GRAVITY_EQUATOR
        * (1.0 + SOMIGLIANA * sine_squared)
        / math.sqrt(1.0 - ECCENTRICITY_SQUARED * sine_squared)
    )
    ratio = height / SEMI_MAJOR_AXIS
    linear = 2.0 * (1.0 + FLATTENING * (1.0 - 2.0 * sine_squared) + _M) * ratio
    return surface * (1.0 - linear + 3.0 * (ratio * ratio))
