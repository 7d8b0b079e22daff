"""Covariance of a filter: propagation, and the measurement of a state in Joseph's form.

Bucy and Joseph, *Filtering for Stochastic Processes* (1968); Groves (2nd ed., 2013), (3.58). Only
symmetric sums are formed, so the covariance stays symmetric, and positive in spite of rounding.
"""

from __future__ import annotations

from rrins.dbc.compilation import compiled
from rrins.dbc.record import Floats


@compiled
def propagate(P: Floats, transition: Floats, work: Floats) -> None:
    """Replace P by ``Φ P Φᵀ``; all arrays have shape (n, n). Zeros of Φ cost nothing."""
    n = P.shape[0]
    for i in range(n):
        for k in range(n):
            work[i, k] = 0.0
        for j in range(n):
            factor = transition[i, j]
            if factor != 0.0:
                for k in range(n):
                    work[i, k] += factor * P[j, k]
    for i in range(n):
        for k in range(i + 1):
            P[i, k] = 0.0
        for j in range(n):
            factor = work[i, j]
            if factor != 0.0:
                for k in range(i + 1):
                    P[i, k] += factor * transition[k, j]
        for k in range(i):
            P[k, i] = P[i, k]


@compiled
def add_along(P: Floats, first: int, direction: Floats, variance: float) -> None:
    """Add the noise of some variance along a direction, shape (3,), of three states."""
    for i in range(3):
        for k in range(3):
            P[first + i, first + k] += direction[i] * direction[k] * variance


@compiled
def measure(
    x: Floats, P: Floats, state: int, measured: float, variance: float, gain: Floats, work: Floats
) -> tuple[float, float]:
    """Take a measurement of one state; return the innovation and its variance.

    Parameters
    ----------
    x : array, shape (n,)
    P : array, shape (n, n)
    state : int
    measured, variance : float
    gain : array, shape (n,)
        Scratch.
    work : array, shape (n, n)
        Scratch.
    """
    n = P.shape[0]
    innovation = measured - x[state]
    expected = P[state, state] + variance
    for i in range(n):
        gain[i] = P[i, state] / expected
    for i in range(n):
        x[i] += gain[i] * innovation
        for k in range(n):  # (I - K h) P, h picks the state
            work[i, k] = P[i, k] - gain[i] * P[state, k]
    for i in range(n):
        for k in range(i + 1):  # times (I - K h)', plus K r K'
            P[i, k] = work[i, k] - work[i, state] * gain[k] + gain[i] * variance * gain[k]
            P[k, i] = P[i, k]
    return innovation, expected
