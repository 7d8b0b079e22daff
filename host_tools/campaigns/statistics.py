"""Figures of many runs, each with the interval that it is known by.

Intervals of percentiles are ranks of the binomial distribution, whatever the runs are distributed
like; between two ranks they are interpolated, so that they cover what they promise, not more
(Nyblom, "Note on interpolated order statistics", Statistics & Probability Letters 14 (1992) 129).
The bound of a percentile is a rank itself: a tolerance limit (Wilks, "Determination of sample sizes
for setting tolerance limits", Ann. Math. Statist. 12 (1941) 91). The interval of a mean is
Student's, that of a standard deviation Bonett's, which needs no normal distribution
(*Computational Statistics & Data Analysis* 50 (2006) 775).

Runs of a block have noise in common: they count as the effective number of independent ones, from
how their blocks differ (Korn and Graubard, *Survey Methodology* 24 (1998) 193).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.host_tools.files import JsonObject

Integers = NDArray[np.int64]

CONFIDENCE: Final = 0.95
PERCENTILES: Final = (5.0, 50.0, 90.0, 95.0, 99.0)

_RESAMPLES = 1000
_FEWEST = 8


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


def fewest_runs(percent: float, tail: float = 0.5 * (1.0 - CONFIDENCE)) -> int:
    """Return the runs that both ends of a percentile's interval take, each missed by `tail`."""
    share = max(percent, 100.0 - percent) / 100.0
    return math.ceil(math.log(tail) / math.log(share))


class Sample:
    """An output of some runs; those that have none do not count.

    Parameters
    ----------
    values : array, shape (n,)
    blocks : array, shape (n,), optional
        Whole numbers: runs of one number are not independent.
    confidence : float
        Of the intervals; above 0.95 where the number of runs depends on what they showed.
    """

    def __init__(
        self, values: Floats, blocks: Integers | None = None, confidence: float = CONFIDENCE
    ) -> None:
        is_known = np.isfinite(values)
        self.values = values[is_known]
        self._blocks = None
        self._units = len(self.values)
        if blocks is not None:
            numbers, self._blocks = np.unique(blocks[is_known], return_inverse=True)
            self._units = len(numbers)
        self._tail = 0.5 * (1.0 - confidence)

    def mean(self) -> Estimate:
        """Return the mean."""
        from scipy.special import stdtrit

        if not len(self.values):
            return NOTHING
        value = float(np.mean(self.values))
        if self._units < _FEWEST:
            return Estimate(value, -math.inf, math.inf)
        error = np.std(self.values, ddof=1) / math.sqrt(self._effective(self.values))
        half = float(stdtrit(self._units - 1, 1.0 - self._tail) * error)
        return Estimate(value, value - half, value + half)

    def sigma(self) -> Estimate:
        """Return the standard deviation."""
        values, count = self.values, len(self.values)
        if count < 2:
            return NOTHING
        value = float(np.std(values, ddof=1))
        squares = (values - values.mean()) ** 2
        if self._units < _FEWEST or not value > 0.0:
            return Estimate(value, -math.inf, math.inf)
        cut = int(count / (2.0 * math.sqrt(count - 4.0)))
        centre = np.sort(values)[cut : count - cut].mean()
        kurtosis = count * float(np.sum((values - centre) ** 4)) / float(squares.sum()) ** 2
        effective = self._effective(squares)
        z = self._quantile(squares)
        small = self._units / (self._units - z)
        error = small * math.sqrt(max(kurtosis - (effective - 3) / effective, 0.0))
        half = z * error / math.sqrt(effective - 1.0)
        low, high = (value * math.sqrt(small * math.exp(end)) for end in (-half, half))
        return Estimate(value, low, high)

    def percentile(self, percent: float) -> Estimate:
        """Return a percentile, the smallest value that so many of 100 do not exceed."""
        known, count = np.sort(self.values), len(self.values)
        if count == 0:
            return NOTHING
        share = percent / 100.0
        effective = self._effective_below(known, share)
        scale = (count + 1.0) / (effective + 1.0)
        low = _rank(effective, share, self._tail) * scale
        high = count + 1.0 - _rank(effective, 1.0 - share, self._tail) * scale
        return Estimate(
            float(known[_at(share, count)]),
            _between(known, low) if low > 0.0 else -math.inf,
            _between(known, high) if high < count + 1.0 else math.inf,
        )

    def bound(self, percent: float) -> float:
        """Return what a percentile is below with the confidence; infinity for too few runs."""
        from scipy.special import bdtr

        known, count = np.sort(self.values), len(self.values)
        if count == 0:
            return math.inf
        effective = self._effective_below(known, percent / 100.0)
        below = bdtr(np.arange(effective), effective, percent / 100.0)
        rank = 1 + int(np.searchsorted(below, 1.0 - 2.0 * self._tail))
        if rank > effective:
            return math.inf
        return float(known[min(math.ceil(rank * (count + 1) / (effective + 1)), count) - 1])

    def _effective(self, scores: Floats) -> float:
        """Return of how many independent runs the mean of some scores is as certain."""
        count = len(scores)
        variance = float(np.var(scores))
        if self._blocks is None or not variance > 0.0:
            return float(self._units)
        sums = np.bincount(self._blocks, scores - scores.mean())
        of_mean = self._units / (self._units - 1.0) * float(sums @ sums) / count**2
        return min(max(variance / max(of_mean, 1e-300), float(self._units)), float(count))

    def _quantile(self, scores: Floats) -> float:
        """Return by how many of its standard errors a mean of scores may be off.

        Of blocks by Student's t, with the freedom of a χ² whose variance is that of the blocks'
        (Satterthwaite, *Biometrics Bulletin* 2 (1946) 110): few of them may make most of it.
        """
        from scipy.special import ndtri, stdtrit

        if self._blocks is None:
            return -float(ndtri(self._tail))
        sums, count = np.bincount(self._blocks, scores - scores.mean()), self._units
        sums -= sums.mean()
        kurtosis = count * float(np.sum(sums**4)) / float(sums @ sums) ** 2
        freedom = min(2.0 * count / (kurtosis - (count - 3.0) / (count - 1.0)), count - 1.0)
        return -float(stdtrit(freedom, self._tail))

    def _effective_below(self, known: Floats, share: float) -> int:
        """Return how many independent runs say as much of a percentile.

        As little as they say of the median, for the few beyond a far percentile may hide how much
        blocks differ; of few blocks each counts as a run.
        """
        from scipy.special import stdtrit

        count = len(known)
        if self._blocks is None:
            return count
        if self._units < fewest_runs(100.0 * share, self._tail):
            return self._units
        limits = (known[_at(share, count)], known[_at(0.5, count)])
        effective = min(self._effective((self.values <= limit) * 1.0) for limit in limits)
        quantiles = stdtrit((count - 1, self._units - 1), 1.0 - self._tail)
        return max(int(effective * (quantiles[0] / quantiles[1]) ** 2), 1)


def _at(share: float, count: int) -> int:
    """Return the index of the smallest value that a share does not exceed."""
    return min(max(math.ceil(share * count - 1e-9), 1), count) - 1


def _rank(count: int, share: float, tail: float) -> float:
    """Return the place, from 1 on, of what a percentile is below with a probability `tail`.

    0 where even the smallest of so many runs is not.
    """
    from scipy.special import bdtr

    beyond = np.concatenate([[0.0], bdtr(np.arange(count), count, share)])
    k = int(np.searchsorted(beyond, tail, side="right")) - 1
    if not 1 <= k < count:
        return float(k)
    above, below = k * (1.0 - share) * (beyond[k + 1] - tail), (count - k) * share
    below *= tail - beyond[k]
    return k + float(below / (above + below))


def _between(known: Floats, place: float) -> float:
    """Return the value at a place, from 1 on, of sorted ones."""
    return float(np.interp(place, np.arange(1.0, len(known) + 1.0), known))


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


def rows_of_blocks(blocks: Integers) -> Integers:
    """Return the runs of each block, a row a block; -1 where it has fewer than others."""
    numbers, at, sizes = np.unique(blocks, return_inverse=True, return_counts=True)
    rows = np.full((len(numbers), sizes.max(initial=1)), -1)
    order = np.argsort(at, kind="stable")
    rows[np.arange(rows.shape[1]) < sizes[:, None]] = order
    return rows


def drawn(rows: Integers, picked: Integers) -> Integers:
    """Return the runs of the blocks that are picked."""
    runs = rows[picked].ravel()
    return runs[runs >= 0]


def resampled(
    figure: Callable[..., float],
    *samples: Floats,
    blocks: Sequence[Integers],
    is_paired: bool = False,
) -> Estimate:
    """Return a figure of samples with its bootstrap interval (percentiles of resamples).

    Parameters
    ----------
    figure : callable
        Of one array per sample.
    *samples : array, shape (n,)
    blocks : sequence of array, shape (n,)
        Of each sample; runs of one number stay together.
    is_paired : bool
        Whether values of one place belong together.
    """
    from scipy.stats import bootstrap

    rows = [rows_of_blocks(one) for one in blocks]
    value = figure(*samples)
    if min(map(len, rows)) < _FEWEST:
        return Estimate(value, -math.inf, math.inf)

    def of(*picked: Integers) -> float:
        runs = map(drawn, rows, picked)
        return figure(*(one[at] for one, at in zip(samples, runs, strict=True)))

    low, high = bootstrap(
        [np.arange(len(one)) for one in rows],
        of,
        n_resamples=_RESAMPLES,
        vectorized=False,
        paired=is_paired,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng([0, *map(len, samples)]),
    ).confidence_interval
    return Estimate(value, float(low), float(high))


FIGURES: Final[dict[str, Callable[[Sample], Estimate]]] = {
    "mean": Sample.mean,
    "sigma": Sample.sigma,
    "median": lambda sample: sample.percentile(50.0),
}
"""Figures by name; percentiles are ``p95`` and the like."""


def figure_of(name: str) -> Callable[[Sample], Estimate] | None:
    """Return the figure of a name; None if there is none."""
    if name in FIGURES:
        return FIGURES[name]
    percent = percent_of(name)
    return None if percent is None else lambda sample: sample.percentile(percent)


def percent_of(name: str) -> float | None:
    """Return of which percentile a name is; None if of none."""
    try:
        percent = float(name.removeprefix("p")) if name.startswith("p") else math.nan
    except ValueError:
        return None
    return percent if 0.0 < percent < 100.0 else None
