"""The table `[motion]` of a scenario: what the vehicle does."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from rrins.host_tools.hardware.tables import TomlTable
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.rounding import rounded

DRIVE_S = 2500.0
SWAY_S = 1800.0

_KEYS = {
    "stationary": frozenset[str](),
    "drive": frozenset({"duration_s", "begins_s", "seed"}),
    "sway": frozenset(
        {
            "duration_s",
            "begins_s",
            "seed",
            "wave_spectrum",
            "wave_height_m",
            "wave_period_s",
            "wave_from_deg",
            "roll_period_s",
        }
    ),
    "file": frozenset(
        {
            "duration_s",
            "begins_s",
            "path",
            "irregularities",
            "speed_limit_mps",
            "jerk_density_mps3_per_sqrt_hz",
            "position_deviation_m",
            "velocity_deviation_mps",
            "attitude_deviation_deg",
        }
    ),
}


class Motion(TomlTable):
    """The vehicle's motion since navigation began."""

    kind: Literal["stationary", "drive", "sway", "file"] = "stationary"
    """`drive`: a synthetic car; `sway`: a ship in waves; `file`: a recording."""
    duration_s: float | None = Field(default=None, ge=30, le=43_200)
    """Length of a drive (default 2500); period after which sway repeats (1800); part of a recording
    to use (all)."""
    begins_s: float | None = Field(default=None, ge=-43_200, le=43_200)
    """When it begins, after power-on of the hardware; negative: it is under way by then. Default:
    with navigation."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Selects the route of a drive, or the phases of the waves."""

    wave_spectrum: Literal["jonswap", "pierson-moskowitz"] = "jonswap"
    """A developing sea (peak factor 3.3), or a fully developed one."""
    wave_height_m: float = Field(default=2.5, gt=0, le=15)
    """Significant wave height."""
    wave_period_s: float = Field(default=9.0, ge=3, le=25)
    """Period of the spectrum's peak."""
    wave_from_deg: float = Field(default=45.0, ge=-360, le=360)
    """Where the waves come from, clockwise from the bow."""
    roll_period_s: float = Field(default=11.0, ge=3, le=60)
    """Natural period of the ship's roll."""

    path: str | None = Field(default=None, min_length=1)
    """The recording: .csv or .pos, relative to the scenario's folder."""
    irregularities: Literal["mend", "refuse"] = "mend"
    """How to treat gaps, jumps, wrong timestamps and unreadable lines."""
    speed_limit_mps: float = Field(default=100.0, ge=0.1, le=3000)
    """Speed above which the recording must be wrong."""
    jerk_density_mps3_per_sqrt_hz: float = Field(default=1.0, ge=0.01, le=1000)
    """Agility of the recorded vehicle: a larger value follows the file more closely."""
    position_deviation_m: float = Field(default=0.02, ge=0.001, le=100)
    """Standard deviation of positions, where the file does not give it."""
    velocity_deviation_mps: float = Field(default=0.05, ge=0.0001, le=100)
    """Likewise for velocities."""
    attitude_deviation_deg: float = Field(default=0.05, ge=0.0001, le=10)
    """Likewise for angles."""

    @model_validator(mode="after")
    def _consistent(self) -> Motion:
        if self.kind == "file" and self.path is None:
            raise ValueError('kind = "file" needs path')
        for key in sorted(self.model_fields_set - {"kind"} - _KEYS[self.kind]):
            if getattr(self, key) != type(self).model_fields[key].default:
                kinds = " or ".join(f'"{kind}"' for kind, keys in _KEYS.items() if key in keys)
                raise ValueError(f"{key} is for kind = {kinds}, not {self.kind!r}")
        wavelength = STANDARD_GRAVITY * self.wave_period_s**2 / (2 * math.pi)
        if self.kind == "sway" and self.wave_height_m > wavelength / 15:
            raise ValueError(
                f"wave_height_m: waves of {self.wave_period_s:g} s break above "
                f"{rounded(wavelength / 15)} m"
            )
        return self
