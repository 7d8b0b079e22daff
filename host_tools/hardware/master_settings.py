"""The set-up of the emulated master unit, and how it fills the record."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rrins.host_tools.hardware.memory import OUTAGE_CAPACITY, MasterState
from rrins.host_tools.hardware.units import fill


@dataclass(frozen=True)
class MasterSettings:
    """The master unit; `outages` are the first and the last epoch of each."""

    interval_epochs: int
    latency_epochs: int = 0
    attitude_error: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad, roll, pitch, heading
    velocity_error: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s, east, north, up
    position_error: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, east, north, up
    level_sigma: float = 0.0  # rad, as it tells it
    heading_sigma: float = 0.0  # rad, as it tells it
    velocity_sigma: float = 0.0  # m/s, as it tells it
    position_sigma: float = 0.0  # m, as it tells it
    outages: tuple[tuple[int, int], ...] = ()


def fill_master(master: MasterState, settings: MasterSettings | None) -> None:
    """Fill in the master unit of a plant; None: no master."""
    if settings is None:
        return
    assert 0 <= settings.latency_epochs < settings.interval_epochs
    assert len(settings.outages) <= OUTAGE_CAPACITY
    master.present = True
    fill(master, vars(settings))
    master.level_sigma_arcsec = math.degrees(settings.level_sigma) * 3600
    master.heading_sigma_arcsec = math.degrees(settings.heading_sigma) * 3600
    master.outage_count = len(settings.outages)
    for k, (first, last) in enumerate(settings.outages):
        master.outage_first[k], master.outage_last[k] = first, last
