"""A rotation scheme as legs, and the attitude of the sensor frame along them.

Angles are in degrees here, so that half turns are exact: cosine and sine of whole quarter turns are
exactly 0 and ±1, and what a scheme cancels is zero, not 1e-16.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme

INNER: Final = 0
OUTER: Final = 1

_LEAST_TURN_DEG = 1e-6


@dataclass(frozen=True)
class Leg:
    """One axis turning at a constant rate, or both at rest."""

    position: int  #: position in the scheme, from 1
    axis: Literal[0, 1] | None  #: INNER, OUTER, or None if both are at rest
    start_deg: tuple[float, float]  #: inner and outer angle at the beginning
    turn_deg: float  #: signed angle of the turn; 0 if at rest
    duration_s: float  #: above 0

    @property
    def end_deg(self) -> tuple[float, float]:
        """Inner and outer angle at the end."""
        inner, outer = self.start_deg
        return (
            inner + (self.turn_deg if self.axis == INNER else 0.0),
            outer + (self.turn_deg if self.axis == OUTER else 0.0),
        )

    @property
    def rate(self) -> float:
        """Rate of the turning axis, rad/s."""
        return float(np.radians(self.turn_deg)) / self.duration_s


def legs_of(scheme: Scheme, start_deg: tuple[float, float] = (0.0, 0.0)) -> tuple[Leg, ...]:
    """Return the legs of one cycle: the turn of each position, then its stationary period.

    Turns below 1e-6° are omitted.
    """
    legs: list[Leg] = []
    angles = start_deg
    for position, turn in enumerate(scheme.turns, start=1):
        axis: Literal[0, 1] = INNER if turn.axis == "inner" else OUTER
        if abs(turn.angle_deg) >= _LEAST_TURN_DEG:
            turn_s = abs(turn.angle_deg) / scheme.turn_rate_dps
            legs.append(Leg(position, axis, angles, turn.angle_deg, turn_s))
            angles = legs[-1].end_deg
        if scheme.stand_s > 0:
            legs.append(Leg(position, None, angles, 0.0, scheme.stand_s))
    return tuple(legs)


def cos_sin(angle_deg: ArrayLike) -> tuple[Floats, Floats]:
    """Return cosine and sine of angles in degrees; exact at whole quarter turns."""
    reduced = np.mod(np.asarray(angle_deg, dtype=float), 360.0)
    radians = np.radians(reduced)
    cosine, sine = np.cos(radians), np.sin(radians)
    cosine = np.where((reduced == 90.0) | (reduced == 270.0), 0.0, cosine)
    sine = np.where(reduced == 180.0, 0.0, sine)
    return cosine, sine


def rotation_x(angle_deg: ArrayLike) -> Floats:
    """Return Rx, shape (..., 3, 3). Paper, (22)."""
    cosine, sine = cos_sin(angle_deg)
    matrix = np.zeros((*cosine.shape, 3, 3))
    matrix[..., 0, 0] = 1.0
    matrix[..., 1, 1] = matrix[..., 2, 2] = cosine
    matrix[..., 2, 1] = sine
    matrix[..., 1, 2] = -sine
    return matrix


def rotation_z(angle_deg: ArrayLike) -> Floats:
    """Return Rz, shape (..., 3, 3). Paper, (22)."""
    cosine, sine = cos_sin(angle_deg)
    matrix = np.zeros((*cosine.shape, 3, 3))
    matrix[..., 2, 2] = 1.0
    matrix[..., 0, 0] = matrix[..., 1, 1] = cosine
    matrix[..., 1, 0] = sine
    matrix[..., 0, 1] = -sine
    return matrix


def attitude(inner_deg: ArrayLike, outer_deg: ArrayLike) -> Floats:
    """Return ``C_s_b = Rx(outer) Rz(inner)``, shape (..., 3, 3). Paper, (22)."""
    matrix: Floats = rotation_x(outer_deg) @ rotation_z(inner_deg)
    return matrix


def table_rate_s(leg: Leg, inner_deg: Floats) -> Floats:
    """Return the rate of the sensor frame relative to the body, in sensor axes, (..., 3), rad/s.

    The inner axis is the sensors' z; the outer axis is the body's x, seen through the inner turn.
    """
    rate = np.zeros((*inner_deg.shape, 3))
    if leg.axis == INNER:
        rate[..., 2] = leg.rate
    elif leg.axis == OUTER:
        cosine, sine = cos_sin(inner_deg)
        rate[..., 0] = cosine * leg.rate
        rate[..., 1] = -sine * leg.rate
    return rate


def angles_at(leg: Leg, time_s: Floats) -> tuple[Floats, Floats]:
    """Return inner and outer angle, deg, at times since the leg's beginning."""
    turned = leg.turn_deg * (time_s / leg.duration_s)
    inner, outer = leg.start_deg
    still = np.zeros_like(time_s)
    return (
        inner + (turned if leg.axis == INNER else still),
        outer + (turned if leg.axis == OUTER else still),
    )
