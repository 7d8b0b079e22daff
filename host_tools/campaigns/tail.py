"""A far percentile, of which a campaign has few runs or none beyond, by a tail that is fitted.

What exceeds a high threshold is distributed as a generalised Pareto distribution (Pickands, *Annals
of Statistics* 3 (1975) 119). The largest tenth of the runs is fitted by maximum likelihood. The
interval is that of the profile likelihood (Coles, *An Introduction to Statistical Modeling of
Extreme Values* (2001), 4.3.3), with F for χ² as the runs are few, and wider than its confidence
asks: the limit distribution is not reached at a tenth. Unlike the other figures it believes that
the tail goes on as it begins.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import NOTHING, Estimate

FEWEST: Final = 400
"""Runs that a fit takes."""

_SHARE = 0.1  # of the runs, beyond the threshold
_CONFIDENCE = 0.98  # of the likelihood, for 95 %: `make soak` counts
_SHAPES = np.linspace(-0.75, 1.0, 15)
_FARTHEST = 8.0  # of an interval's end, as logarithm of its ratio to the value


def far_percentile(values: Floats, percent: float) -> Estimate:
    """Return a percentile beyond the 90th and its interval of 95 %.

    Parameters
    ----------
    values : array, shape (n,)
        Of independent runs; fewer than `FEWEST` that are known give `NOTHING`.
    percent : float

    Raises
    ------
    CampaignError
        When the percentile is not beyond the threshold of the fit.
    """
    from scipy.optimize import brentq, minimize_scalar
    from scipy.special import fdtri

    if not 100.0 * (1.0 - _SHARE) < percent < 100.0:
        raise CampaignError(f"percentile {percent:g}: a tail has those between 90 and 100")
    known = np.sort(values[np.isfinite(values)])
    beyond = int(_SHARE * len(known))
    if len(known) < FEWEST or not known[-1] > known[-beyond - 1]:
        return NOTHING
    threshold = float(known[-beyond - 1])
    tail = _Tail(known[-beyond:] - threshold, beyond / len(known) / (1.0 - percent / 100.0))
    near = math.log(tail.excesses[-1]) + np.arange(-9.0, 3.5, 0.5)
    start = max(near, key=tail.likelihood)
    best = minimize_scalar(lambda x: -tail.likelihood(x), bounds=(start - 0.5, start + 0.5))
    margin = 0.5 * float(fdtri(1, beyond - 2, _CONFIDENCE))

    def missing(x: float) -> float:
        return float(-best.fun) - tail.likelihood(x) - margin

    ends = []
    for sign in (-1.0, 1.0):
        far = next((d for d in np.arange(0.1, _FARTHEST, 0.1) if missing(best.x + sign * d) > 0), 0)
        end = brentq(missing, best.x, best.x + sign * far) if far else sign * math.inf
        ends.append(threshold + math.exp(end))
    return Estimate(threshold + math.exp(best.x), *ends)


class _Tail:
    """The excesses over a threshold, and their likelihood by the excess of the percentile.

    Parameters
    ----------
    excesses : array, shape (k,)
        Ascending.
    ratio : float
        Of the shares of runs beyond the threshold and beyond the percentile.
    """

    def __init__(self, excesses: Floats, ratio: float) -> None:
        self.excesses = excesses
        self._log_ratio = math.log(ratio)

    def likelihood(self, log_excess: float) -> float:
        """Return the largest logarithm of the likelihood, over all shapes, by the percentile's."""
        from scipy.optimize import minimize_scalar

        excess = math.exp(log_excess)
        found = [self._of(shape, excess) for shape in _SHAPES]
        at = int(np.argmax(found))
        around = _SHAPES[max(at - 1, 0)], _SHAPES[min(at + 1, len(_SHAPES) - 1)]
        nearby = minimize_scalar(lambda shape: -self._of(shape, excess), bounds=around)
        return float(max(found[at], -nearby.fun))

    def _of(self, shape: float, excess: float) -> float:
        if abs(shape) < 1e-6:  # the exponential distribution
            scale = excess / self._log_ratio
            return -len(self.excesses) * math.log(scale) - float(self.excesses.sum()) / scale
        scale = excess * shape / math.expm1(shape * self._log_ratio)
        inner = 1.0 + shape / scale * self.excesses
        if inner.min() <= 0.0:
            return -1e300
        logs = float(np.log(inner).sum())
        return -len(self.excesses) * math.log(scale) - (1.0 + 1.0 / shape) * logs
