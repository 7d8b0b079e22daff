"""Where the vehicle is, as a test asks for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class NavigationFix:
    """The position, velocity and attitude of the last NAV_* frames."""

    time_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    velocity_east_mps: float
    velocity_north_mps: float
    velocity_up_mps: float
    roll_deg: float
    pitch_deg: float
    heading_deg: float


@dataclass(frozen=True)
class TrueState(NavigationFix):
    """Where the vehicle really is, and the true angles of the turntable's axes."""

    inner_deg: float
    outer_deg: float


class EastNorthPair(NamedTuple):
    """A pair of figures."""

    east: float
    north: float
