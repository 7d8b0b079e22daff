"""Tolerances at least cost that meet a requirement: the covariance analysis, inverted.

The variance of the position is that of what is fixed, and for each tolerance a share that grows
with its square. Cost falls with a power of each. In logarithms both are convex, so that the least
cost is found wherever one begins (Boyd and Vandenberghe, *Convex Optimization*, 2004, 4.5:
geometric programs).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.definition import Definition, Tolerance, Wishes, load, read
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import Outcomes, shown
from rrins.host_tools.covariance.analysis import analyse
from rrins.host_tools.covariance.radius import percentile_m
from rrins.host_tools.covariance.sources import TOLERANCES, draws
from rrins.host_tools.files import JsonObject

OUTPUT = "horizontal_error_m"
_REQUIREMENT = re.compile(rf"\s*p(\d+(?:\.\d+)?)\s+of\s+{OUTPUT}\s*<=\s*([\d.eE+-]+)\s*\Z")
_CLOSE = 1e-4
"""Share by which the solver may miss the requirement."""


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
    chosen: tuple[Chosen, ...]
    predicted_m: float
    other_share: float
    definition: Definition

    @property
    def cost(self) -> float:
        """The sum of all costs."""
        return sum(one.cost for one in self.chosen)

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
            "tolerances": [vars(one) for one in self.chosen],
            "other_share": self.other_share,
            "duration_s": self.definition.scenario.duration_s,
        }


def allocate(source: str | Mapping[str, Any], wishes: Wishes | None = None) -> Allocation:
    """Return the tolerances of least cost that meet the requirement of a campaign's file.

    Parameters
    ----------
    source : str or mapping
        A campaign's TOML file with a table ``[allocate]``, or its keys.
    wishes : Wishes, optional

    Raises
    ------
    CampaignError, ScenarioError
        When there is nothing to allocate, or no tolerances suffice.
    """
    wanted = read(source)[0].allocate
    if wanted is None:
        raise CampaignError(f"{source}: has no table [allocate] with a requirement and tolerances")
    requirement = Requirement.parse(wanted.require)
    for one in wanted.tolerances:
        _check(one)
    if len({one.key for one in wanted.tolerances}) < len(wanted.tolerances):
        raise CampaignError("allocate: a key stands there twice")
    units = load(
        source, _with(wishes or Wishes(), wanted.tolerances, [t.at for t in wanted.tolerances])
    )
    analysis = analyse(units.scenario, units.varied())
    found = {one.name: one.covariance[-1] for one in analysis.sources}
    unit = np.array([found.pop(one.key, np.zeros((2, 2))) for one in wanted.tolerances])
    fixed = np.sum([*found.values(), np.zeros((2, 2))], axis=0)
    problem = _Problem(requirement, wanted.tolerances, unit, fixed, analysis.mean[-1])
    sigmas = problem.solve()
    covariances = problem.scaled(sigmas)
    whole = float(np.trace(covariances.sum(axis=0) + fixed)) or math.inf  # no shares of nothing
    chosen = [
        Chosen(
            one.key, float(sigma), _cost(one, sigma), float(np.trace(P)) / whole, _limit(one, sigma)
        )
        for one, sigma, P in zip(wanted.tolerances, sigmas, covariances, strict=True)
    ]
    return Allocation(
        requirement,
        tuple(sorted(chosen, key=lambda one: -one.cost)),
        problem.percentile(sigmas),
        float(np.trace(fixed)) / whole,
        load(source, _with(wishes or Wishes(), wanted.tolerances, sigmas.tolist())),
    )


def confirmed(store: Store, requirement: Requirement) -> Estimate:
    """Return the percentile of a campaign's runs, with its interval."""
    return Outcomes(store, (OUTPUT,)).sample(OUTPUT).percentile(requirement.percent)


def _check(one: Tolerance) -> None:
    if one.key not in TOLERANCES:
        raise CampaignError(f"allocate: {one.key}: there are {', '.join(TOLERANCES)}")
    if not one.least < one.most:
        raise CampaignError(f"allocate: {one.key}: least is not below most")


def _with(wishes: Wishes, tolerances: Sequence[Tolerance], sigmas: Sequence[float]) -> Wishes:
    """Return wishes that give units these tolerances."""
    pairs = [
        (one.key, float(f"{sigma:.6g}")) for one, sigma in zip(tolerances, sigmas, strict=True)
    ]
    return Wishes(
        **vars(wishes)
        | {
            "set": dict(wishes.set) | {key: sigma for key, sigma in pairs if draws(key)},
            "vary": dict(wishes.vary)
            | {key: f"normal(0, {sigma!r})" for key, sigma in pairs if not draws(key)},
        }
    )


def _cost(one: Tolerance, sigma: float) -> float:
    return float(one.cost * (one.at / sigma) ** one.power)


def _limit(one: Tolerance, sigma: float) -> str:
    for name, limit in (("least", one.least), ("most", one.most)):
        if math.isclose(sigma, limit, rel_tol=1e-3):
            return name
    return ""


@dataclass(frozen=True)
class _Problem:
    """Least cost under a requirement, over the logarithms of the tolerances."""

    requirement: Requirement
    tolerances: tuple[Tolerance, ...]
    unit: Floats  #: shape (k, 2, 2); covariance of the position with a tolerance `at`, m²
    fixed: Floats  #: shape (2, 2)
    mean: Floats  #: shape (2,); m

    def scaled(self, sigmas: Floats) -> Floats:
        """Return the covariances that tolerances give, shape (k, 2, 2)."""
        ratios = sigmas / np.array([one.at for one in self.tolerances])
        return np.asarray(self.unit * (ratios**2)[:, None, None])

    def percentile(self, sigmas: Floats) -> float:
        """Return the percentile with these tolerances, m."""
        covariance = self.scaled(sigmas).sum(axis=0) + self.fixed
        return percentile_m(self.requirement.percent / 100.0, self.mean, covariance)

    def solve(self) -> Floats:
        """Return the tolerances, shape (k,)."""
        from scipy.optimize import minimize

        least, most = (
            np.array([getattr(one, name) for one in self.tolerances]) for name in ("least", "most")
        )
        limit_m = self.requirement.limit_m
        if self.percentile(most) <= limit_m:
            return most
        if (best_m := self.percentile(least)) > limit_m:
            raise CampaignError(
                f"allocate: with every tolerance at its least the p{self.requirement.percent:g} is "
                f"{shown(best_m)} m, above {shown(limit_m)} m"
            )
        found = minimize(
            lambda x: math.log(sum(map(_cost, self.tolerances, np.exp(x)))),
            np.log(least),
            method="SLSQP",
            bounds=list(zip(np.log(least), np.log(most), strict=True)),
            constraints={
                "type": "ineq",
                "fun": lambda x: math.log(limit_m / self.percentile(np.exp(x))),
            },
            options={"maxiter": 500, "ftol": 1e-10},
        )
        sigmas = np.clip(np.exp(found.x), least, most)
        if not found.success or self.percentile(sigmas) > limit_m * (1.0 + _CLOSE):
            raise CampaignError(f"allocate: no solution was found: {found.message}")
        return np.asarray(sigmas)
