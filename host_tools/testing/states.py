"""Where the vehicle is, as a test asks for it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.testing.recording import Values


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

    @classmethod
    def of(cls, values: Values) -> Self:
        """Return that of the signals of a group of NAV_* frames."""
        return cls(
            time_s=values["time_s"],
            lat_deg=values["latitude_deg"],
            lon_deg=values["longitude_deg"],
            height_m=values["height"],
            velocity_east_mps=values["velocity_east"],
            velocity_north_mps=values["velocity_north"],
            velocity_up_mps=values["velocity_up"],
            roll_deg=values["roll_deg"],
            pitch_deg=values["pitch_deg"],
            heading_deg=values["heading_deg"],
        )


@dataclass(frozen=True)
class TrueState(NavigationFix):
    """Where the vehicle really is, and the true angles of the turntable's axes."""

    inner_deg: float
    outer_deg: float

    @classmethod
    def of_hardware(cls, record: Truth, period_ns: int) -> Self:
        """Return that of the emulated hardware."""
        inner, outer = (math.degrees(angle) for angle in record["axis_angle"])
        east, north, up = (float(v) for v in record["velocity_n"])
        return cls(
            time_s=int(record["epoch"]) * period_ns / 1e9,
            lat_deg=math.degrees(record["latitude"]),
            lon_deg=math.degrees(record["longitude"]),
            height_m=float(record["height"]),
            velocity_east_mps=east,
            velocity_north_mps=north,
            velocity_up_mps=up,
            roll_deg=math.degrees(record["roll"]),
            pitch_deg=math.degrees(record["pitch"]),
            heading_deg=math.degrees(record["heading"]) % 360.0,
            inner_deg=inner,
            outer_deg=outer,
        )


class EastNorthPair(NamedTuple):
    """A pair of figures."""

    east: float
    north: float
