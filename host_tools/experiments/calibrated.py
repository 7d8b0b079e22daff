"""The calibration that a unit of the experiments finds on its own table."""

from __future__ import annotations

from typing import Final

import numpy as np

from rrins.firmware_py.core.sensors.calibration import Calibration
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.afterwards import calibration_of
from rrins.host_tools.calibration.estimation import estimate
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import unit_of
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.schemes import SCHEMES
from rrins.host_tools.scenario.tables import each

_STREAM: Final = 14  # independent of all other draws with the same seed
_NOISE: Final = {
    "gyros__angle_random_walk_deg_per_sqrt_h": 0.005,
    "accelerometers__white_noise_ug_per_sqrt_hz": 10.0,
}
"""White noise of the prototype, on the table."""


def switched_on(scenario: Scenario) -> Scenario:
    """Return the scenario with the biases of one power-up, which table and navigation share."""
    rng = np.random.default_rng([scenario.seed, _STREAM])
    changes: dict[str, float | tuple[float, ...]] = {}
    for kind, unit in (("gyros", "dph"), ("accelerometers", "ug")):
        table, count = getattr(scenario, kind), len(getattr(scenario.rimu, kind))
        spread = each(getattr(table, f"bias_repeatability_{unit}"), count)
        bias = each(getattr(table, f"bias_{unit}"), count)
        drawn = np.add(bias, spread * rng.standard_normal(count))
        changes[f"{kind}__bias_{unit}"] = tuple(drawn.tolist())
        changes[f"{kind}__bias_repeatability_{unit}"] = 0.0
    return scenario.varied(**changes)


def calibrated(scenario: Scenario) -> Calibration:
    """Return what the 14 moves of `calibration` find of a unit that stands still.

    The noise is another than in the scenario, that of the prototype; biases that wander do so
    otherwise than later.

    Raises
    ------
    CalibrationRecordError
    """
    unit = scenario.varied(motion={"kind": "stationary"}, seed=scenario.seed + 100_000, **_NOISE)
    found = estimate(unit_of(unit), record(unit, Scheme(turns=SCHEMES["calibration"])))
    return calibration_of(found.gyros.constants, found.accelerometers.constants)
