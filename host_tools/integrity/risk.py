"""The share of misleading cases, and what that is per hour, by the rates that the unit assumes.

Faults are drawn, not waited for: a kind counts with its prior rate times the share of its cases
that mislead (importance sampling by strata). The priors are those of `[integrity]`. Faults that the
unit assumes never to happen are a kind of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rrins.host_tools.campaigns.statistics import CONFIDENCE, Estimate, proportion
from rrins.host_tools.integrity import cases
from rrins.host_tools.integrity.trial import Result
from rrins.host_tools.scenario.scenario import Scenario

_PAIR_WITHIN_H = 1.0
"""Two independent faults are a pair if both come within this time, hours."""


def prior_per_h(scenario: Scenario, kind: str, seconds: int) -> float | None:
    """Return how often an hour has a case of a kind; None where the unit assumes no rate.

    A healthy case counts as often as an hour has its length.
    """
    settings, rimu = scenario.integrity, scenario.rimu
    gyros = len(rimu.gyros) * settings.gyro_faults_per_h
    accelerometers = len(rimu.accelerometers) * settings.accelerometer_faults_per_h
    rates = {
        cases.HEALTHY: 3600.0 / max(seconds, 1),
        cases.GYRO: gyros,
        cases.ACCELEROMETER: accelerometers,
        cases.PAIR: 0.5 * _PAIR_WITHIN_H * (gyros + accelerometers) ** 2,
        cases.COMMON: 2 * settings.common_faults_per_h,
        cases.GNSS: settings.gnss_faults_per_h,
        cases.ODOMETER: settings.odometer_faults_per_h,
        cases.ALTIMETER: settings.altimeter_faults_per_h,
    }
    return rates.get(kind)


@dataclass(frozen=True)
class Stratum:
    """The cases of a kind."""

    kind: str
    cases: int
    misleading: int
    share: Estimate  #: of the misleading cases
    prior_per_h: float | None


def strata_of(results: Sequence[Result]) -> list[Stratum]:
    """Return the kinds of cases, in the order of the generator."""
    found = []
    for kind in cases.STRATA:
        own = [one for one in results if one.case.stratum == kind and one.seconds]
        if not own:
            continue
        misleading = sum(one.is_misleading for one in own)
        rates = [prior_per_h(one.case.scenario, kind, one.seconds) for one in own]
        known = [rate for rate in rates if rate is not None]
        prior = float(np.mean(known)) if known else None
        found.append(Stratum(kind, len(own), misleading, proportion(misleading, len(own)), prior))
    return found


def hourly(strata: Sequence[Stratum]) -> Estimate:
    """Return the rate of misleading cases per hour, with an interval that all strata share.

    Each stratum has its interval of Clopper and Pearson at a confidence that leaves all of them
    right at once as often as `CONFIDENCE` (Bonferroni). Kinds without a prior do not count.
    """
    known = [one for one in strata if one.prior_per_h is not None]
    each = 1.0 - (1.0 - CONFIDENCE) / max(1, len(known))
    total = np.zeros(3)
    for one in known:
        share = proportion(one.misleading, one.cases, each)
        total += (one.prior_per_h or 0.0) * np.array([share.value, share.low, share.high])
    return Estimate(*total.tolist())
