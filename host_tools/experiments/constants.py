"""Sets of sensor constants, drawn over seeds because the real ones are unknown.

Bias repeatability and bias instability are those of table 2, drawn by the hardware at each
power-up. A set determines the scale factor and installation errors, which the table only bounds or
omits.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from rrins.host_tools.scenario.scenario import Scenario

_STREAM = 7  # independent of the hardware's own draws with the same seed
_ACCELEROMETER_SHARE = 30 / 50  # table 2: scale factor repeatability of 30 ppm against 50 ppm


@dataclass(frozen=True)
class ConstantSet:
    """Standard deviations from which each sensor's constants are drawn."""

    #: for the gyros' symmetric and asymmetric scale factor errors; the accelerometers' are 30/50 of
    #: these, as in table 2
    scale_ppm: float
    installation_arcsec: float  #: for δu and δv
    biases: float = 1.0  #: factor applied to the repeatability and stability of table 2

    @property
    def words(self) -> str:
        """The set in words."""
        words = f"{self.scale_ppm:g} ppm, {self.installation_arcsec:g}″"
        return words if self.biases == 1 else f"{words}, biases × {self.biases:g}"

    def drawn(self, scenario: Scenario, seed: int) -> Scenario:
        """Return the scenario with constants drawn from this set for a seed."""
        rng = np.random.default_rng([seed, _STREAM])
        changes: dict[str, float | tuple[float, ...]] = {"seed": seed}
        for kind, share in (("gyros", 1.0), ("accelerometers", _ACCELEROMETER_SHARE)):
            count = len(getattr(scenario.rimu, kind))
            draws = rng.standard_normal((4, count))
            ppm, arcsec = self.scale_ppm * share, self.installation_arcsec
            for key, spread, row in zip(
                (
                    "scale_error_ppm",
                    "asymmetric_scale_error_ppm",
                    "installation_u_arcsec",
                    "installation_v_arcsec",
                ),
                (ppm, ppm, arcsec, arcsec),
                draws,
                strict=True,
            ):
                changes[f"{kind}__{key}"] = tuple((spread * row).tolist())
            changes[f"{kind}__scale_repeatability_ppm"] = 0.0
        return self._with_biases(scenario.varied(**changes))

    def _with_biases(self, scenario: Scenario) -> Scenario:
        if self.biases == 1:
            return scenario
        changes: dict[str, float | tuple[float, ...]] = {}
        for kind, unit in (("gyros", "dph"), ("accelerometers", "ug")):
            for what in ("repeatability", "instability"):
                key = f"bias_{what}_{unit}"
                value = getattr(getattr(scenario, kind), key)
                values = value if isinstance(value, tuple) else (value,)
                changes[f"{kind}__{key}"] = tuple(v * self.biases for v in values)
        return scenario.varied(**changes)


SETS: Final = tuple(ConstantSet(*pair) for pair in product((0.0, 50.0), (0.0, 10.0, 60.0)))
"""The sets that the report compares."""

WORST: Final = SETS[5]
"""The set with the largest constants: what a unit is calibrated of."""

REFERENCE: Final = SETS[4]
"""The set that represents the prototype where a single one is needed: table 2's bounds, 10″."""
