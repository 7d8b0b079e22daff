"""Sets of constants for sensors whose real ones are unknown, drawn over seeds.

Bias repeatability and bias instability are table 2's, drawn by the hardware at each power-up; what
hinges on the set are scale factor and installation errors, which the table bounds or does not have.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np

from host_tools.scenario import Scenario

_STREAM = 7  # apart from the hardware's own draws of the same seed
_ACCELEROMETER_SHARE = 30 / 50  # table 2: scale factor repeatability of 30 ppm against 50 ppm


@dataclass(frozen=True)
class ConstantSet:
    """Standard deviations from which each sensor's constants are drawn.

    Attributes
    ----------
    scale_ppm : float
        Of the gyros' symmetric and asymmetric scale factor errors; the accelerometers' are 30/50
        of it, as in table 2.
    installation_arcsec : float
        Of δu and δv.
    biases : float
        Factor on repeatability and stability of table 2.
    """

    scale_ppm: float
    installation_arcsec: float
    biases: float = 1.0

    @property
    def words(self) -> str:
        """The set in words."""
        words = f"{self.scale_ppm:g} ppm, {self.installation_arcsec:g}″"
        return words if self.biases == 1 else f"{words}, biases × {self.biases:g}"

    def drawn(self, scenario: Scenario, seed: int) -> Scenario:
        """Return a scenario with constants of this set, drawn for a seed."""
        rng = np.random.default_rng([seed, _STREAM])
        changes: dict[str, Any] = {"seed": seed}
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
        changes: dict[str, Any] = {}
        for kind, unit in (("gyros", "dph"), ("accelerometers", "ug")):
            for what in ("repeatability", "instability"):
                key = f"bias_{what}_{unit}"
                value = getattr(getattr(scenario, kind), key)
                values = value if isinstance(value, tuple) else (value,)
                changes[f"{kind}__{key}"] = tuple(v * self.biases for v in values)
        return scenario.varied(**changes)


SETS: Final = tuple(ConstantSet(*pair) for pair in product((0.0, 50.0), (0.0, 10.0, 60.0)))
"""The sets that the report compares."""

REFERENCE: Final = SETS[4]
"""The set that stands for the prototype where one is to: table 2's bounds, 10″."""
