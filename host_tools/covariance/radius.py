"""Percentiles of a horizontal distance whose components are normally distributed."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from rrins.compiled.record import Floats

_NODES = 96
_REACH = 9.0
"""σ beyond which a component does not come."""


def percentile_m(share: float, mean: Floats, covariance: Floats) -> float:
    """Return the distance below which a share of all positions lies, m.

    Parameters
    ----------
    share : float
        Between 0 and 1.
    mean : array, shape (2,)
        m.
    covariance : array, shape (2, 2)
        m².
    """
    from scipy.optimize import brentq

    variances, axes = np.linalg.eigh(covariance)
    sigmas, centre = np.sqrt(np.maximum(variances, 0.0)), axes.T @ mean
    most = float(np.hypot(*(np.abs(centre) + _REACH * sigmas)))
    if not sigmas[1] > 0.0:
        return float(np.hypot(*centre))
    return float(brentq(lambda r: _share(r, centre, sigmas) - share, 0.0, most, rtol=1e-12))


def _share(radius: float, centre: Floats, sigmas: Floats) -> float:
    """Return the share within a radius: over the larger component, that of the smaller one."""
    from scipy.special import ndtr

    reach = centre[1] - _REACH * sigmas[1], centre[1] + _REACH * sigmas[1]
    low, high = (min(max(end, -radius), radius) for end in reach)
    if not high > low:
        return 0.0
    nodes, weights = _rule()
    begin, end = math.asin(low / radius), math.asin(high / radius)  # no root at the circle's ends
    angle = 0.5 * (begin + end) + 0.5 * (end - begin) * nodes
    along, half = radius * np.sin(angle), radius * np.cos(angle)
    density = np.exp(-0.5 * ((along - centre[1]) / sigmas[1]) ** 2) / math.sqrt(2 * math.pi)
    smaller = max(float(sigmas[0]), 1e-12 * float(sigmas[1]))
    across = ndtr((half - centre[0]) / smaller) - ndtr((-half - centre[0]) / smaller)
    return float(0.5 * (end - begin) * np.sum(weights * density * across * half) / sigmas[1])


@cache
def _rule() -> tuple[Floats, Floats]:
    return np.polynomial.legendre.leggauss(_NODES)
