"""Uniform quintic B-splines: four times continuously differentiable, a piece per knot interval.

A spline of n pieces has n + 5 coefficients. On piece i, with u from 0 to 1 across it::

    s(u) = [1 u u² u³ u⁴ u⁵] M [c_i … c_(i+5)]ᵀ

Time in this module counts in pieces; `step_s` turns derivatives into those with respect to seconds.

References
----------
Qin, "General matrix representations for B-splines", *The Visual Computer* 16 (2000), eq. (9), for
M; Eilers and Marx, "Flexible smoothing with B-splines and penalties", *Statistical Science* 11
(1996), for penalised least squares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

DEGREE = 5
ORDER = DEGREE + 1
_CORRECTIONS = 8


def _basis_matrix() -> Vector:
    """Return M, shape (power, coefficient), exact before it is rounded."""
    rows = []
    for power in range(ORDER):
        lead = Fraction(math.comb(DEGREE, power), math.factorial(DEGREE))
        rows.append(
            [
                lead
                * sum(
                    (-1) ** (s - j) * math.comb(ORDER, s - j) * (DEGREE - s) ** (DEGREE - power)
                    for s in range(j, ORDER)
                )
                for j in range(ORDER)
            ]
        )
    return np.array(rows, dtype=np.float64)


BASIS = _basis_matrix()
"""M: monomials of a piece from its six coefficients, shape (6, 6)."""

AT_KNOTS = BASIS[0, :DEGREE]
"""What the five coefficients about a knot weigh in the value there: (1, 26, 66, 26, 1) / 120."""


def derivative(monomials: Vector, times: int = 1) -> Vector:
    """Return monomials (lowest first, last axis) of the derivative with respect to u."""
    for _ in range(times):
        monomials = monomials[..., 1:] * np.arange(1, monomials.shape[-1])
    return monomials


def horner(monomials: Vector, u: Vector) -> Vector:
    """Return the polynomials' values; `u` broadcasts against the leading axes of `monomials`."""
    value = np.zeros(np.broadcast_shapes(monomials.shape[:-1], u.shape))
    for power in range(monomials.shape[-1] - 1, -1, -1):
        value = value * u + monomials[..., power]
    return value


def monomials_of(coefficients: Vector) -> Vector:
    """Return the pieces' monomials, shape (n, channels, 6), of coefficients (n + 5, channels).

    Where all six coefficients of a piece are equal, the piece is exactly constant.
    """
    windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER, axis=0)
    first = windows[..., :1]
    monomials = (windows - first) @ BASIS.T
    monomials[..., 0] += first[..., 0]
    return np.asarray(monomials)


def _located(times: Vector, pieces: int) -> tuple[NDArray[np.int64], Vector]:
    """Return piece and u of times counted in pieces."""
    index = np.clip(np.floor(times).astype(np.int64), 0, pieces - 1)
    return index, times - index


def _rows(u: Vector, order: int) -> Vector:
    """Return the weights of the six coefficients in the derivative at u, shape (m, 6)."""
    slopes = derivative(BASIS.T, order)  # (coefficient, power)
    return u[:, None] ** np.arange(slopes.shape[1]) @ slopes.T


@dataclass(frozen=True)
class Observations:
    """What a spline is to come close to.

    Attributes
    ----------
    times : array, shape (m,)
        Counted in pieces from the beginning of the spline.
    values, deviations : array, shape (m,)
        Observed values of the derivative and their standard deviations.
    order : int
        Of the derivative with respect to time in s: 0 for the value itself.
    """

    times: Vector
    values: Vector
    deviations: Vector
    order: int = 0


@dataclass(frozen=True)
class Grid:
    """Pieces of a spline that is constant over some of them.

    Attributes
    ----------
    pieces : int
    step_s : float
        Length of a piece, s.
    still : tuple of (int, int)
        First and last piece (not included) of spans that are exactly constant, in order.
    """

    pieces: int
    step_s: float
    still: tuple[tuple[int, int], ...] = ()

    @property
    def groups(self) -> NDArray[np.int64]:
        """For each coefficient the number of the unknown that it is; shape (pieces + 5,)."""
        new = np.ones(self.pieces + DEGREE, dtype=np.int64)
        for first, last in self.still:
            if last > first:
                new[first + 1 : last + DEGREE] = 0
        return np.cumsum(new) - new[0]


class Fit:
    """Penalised least squares: sums of weighted squares and of the mean square third derivative.

    Minimises, with x the spline and q the density of its third derivative::

        Σ ((x^(k)(t_i) - y_i) / σ_i)² + (1/q²) ∫ x'''² dt

    The normal matrix is ill-conditioned where observations lie far apart. Its solution is corrected
    by the gradient there, which the differences of neighbouring coefficients give without loss.
    """

    def __init__(self, grid: Grid, density: float) -> None:
        self._grid = grid
        self._groups = grid.groups
        self._unknowns = int(self._groups[-1]) + 1
        self._band = np.zeros((ORDER, self._unknowns))
        self._observed: list[tuple[Observations, NDArray[np.int64], Vector]] = []
        third = derivative(BASIS.T, 3)
        powers = np.arange(third.shape[1])
        gram = third @ (1 / (powers[:, None] + powers + 1)) @ third.T
        self._gram = gram / (grid.step_s**5 * density**2)
        self._every = np.arange(grid.pieces)
        self._add_products(self._every, np.broadcast_to(self._gram, (grid.pieces, ORDER, ORDER)))

    def _add_products(self, index: NDArray[np.int64], products: Vector) -> None:
        """Add a 6 x 6 block per piece to the normal matrix, unknowns that are one merged."""
        for j in range(ORDER):
            row = self._groups[index + j]
            for k in range(j, ORDER):
                column = self._groups[index + k]
                # Off the diagonal a pair stands for two entries; merged, for both on it.
                twice = 1 + ((row == column) & (j != k))
                flat = (column - row) * self._unknowns + row
                added = np.bincount(flat, products[:, j, k] * twice, self._band.size)
                self._band += added.reshape(self._band.shape)

    def add(self, observed: Observations) -> None:
        """Add observations."""
        index, u = _located(observed.times, self._grid.pieces)
        rows = _rows(u, observed.order) / self._grid.step_s**observed.order
        weights = observed.deviations**-2.0
        self._add_products(index, np.einsum("m,mj,mk->mjk", weights, rows, rows))
        self._observed.append((observed, index, rows))

    def _downhill(self, coefficients: Vector) -> Vector:
        """Return minus half the gradient of what is minimised, for each unknown."""
        windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER)
        found = np.zeros(self._unknowns)

        def add(index: NDArray[np.int64], shares: Vector) -> None:
            for j in range(ORDER):
                found[:] += np.bincount(self._groups[index + j], shares[:, j], self._unknowns)

        middle = windows[:, 2]
        apart = windows - middle[:, None]
        add(self._every, -apart @ self._gram)
        for one, index, rows in self._observed:
            reached = np.einsum("mj,mj->m", apart[index], rows)
            off = one.values - reached - (middle[index] if one.order == 0 else 0.0)
            add(index, (off / one.deviations**2)[:, None] * rows)
        return found

    def solve(self) -> Vector:
        """Return the coefficients, shape (pieces + 5,).

        Raises
        ------
        numpy.linalg.LinAlgError
            When the observations do not determine them.
        """
        from scipy.linalg import cho_solve_banded, cholesky_banded  # takes a while to load

        factor = cholesky_banded(self._band, lower=True)
        solution = np.zeros(self._unknowns)
        for _ in range(_CORRECTIONS):
            change = cho_solve_banded((factor, True), self._downhill(solution[self._groups]))
            solution += change
            if np.abs(change).max() <= 1e-12 * np.abs(solution).max():
                break
        return np.asarray(solution[self._groups])


def evaluate(coefficients: Vector, times: Vector, step_s: float = 1.0, order: int = 0) -> Vector:
    """Return a derivative of a spline (one channel) at times counted in pieces."""
    index, u = _located(times, len(coefficients) - DEGREE)
    windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER)[index]
    first = windows[:, :1]
    value = ((windows - first) * _rows(u, order)).sum(axis=1) / step_s**order
    return np.asarray(value + first[:, 0] if order == 0 else value)
