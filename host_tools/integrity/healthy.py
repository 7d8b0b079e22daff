"""Whether σ and level of healthy cases fit their errors, by preset and by aids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.files import JsonObject
from rrins.host_tools.integrity import cases
from rrins.host_tools.integrity.stanford import NAMES
from rrins.host_tools.integrity.trial import Result
from rrins.host_tools.scenario.scenario import Scenario


@dataclass(frozen=True)
class Healthy:
    """Healthy cases that have something in common."""

    group: str
    cases: int
    level_over_sigma: dict[str, float]  #: by bound, median of the cases' medians; NaN without any
    error_over_sigma: dict[str, float]  #: by bound, root mean square over the cases

    def values(self) -> JsonObject:
        """Return them as plain values; None for NaN."""

        def known(figures: dict[str, float]) -> JsonObject:
            return {
                name: value if math.isfinite(value) else None for name, value in figures.items()
            }

        return {
            "group": self.group,
            "cases": self.cases,
            "level_over_sigma": known(self.level_over_sigma),
            "error_over_sigma": known(self.error_over_sigma),
        }


def _aids(scenario: Scenario) -> str:
    """Return the aids of a scenario in words."""
    fitted = {
        "GNSS": scenario.gnss,
        "odometer": scenario.odometer,
        "altimeter": scenario.altimeter,
    }
    return ", ".join(name for name, aid in fitted.items() if aid is not None) or "no aid"


def healthy_of(results: Sequence[Result]) -> list[Healthy]:
    """Return the healthy ones among results: all, by preset of the sensors, by aids."""
    groups: dict[str, list[Result]] = {"all": []}
    own = [one for one in results if one.case.kind == cases.HEALTHY]
    for name in sorted({one.case.scenario.sensors or "" for one in own} - {""}):
        groups[name] = [one for one in own if one.case.scenario.sensors == name]
    for name in sorted({_aids(one.case.scenario) for one in own}):
        groups[name] = [one for one in own if _aids(one.case.scenario) == name]
    groups["all"] = own
    return [_group(name, members) for name, members in groups.items()]


def _group(name: str, members: Sequence[Result]) -> Healthy:
    levels = _columns([one.level_over_sigma for one in members])
    errors = _columns([one.error_over_sigma for one in members])
    return Healthy(
        name,
        len(members),
        {bound: float(np.median(own)) for bound, own in levels.items()},
        {bound: float(np.sqrt(np.mean(own**2))) for bound, own in errors.items()},
    )


def _columns(rows: Sequence[tuple[float, ...]]) -> dict[str, Floats]:
    """Return the known figures of each bound; a NaN where there is none."""
    columns = np.array(rows).reshape(-1, len(NAMES)).T
    known = [column[np.isfinite(column)] for column in columns]
    return {
        name: own if len(own) else np.full(1, math.nan)
        for name, own in zip(NAMES, known, strict=True)
    }
