"""An allocation: choices and tolerances that meet a requirement, and what the runs say of it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rrins.host_tools.campaigns.definition import Definition
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import Outcomes
from rrins.host_tools.files import JsonObject

OUTPUT = "horizontal_error_m"
_REQUIREMENT = re.compile(rf"\s*p(\d+(?:\.\d+)?)\s+of\s+{OUTPUT}\s*<=\s*([\d.eE+-]+)\s*\Z")


@dataclass(frozen=True)
class Requirement:
    """A percentile of the horizontal error at the end, and its limit."""

    text: str
    percent: float
    limit_m: float

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """Return the requirement of a sentence.

        Raises
        ------
        CampaignError
        """
        found = _REQUIREMENT.match(text)
        try:
            percent, limit_m = (float(number) for number in found.groups()) if found else (0.0, 0.0)
        except ValueError:
            percent = limit_m = 0.0
        if not (0.0 < percent < 100.0 and 0.0 < limit_m < math.inf):
            raise CampaignError(
                f'require {text!r}: is not a requirement such as "p95 of {OUTPUT} <= 1000"'
            )
        return cls(text, percent, limit_m)


@dataclass(frozen=True)
class Chosen:
    """A tolerance that was chosen.

    Attributes
    ----------
    key : str
    sigma, cost : float
        σ in the key's unit; cost as the file has it.
    share : float
        Of the horizontal variance at the end.
    limit : str
        ``least`` or ``most`` where it stands at the file's limit; else empty.
    """

    key: str
    sigma: float
    cost: float
    share: float
    limit: str


@dataclass(frozen=True)
class Allocation:
    """Tolerances of least cost, and what the analysis says they lead to.

    Attributes
    ----------
    requirement : Requirement
    choices : mapping
        Key and value of each choice.
    base : float
        What the choices cost.
    chosen : tuple of Chosen
        The dearest first.
    predicted_m : float
        The percentile.
    other_share : float
        Share of the variance of what was not to be chosen.
    definition : Definition
        The campaign of units with these tolerances.
    """

    requirement: Requirement
    choices: Mapping[str, Any]
    base: float
    chosen: tuple[Chosen, ...]
    predicted_m: float
    other_share: float
    definition: Definition

    @property
    def cost(self) -> float:
        """The sum of all costs."""
        return self.base + sum(one.cost for one in self.chosen)

    def verdict(self, found: Estimate) -> str:
        """Return what the runs say of the requirement, as a line."""
        limit_m, value = self.requirement.limit_m, self.predicted_m
        agrees = "agrees" if found.low <= value <= found.high else "does NOT agree"
        held = "holds" if found.high <= limit_m else "is NOT met" if found.low > limit_m else ""
        word = held or "is neither shown nor refuted by so many runs"
        return f"the analysis {agrees} with the runs; the requirement {word}"

    def values(self) -> JsonObject:
        """Return it as plain values."""
        return {
            "require": self.requirement.text,
            "predicted_m": self.predicted_m,
            "cost": self.cost,
            "choices": dict(self.choices),
            "tolerances": [vars(one) for one in self.chosen],
            "other_share": self.other_share,
            "duration_s": self.definition.scenario.duration_s,
        }


def confirmed(store: Store, requirement: Requirement) -> Estimate:
    """Return the percentile of a campaign's runs, with its interval."""
    return Outcomes(store, (OUTPUT,)).sample(OUTPUT).percentile(requirement.percent)
