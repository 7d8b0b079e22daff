"""Covariance of a bias that wanders, for the σ of a calibration.

Bias instability is the sum of Gauss-Markov processes that IEEE Std 952 (annex C) describes, each at
zero when the sensors are switched on; random walk comes on top.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.memory import FLICKER_POLES
from rrins.host_tools.hardware.settings import FLICKER_RATIO, FLICKER_SHORTEST_S

BATCH = 20
"""Rows in which a bias that wanders is taken as the same."""

_TIMES_S = FLICKER_SHORTEST_S * FLICKER_RATIO ** np.arange(FLICKER_POLES)
_CERTAIN = 16.0  # of twice the logarithm of the likelihood
_EXCESS = 2.0
"""Times the data sheet's instability, from which on what the residuals show counts."""


def first_rows(count: int) -> np.ndarray:
    """Return the first row of each batch."""
    return np.arange(0, count, BATCH)


def wander_covariance(times: Floats, instability: float, random_walk: float) -> Floats:
    """Return the covariance of a bias at some times since power-on, shape (n, n).

    Parameters
    ----------
    times : array, shape (n,)
    instability, random_walk : float
        rad/s or m/s²; of that, per root of a second.
    """
    lag, both = np.abs(times[:, None] - times), times[:, None] + times
    found = random_walk**2 * np.minimum(times[:, None], times)
    variance = instability**2 * math.log(FLICKER_RATIO) / math.pi
    for time_s in _TIMES_S:
        found += variance * (np.exp(-lag / time_s) - np.exp(-both / time_s))
    return found


def instability_of(
    residuals: Floats, noise: float, columns: Floats, times: Floats, stated: float | None
) -> float:
    """Return the bias instability of a sensor: as stated, or what its residuals show if more.

    The likeliest one, of the residuals' means over batches less what has been fitted; where none is
    stated, the mean square of all, each as likely as the residuals make it.

    Parameters
    ----------
    residuals : array, shape (n,)
        Of rates or forces; NaN where a second does not count.
    noise : float
        White noise of a residual.
    columns : array, shape (n, p)
        Derivatives by what has been fitted.
    times : array, shape (n,)
    stated : float, optional
        In the data sheet; None if unknown.
    """
    is_known, stated = stated is not None, stated or 0.0
    first = first_rows(len(residuals))
    counts = np.add.reduceat(np.isfinite(residuals) * 1.0, first)
    is_whole = counts == BATCH
    if is_whole.sum() < columns.shape[1] + 8:
        return stated
    means = np.add.reduceat(np.nan_to_num(residuals), first)[is_whole] / BATCH
    fitted = np.add.reduceat(columns, first)[is_whole]
    whole, size, _ = np.linalg.svd(fitted / np.linalg.norm(fitted, axis=0).clip(1e-300))
    free = whole[:, np.sum(size > 1e-9 * size[0]) :]  # what is not fitted
    white = max(noise**2 / BATCH, 1e-30)
    C = free.T @ wander_covariance(times[first][is_whole], 1.0, 0.0) @ free
    of_one, axes = np.linalg.eigh(C)
    squares = (axes.T @ free.T @ means) ** 2
    sizes = np.concatenate([[0.0], math.sqrt(white) * np.geomspace(0.03, 300.0, 200)])
    variances = sizes[:, None] ** 2 * of_one.clip(0.0) + white
    unlikely = np.sum(np.log(variances) + squares / variances, axis=1)
    best = int(np.argmin(unlikely))
    is_certain = unlikely[0] - unlikely[best] > _CERTAIN
    shown = float(sizes[best])
    if is_known:
        return shown if is_certain and shown > _EXCESS * stated else stated
    weights = np.exp(0.5 * (unlikely[best] - unlikely)) * np.gradient(sizes)
    return float(np.sqrt(weights @ sizes**2 / weights.sum()))
