"""Directions of the RIMU's input axes that are built in: (polar angle, azimuth) in degrees.

Polar angle from z, azimuth from x of the sensor frame (paper, figure 1).
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Final

AxesDeg = tuple[tuple[float, float], ...]

_TETRAHEDRON_DEG = math.degrees(math.acos(1 / 3))  # 70.53°

GEOMETRIES: Final = MappingProxyType(
    {
        # Paper, (53): gyros and accelerometers coaxial.
        "tetrahedron": (
            (180.0, 0.0),
            (_TETRAHEDRON_DEG, 0.0),
            (_TETRAHEDRON_DEG, 120.0),
            (_TETRAHEDRON_DEG, 240.0),
        ),
        "orthogonal": ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0)),
    }
)
"""Built-in geometries, name to input axes."""
