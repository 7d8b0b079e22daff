"""Units of data sheets in SI units."""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""m/s²: the g of µg and of an accelerometer's range (ISO 80000-3)."""

DPH = math.radians(1) / 3600  # rad/s
UG = 1e-6 * STANDARD_GRAVITY  # m/s²
ARCSEC = math.radians(1) / 3600  # rad
PPM = 1e-6
DEG_PER_SQRT_H = math.radians(1) / 60  # rad/√s
SQRT_H = 60.0  # √s
