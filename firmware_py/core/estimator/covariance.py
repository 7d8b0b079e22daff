"""Covariance of a filter: propagation, and measurements in Joseph's form.

Bucy and Joseph, *Filtering for Stochastic Processes* (1968); Groves (2nd ed., 2013), (3.58). Only
symmetric sums are formed, so the covariance stays symmetric, and positive in spite of rounding.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats


@compiled
def propagate(P: Floats, n: int, moving: int, transition: Floats, work: Floats) -> None:
    """Replace P by ``Φ P Φᵀ`` where only the first states move: the others' rows are those of I.

    Parameters
    ----------
    P : array, shape (at least n, at least n)
    n, moving : int
        States, and how many of them move.
    transition : array, shape (moving, at least n)
        Their rows of Φ.
    work : array, shape (moving, at least n)
        Scratch.
    """
    for i in range(moving):
        for k in range(n):
            work[i, k] = 0.0
        for j in range(n):
            factor = transition[i, j]
            if factor != 0.0:
                for k in range(n):
                    work[i, k] += factor * P[j, k]
    for i in range(moving):
        for k in range(i + 1):
            total = 0.0
            for j in range(n):
                total += work[i, j] * transition[k, j]
            P[i, k] = total
            P[k, i] = total
        for k in range(moving, n):
            P[i, k] = work[i, k]
            P[k, i] = work[i, k]


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


@compiled
def expect(P: Floats, n: int, row: Floats, variance: float, gain: Floats) -> float:
    """Return the variance of the innovation of a measurement ``row x``; `gain` becomes ``P rowᵀ``.

    Parameters
    ----------
    P : array, shape (at least n, at least n)
    n : int
        States.
    row : array, shape (at least n,)
    variance : float
        Of the measurement's noise.
    gain : array, shape (at least n,)
    """
    expected = variance
    for i in range(n):
        total = 0.0
        for k in range(n):
            if row[k] != 0.0:
                total += P[i, k] * row[k]
        gain[i] = total
        expected += row[i] * total
    return expected


@compiled
def update(x: Floats, P: Floats, n: int, gain: Floats, innovation: float, expected: float) -> None:
    """Take the measurement that `expect` looked at.

    Joseph's form multiplied out, for the gain ``K = P rowᵀ / S``:
    ``P - K (P rowᵀ)ᵀ - (P rowᵀ) Kᵀ + K S Kᵀ``.
    """
    for i in range(n):
        share = gain[i] / expected
        x[i] += share * innovation
        for k in range(i + 1):
            other = gain[k] / expected
            P[i, k] += share * expected * other - share * gain[k] - gain[i] * other
            P[k, i] = P[i, k]


@compiled
def update_two(
    x: Floats, P: Floats, n: int, gain: Floats, innovation: float, expected: float, at: int, to: int
) -> None:
    """Take the measurement for two states alone: the gain K of all others is zero.

    ``P - K (P rowᵀ)ᵀ - (P rowᵀ) Kᵀ + K S Kᵀ`` holds for any gain.
    """
    for i in range(n):
        is_own = i in (at, to)
        if is_own:
            x[i] += gain[i] / expected * innovation
        for k in range(i + 1):
            if is_own or k in (at, to):
                P[i, k] -= gain[i] * gain[k] / expected
                P[k, i] = P[i, k]
