"""Linear covariance analysis: σ of the navigation errors over time, and each source's share.

Every source is propagated by itself: constants as sensitivities, white noise and Markov processes
as covariances; the sources are independent, so their variances add up. Without aids the errors
follow the equations of `unaided`; with the firmware's filter, those of its closed loop (`aided`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.covariance.aided import Aided
from rrins.host_tools.covariance.linear import OUTPUTS, Moments, moments_together
from rrins.host_tools.covariance.model import Model
from rrins.host_tools.covariance.path import path_of
from rrins.host_tools.covariance.sources import Sources, Varied, sources_of
from rrins.host_tools.covariance.trace import trace_of
from rrins.host_tools.covariance.unaided import Unaided
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.units import ARCSEC
from rrins.host_tools.scenario.scenario import Scenario

QUANTITIES: Final = {
    "position_east_m": (0, 1.0),
    "position_north_m": (1, 1.0),
    "height_m": (2, 1.0),
    "velocity_east_mps": (3, 1.0),
    "velocity_north_mps": (4, 1.0),
    "velocity_up_mps": (5, 1.0),
    "tilt_east_arcsec": (6, ARCSEC),
    "tilt_north_arcsec": (7, ARCSEC),
    "heading_arcsec": (8, ARCSEC),
}
"""Quantities that have a σ: the output's number, and the unit in SI."""

assert len(QUANTITIES) == OUTPUTS


@dataclass(frozen=True)
class SourceResult:
    """The effect of an error source."""

    name: str
    covariance: Floats  #: shape (n, 2, 2); of the position to the east and north, m², over time
    variance: Floats  #: shape (n, 9); of each output, SI units

    @property
    def sigma(self) -> Floats:
        """σ of the position to the east and north, m, at `Analysis.times_s`, shape (n, 2).

        Negative where a correlation takes so much away.
        """
        variance = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(np.sign(variance) * np.sqrt(np.abs(variance)))

    @property
    def end(self) -> tuple[float, float]:
        """σ at the end, east and north, m."""
        return float(self.sigma[-1, 0]), float(self.sigma[-1, 1])

    @property
    def largest(self) -> float:
        """The largest σ on the way, of either direction, m."""
        return float(self.sigma.max())


@dataclass(frozen=True)
class Analysis:
    """A linear covariance analysis."""

    times_s: Floats  #: shape (n,); since navigation began
    #: shape (n, 2); what the constants of the scenario give that do not vary, m, east and north
    mean: Floats
    sigmas: Floats  #: shape (n, 9); σ of each of `QUANTITIES`, SI units
    filter_sigmas: Floats | None  #: the same, as the firmware's filter has them; None: it has none
    sources: list[SourceResult]  #: the largest at the end first
    left_out: list[str]  #: what errs and is not considered
    fixed: list[str]  #: constants of one value: they give the mean and no σ

    @property
    def sigma(self) -> Floats:
        """σ of the position to the east and north, m, shape (n, 2)."""
        return self.sigmas[:, :2]

    def share(self, source: SourceResult) -> float:
        """Return the share of a source in the horizontal variance at the end."""
        whole = float((self.sigma[-1] ** 2).sum())
        return float(np.trace(source.covariance[-1])) / whole if whole > 0 else 0.0

    def quantity(self, name: str) -> tuple[Floats, Floats | None]:
        """Return σ of one of `QUANTITIES` over time, and the filter's, in the name's unit."""
        at, unit = QUANTITIES[name]
        told = self.filter_sigmas
        return self.sigmas[:, at] / unit, None if told is None else told[:, at] / unit

    def told(self) -> JsonObject:
        """Return σ of each quantity at the end, the filter's beside it, and over time their ratio.

        `ratio` is true over filter, above 1 where the filter believes too much of itself; its
        limits are those after the first tenth of the time.
        """
        return {name: self._told(name) for name in QUANTITIES if self.quantity(name)[0].any()}

    def _told(self, name: str) -> JsonObject:
        true, told = self.quantity(name)
        values: JsonObject = {"sigma": float(true[-1])}
        if told is None:
            return values
        later = (self.times_s >= self.times_s[0] + 0.1 * np.ptp(self.times_s)) & (told > 0)
        ratio = true[later] / told[later]
        return values | {
            "filter_sigma": float(told[-1]),
            "ratio": float(true[-1] / told[-1]) if told[-1] > 0 else None,
            "least_ratio": float(ratio.min()) if len(ratio) else None,
            "largest_ratio": float(ratio.max()) if len(ratio) else None,
        }

    def values(self) -> JsonObject:
        """Return it as plain values."""
        return {
            "duration_s": float(self.times_s[-1]),
            "sigma_m": {"east": float(self.sigma[-1, 0]), "north": float(self.sigma[-1, 1])},
            "mean_m": {"east": float(self.mean[-1, 0]), "north": float(self.mean[-1, 1])},
            "quantities": self.told(),
            "sources": [self._values_of(one) for one in self.sources],
            "left_out": self.left_out,
            "fixed": self.fixed,
        }

    def _values_of(self, one: SourceResult) -> JsonObject:
        shares: dict[str, Any] = {
            name: float(one.variance[-1, at] / whole)
            for name, (at, _) in QUANTITIES.items()
            if (whole := float(self.sigmas[-1, at] ** 2)) > 0
        }
        return {
            "name": one.name,
            "east_m": one.end[0],
            "north_m": one.end[1],
            "largest_m": one.largest,
            "share": self.share(one),
            "shares": shares,
        }


def model_of(scenario: Scenario, true: Scenario | None = None) -> Model:
    """Return the linear error model of a scenario, aided by the firmware's filter if it has one.

    Parameters as of `analyse`.

    Raises
    ------
    RehearsalError
        When the analysis does not cover the scenario, or it does not navigate.
    """
    if scenario.estimator.enabled:
        return Aided(true or scenario, trace_of(scenario))
    if true is not None:
        raise RehearsalError("covariance: other true errors than told are for the estimator alone")
    if scenario.firmware.height_channel == "free":
        raise RehearsalError('covariance: is for a height_channel that is "held" or "damped"')
    if "-" in scenario.firmware.initial_attitude.removeprefix("self-"):
        raise RehearsalError("covariance: an attitude found in motion needs the estimator")
    return Unaided(scenario, path_of(scenario))


def analyse(
    scenario: Scenario, varied: Sequence[Varied] = (), true: Scenario | None = None
) -> Analysis:
    """Return the covariance analysis of a scenario.

    Parameters
    ----------
    scenario : Scenario
        With what it draws itself.
    varied : sequence of Varied, optional
        The inputs of a campaign.
    true : Scenario, optional
        With the errors as they are, where `scenario` has those that the firmware's filter is told.

    Raises
    ------
    RehearsalError
        When the analysis does not cover the scenario, or it does not navigate.
    """
    model = model_of(scenario, true)
    sources = sources_of(true or scenario, varied)
    found = _moments(model, sources)
    count = len(model.times_s)
    mean = sum((one.mean for one in found.values()), np.zeros((count, OUTPUTS)))
    results = [SourceResult(name, one.horizontal, one.variance) for name, one in found.items()]
    fixed = [one.name for one in results if not one.variance.any()]
    results = [one for one in results if one.variance.any()]
    whole = sum((one.variance for one in results), np.zeros((count, OUTPUTS)))
    results.sort(key=lambda one: -float(np.trace(one.covariance[-1])))
    return Analysis(
        times_s=model.times_s,
        mean=mean[:, :2],
        sigmas=np.sqrt(np.maximum(whole, 0.0)),
        filter_sigmas=model.filter_sigma() if isinstance(model, Aided) else None,
        sources=results,
        left_out=sorted(set(sources.left_out)),
        fixed=fixed,
    )


def _moments(model: Model, sources: Sources) -> dict[str, Moments]:
    """Return what each source does, by its name."""
    found = {one.name: model.of_drawn(one) for one in sources.drawn}
    found |= _together(model, sources)
    found |= {one.name: model.of_white(one) for one in sources.whites}
    found |= {one.name: model.of_process(one) for one in sources.processes}
    if isinstance(model, Aided):
        found |= {one.name: model.of_aid_noise(one) for one in sources.aid_noises}
        found |= {one.name: model.of_aid_process(one) for one in sources.aid_processes}
        if model.scenario.firmware.initial_attitude.startswith("self-aligned-"):
            found["firmware: attitude found in motion"] = model.of_filter_start()
    return found


def _together(model: Model, sources: Sources) -> dict[str, Moments]:
    """Return what pairs of sources do besides, whose inputs are correlated: it may be negative."""
    found = {}
    for one, other in combinations(sources.drawn, 2):
        cross = one.loading @ sources.correlation @ other.loading.T
        if cross.any():
            name = f"correlation of {one.name} and {other.name}"
            found[name] = moments_together(model.track(one), model.track(other), cross)
    return found
