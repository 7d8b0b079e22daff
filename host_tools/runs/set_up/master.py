"""Settings of the emulated master unit, for a scenario."""

from __future__ import annotations

import math

import numpy as np

from rrins.host_tools.hardware.master_settings import MasterSettings
from rrins.host_tools.runs.set_up.data_sheets import attitude_sigmas
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Master

_STREAM = 12  # independent of the hardware's own draws with the same seed


def master_settings(
    scenario: Scenario, attitude_error_deg: tuple[float, float, float]
) -> MasterSettings | None:
    """Return the master unit of a scenario; None where navigation does not begin by transfer.

    `attitude_error_deg` are the errors of its roll, pitch and heading; those of velocity and
    position are drawn here.
    """
    table, rate_hz = scenario.firmware, scenario.rate_hz
    if table.initial_attitude != "transferred":
        return None
    master = scenario.master or Master()
    drawn = np.random.default_rng([scenario.seed, _STREAM]).standard_normal((2, 3))
    east, north, up = (table.position_error_sigma_m * drawn[1]).tolist()
    east_mps, north_mps, up_mps = (table.velocity_error_sigma_mps * drawn[0]).tolist()
    roll, pitch, heading = (math.radians(error) for error in attitude_error_deg)
    level_sigma, heading_sigma = attitude_sigmas(scenario)
    return MasterSettings(
        interval_epochs=master.interval_epochs(rate_hz),
        latency_epochs=master.latency_epochs(rate_hz),
        attitude_error=(roll, pitch, heading),
        velocity_error=(east_mps, north_mps, up_mps),
        position_error=(east, north, up),
        level_sigma=level_sigma,
        heading_sigma=heading_sigma,
        velocity_sigma=table.velocity_error_sigma_mps,
        position_sigma=table.position_error_sigma_m,
        outages=tuple(
            (round(o.at_s * rate_hz), round((o.at_s + o.for_s) * rate_hz)) for o in master.outages
        ),
    )
