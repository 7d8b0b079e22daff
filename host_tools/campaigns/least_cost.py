"""Tolerances at least cost that meet a requirement: the covariance analysis, inverted.

The variance of the position is that of what is fixed, and for each tolerance a share that grows
with its square. Cost falls with a power of each. In logarithms both are convex, so that the least
cost is found wherever one begins (Boyd and Vandenberghe, *Convex Optimization*, 2004, 4.5:
geometric programs). Choices, such as scheme and geometry, are tried one and all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.allocation import Allocation, Chosen, Requirement
from rrins.host_tools.campaigns.definition import (
    Allocate,
    Choice,
    Definition,
    Tolerance,
    Wishes,
    load,
    read,
)
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.summary import shown
from rrins.host_tools.covariance.analysis import analyse
from rrins.host_tools.covariance.radius import percentile_m
from rrins.host_tools.covariance.sources import TOLERANCES, draws

Combination = tuple[tuple[str, Any, float], ...]
"""For each choice its key, the value, and what that costs."""

_CLOSE = 1e-4
"""Share by which the solver may miss the requirement."""


class InfeasibleError(CampaignError):
    """No tolerances meet the requirement.

    Attributes
    ----------
    best_m : float
        The percentile with every tolerance at its least.
    """

    def __init__(self, requirement: Requirement, best_m: float, has_tolerances: bool) -> None:
        self.best_m = best_m
        where = "with every tolerance at its least" if has_tolerances else "with any choice"
        super().__init__(
            f"allocate: {where} the p{requirement.percent:g} is {shown(best_m)} m, above "
            f"{shown(requirement.limit_m)} m"
        )


@dataclass(frozen=True)
class Problem:
    """Least cost under a requirement, with one set of choices.

    Attributes
    ----------
    source : str or mapping
        The campaign's file, or its keys.
    wishes : Wishes
        What overrides them, the choices among it.
    requirement : Requirement
    choices : mapping
        Key and value of each.
    base : float
        What the choices cost.
    tolerances : tuple of Tolerance
    unit : Floats
        Shape (k, 2, 2); covariance of the position with each tolerance at `at`, m².
    fixed : Floats
        Shape (2, 2); of all else.
    mean : Floats
        Shape (2,); m.
    """

    source: str | Mapping[str, Any]
    wishes: Wishes
    requirement: Requirement
    choices: Mapping[str, Any]
    base: float
    tolerances: tuple[Tolerance, ...]
    unit: Floats
    fixed: Floats
    mean: Floats

    @classmethod
    def of(
        cls,
        source: str | Mapping[str, Any],
        wishes: Wishes,
        wanted: Allocate,
        choices: Mapping[str, Any],
        base: float,
    ) -> Problem:
        """Return the problem of one set of choices; the analysis makes one run for it."""
        wishes = replace(wishes, set={**wishes.set, **choices})
        start = _with(wishes, wanted.tolerances, [one.at for one in wanted.tolerances])
        units = load(source, start)
        if wanted.tolerances:
            _check_that_shares_scale(units)
        analysis = analyse(units.scenario, units.varied())
        found = {one.name: one.covariance[-1] for one in analysis.sources}
        unit = [found.pop(one.key, np.zeros((2, 2))) for one in wanted.tolerances]
        return cls(
            source,
            wishes,
            Requirement.parse(wanted.require),
            choices,
            base,
            wanted.tolerances,
            np.array(unit).reshape(-1, 2, 2),
            np.sum([*found.values(), np.zeros((2, 2))], axis=0),
            analysis.mean[-1],
        )

    def within(self, limit_m: float) -> Problem:
        """Return the same with another limit."""
        return replace(self, requirement=replace(self.requirement, limit_m=limit_m))

    def scaled(self, sigmas: Floats) -> Floats:
        """Return the covariances that tolerances give, shape (k, 2, 2)."""
        ratios = sigmas / np.array([one.at for one in self.tolerances])
        return np.asarray(self.unit * (ratios**2)[:, None, None])

    def percentile(self, sigmas: Floats) -> float:
        """Return the percentile with these tolerances, m."""
        covariance = self.scaled(sigmas).sum(axis=0) + self.fixed
        return percentile_m(self.requirement.percent / 100.0, self.mean, covariance)

    def cost(self, sigmas: Floats) -> float:
        """Return what choices and tolerances cost."""
        return self.base + sum(map(_cost, self.tolerances, sigmas))

    def solve(self) -> Floats:
        """Return the tolerances of least cost, shape (k,).

        Raises
        ------
        InfeasibleError
        CampaignError
            When the solver finds nothing.
        """
        from scipy.optimize import minimize

        least, most = (
            np.array([getattr(one, name) for one in self.tolerances]) for name in ("least", "most")
        )
        limit_m = self.requirement.limit_m
        if self.percentile(most) <= limit_m:
            return most
        if (best_m := self.percentile(least)) > limit_m:
            raise InfeasibleError(self.requirement, best_m, bool(self.tolerances))
        found = minimize(
            lambda x: math.log(sum(map(_cost, self.tolerances, np.exp(x)))),
            np.log(least),
            method="SLSQP",
            bounds=list(zip(np.log(least), np.log(most), strict=True)),
            constraints={
                "type": "ineq",
                "fun": lambda x: math.log(limit_m / self.percentile(np.exp(x))),
            },
            options={"maxiter": 500, "ftol": 1e-8},  # of cost; below 1e-9 it sees rounding
        )
        sigmas = np.clip(np.exp(found.x), least, most)
        if not found.success or self.percentile(sigmas) > limit_m * (1.0 + _CLOSE):
            raise CampaignError(f"allocate: no solution was found: {found.message}")
        return np.asarray(sigmas)

    def allocation(self) -> Allocation:
        """Return the tolerances of least cost with all that is told of them."""
        sigmas = self.solve()
        covariances = self.scaled(sigmas)
        # no shares of nothing
        whole = float(np.trace(covariances.sum(axis=0) + self.fixed)) or math.inf
        chosen = [
            Chosen(
                *(one.key, float(sigma), _cost(one, sigma)),
                *(float(np.trace(P)) / whole, _limit(one, sigma)),
            )
            for one, sigma, P in zip(self.tolerances, sigmas, covariances, strict=True)
        ]
        return Allocation(
            self.requirement,
            self.choices,
            self.base,
            tuple(sorted(chosen, key=lambda one: -one.cost)),
            self.percentile(sigmas),
            float(np.trace(self.fixed)) / whole,
            load(self.source, _with(self.wishes, self.tolerances, sigmas.tolist())),
        )


def problems(
    source: str | Mapping[str, Any],
    wishes: Wishes | None = None,
    watched: Callable[[list[Combination]], Iterable[Combination]] = iter,
) -> list[Problem]:
    """Return the problem of each combination of a file's choices; one if there are none.

    Parameters
    ----------
    source : str or mapping
        A campaign's TOML file with a table ``[allocate]``, or its keys.
    wishes : Wishes, optional
    watched : callable, optional
        Is given the combinations and hands them on, such as one that shows how many are done.

    Raises
    ------
    CampaignError, ScenarioError
        When there is nothing to allocate, or a combination is impossible.
    """
    wanted = read(source)[0].allocate
    if wanted is None:
        raise CampaignError(f"{source}: has no table [allocate] with a requirement and tolerances")
    Requirement.parse(wanted.require)
    _check(wanted)
    combinations = list(product(*map(_priced, wanted.choices)))
    return [
        Problem.of(
            source,
            wishes or Wishes(),
            wanted,
            {key: value for key, value, _ in one},
            sum(cost for *_, cost in one),
        )
        for one in watched(combinations)
    ]


def best(candidates: Sequence[Problem]) -> Allocation:
    """Return the allocation of least cost of several problems.

    Raises
    ------
    CampaignError
        That of the problem that comes closest, where none has a solution.
    """
    found, failures = [], []
    for one in candidates:
        try:
            found.append((one.cost(one.solve()), one))
        except InfeasibleError as error:
            failures.append(error)
    if not found:
        raise min(failures, key=lambda error: error.best_m)
    return min(found, key=lambda pair: pair[0])[1].allocation()


def allocate(source: str | Mapping[str, Any], wishes: Wishes | None = None) -> Allocation:
    """Return what meets the requirement of a campaign's file at least cost.

    Raises
    ------
    CampaignError, ScenarioError
        When there is nothing to allocate, or nothing suffices.
    """
    return best(problems(source, wishes))


def _priced(choice: Choice) -> list[tuple[str, Any, float]]:
    costs = choice.costs or (0.0,) * len(choice.values)
    return [(choice.key, *pair) for pair in zip(choice.values, costs, strict=True)]


def _check(wanted: Allocate) -> None:
    for one in wanted.tolerances:
        if one.key not in TOLERANCES:
            raise CampaignError(f"allocate: {one.key}: there are {', '.join(TOLERANCES)}")
        if not one.least < one.most:
            raise CampaignError(f"allocate: {one.key}: least is not below most")
    keys = [one.key for one in wanted.tolerances] + [one.key for one in wanted.choices]
    if len(set(keys)) < len(keys):
        raise CampaignError("allocate: a key stands there twice")


def _check_that_shares_scale(units: Definition) -> None:
    if units.scenario.estimator.enabled:  # other tolerances make other gains of its filter
        raise CampaignError("allocate: tolerances are for navigation without the estimator")
    if units.correlate:  # what two keys do together grows with both of their tolerances
        raise CampaignError("allocate: tolerances are for keys that are not correlated")


def _with(wishes: Wishes, tolerances: Sequence[Tolerance], sigmas: Sequence[float]) -> Wishes:
    """Return wishes that give units these tolerances."""
    pairs = [
        (one.key, float(f"{sigma:.6g}")) for one, sigma in zip(tolerances, sigmas, strict=True)
    ]
    return replace(
        wishes,
        set=dict(wishes.set) | {key: sigma for key, sigma in pairs if draws(key)},
        vary=dict(wishes.vary)
        | {key: f"normal(0, {sigma!r})" for key, sigma in pairs if not draws(key)},
    )


def _cost(one: Tolerance, sigma: float) -> float:
    return float(one.cost * (one.at / sigma) ** one.power)


def _limit(one: Tolerance, sigma: float) -> str:
    for name, limit in (("least", one.least), ("most", one.most)):
        if math.isclose(sigma, limit, rel_tol=1e-3):
            return name
    return ""
