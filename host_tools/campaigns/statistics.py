"""Figures of many runs, each with the interval that it is known by.

Percentiles are order statistics; their bootstrap intervals are exact, without resampling: the
index of a resampled order statistic is distributed as a beta variable (Efron, *The Jackknife, the
Bootstrap and Other Resampling Plans*, SIAM 1982; Hutson and Ernst, "The exact bootstrap mean and
variance of an L-estimator", J. R. Stat. Soc. B 62 (2000)). Other figures are resampled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.files import JsonObject

CONFIDENCE: Final = 0.95
PERCENTILES: Final = (5.0, 50.0, 90.0, 95.0, 99.0)

_RESAMPLES = 1000
_FEWEST = 8
_MOST_AT_ONCE = 1 << 20  # numbers
_FEWEST_BEYOND = 4.0
"""Runs beyond a percentile, from which on its interval means something."""


@dataclass(frozen=True)
class Estimate:
    """A figure and its interval of 95 % confidence; infinite where the runs are too few.

    Attributes
    ----------
    value, low, high : float
    """

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half of the interval's width."""
        return 0.5 * (self.high - self.low)

    def values(self) -> JsonObject:
        """Return the figure as plain values; null for infinity and where there is none."""
        return {key: value if math.isfinite(value) else None for key, value in asdict(self).items()}


NOTHING: Final = Estimate(math.nan, -math.inf, math.inf)


def percentile(values: Floats, percent: float) -> Estimate:
    """Return a percentile of values, the smallest that so many of 100 do not exceed."""
    from scipy.special import betaincinv

    known = np.sort(values[np.isfinite(values)])
    count = len(known)
    if count == 0:
        return NOTHING
    share = percent / 100.0
    k = min(max(math.ceil(share * count - 1e-9), 1), count)
    value = float(known[k - 1])
    if count * min(share, 1.0 - share) < _FEWEST_BEYOND:
        return Estimate(value, -math.inf, math.inf)
    tail = 0.5 * (1.0 - CONFIDENCE)
    places = betaincinv(k, count - k + 1, (tail, 1.0 - tail))
    low, high = (min(max(math.ceil(count * float(p)), 1), count) for p in places)
    return Estimate(value, float(known[low - 1]), float(known[high - 1]))


def proportion(hits: float, of: float, confidence: float = CONFIDENCE) -> Estimate:
    """Return the share of some trials, with its interval of Clopper and Pearson.

    *Biometrika* 26 (1934) 404. Numbers need not be whole: for shares of unequal weight, the trials
    are the effective number (Korn and Graubard, *Survey Methodology* 24 (1998) 193).
    """
    from scipy.special import betaincinv

    if of <= 0:
        return NOTHING
    tail = 0.5 * (1.0 - confidence)
    low = float(betaincinv(hits, of - hits + 1, tail)) if hits > 0 else 0.0
    high = float(betaincinv(hits + 1, of - hits, 1.0 - tail)) if hits < of else 1.0
    return Estimate(hits / of, low, high)


def weighted_proportion(hits: Floats, of: Floats, weights: Floats) -> Estimate:
    """Return the share over strata of different weight, with its interval of Korn and Graubard.

    Parameters
    ----------
    hits, of : array, shape (n,)
        Of the trials of each stratum; one without trials does not count.
    weights : array, shape (n,)
    """
    is_known = of > 0
    hits, of, weights = hits[is_known], of[is_known], weights[is_known]
    if not weights.sum() > 0:
        return NOTHING
    weights = weights / weights.sum()
    effective = 1.0 / float(np.sum(weights * weights / of))
    share = min(1.0, float(np.sum(weights * hits / of)))
    return proportion(share * effective, effective)


def resampled(figure: Callable[..., Floats], *samples: Floats, is_paired: bool = False) -> Estimate:
    """Return a figure of samples with its bootstrap interval (percentiles of resamples).

    Parameters
    ----------
    figure : callable
        Of one array per sample, along `axis`.
    *samples : array, shape (n,)
    is_paired : bool
        Whether values of one place belong together.
    """
    from scipy.stats import bootstrap

    count = sum(map(len, samples))
    value = float(figure(*samples, axis=-1))
    if min(map(len, samples)) < _FEWEST:
        return Estimate(value, -math.inf, math.inf)
    low, high = bootstrap(
        samples,
        figure,
        n_resamples=_RESAMPLES,
        batch=max(1, _MOST_AT_ONCE // count),
        vectorized=True,
        paired=is_paired,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng([0, *map(len, samples)]),
    ).confidence_interval
    return Estimate(value, float(low), float(high))


def mean(values: Floats) -> Estimate:
    """Return the mean."""
    known = values[np.isfinite(values)]
    return resampled(np.mean, known) if len(known) else NOTHING


def sigma(values: Floats) -> Estimate:
    """Return the standard deviation."""
    known = values[np.isfinite(values)]
    return resampled(_deviation, known) if len(known) > 1 else NOTHING


def _deviation(values: Floats, axis: int) -> Floats:
    return np.asarray(np.std(values, axis=axis, ddof=1))


FIGURES: Final[dict[str, Callable[[Floats], Estimate]]] = {
    "mean": mean,
    "sigma": sigma,
    "median": lambda values: percentile(values, 50.0),
}
"""Figures by name; percentiles are ``p95`` and the like."""

RESAMPLED: Final = frozenset({"mean", "sigma"})
"""Figures whose interval takes resampling."""


def figure_of(name: str) -> Callable[[Floats], Estimate] | None:
    """Return the figure of a name; None if there is none."""
    if name in FIGURES:
        return FIGURES[name]
    try:
        percent = float(name.removeprefix("p")) if name.startswith("p") else math.nan
    except ValueError:
        return None
    if not 0.0 < percent < 100.0:
        return None
    return lambda values: percentile(values, percent)
