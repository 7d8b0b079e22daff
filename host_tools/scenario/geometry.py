"""Directions of the RIMU's input axes that are built in: (polar angle, azimuth) in degrees.

Polar angle from z, azimuth from x of the sensor frame (paper, figure 1).
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Final

AxesDeg = tuple[tuple[float, float], ...]

_TETRAHEDRON_DEG = math.degrees(math.acos(1 / 3))  # 70.53°
_DODECAHEDRON_DEG = math.degrees(math.atan(2))  # 63.43°, between normals of neighbouring faces
_CONE_DEG = math.degrees(math.acos(1 / math.sqrt(3)))  # 54.74°: as good along z as across it

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
        # Six normals of a regular dodecahedron's faces, opposite faces sharing one: one along z,
        # five around it. J. P. Gilmore and R. A. McKern, A redundant strapdown inertial reference
        # unit (SIRU), J. Spacecraft 9 (1972).
        "dodecahedron": ((0.0, 0.0), *((_DODECAHEDRON_DEG, 72.0 * k) for k in range(5))),
        # Four on a cone about z; the half angle makes HᵀH = (4/3) I.
        "cone": tuple((_CONE_DEG, 90.0 * k) for k in range(4)),
        # Three orthogonal ones, and a fourth that makes the same angle with each.
        "orthogonal-plus-one": ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0), (_CONE_DEG, 45.0)),
    }
)
"""Built-in geometries, name to input axes."""
