"""Uniform quintic B-splines: four times continuously differentiable, a piece per knot interval.

A spline of n pieces has n + 5 coefficients. On piece i, with u from 0 to 1 across it::

    s(u) = [1 u u² u³ u⁴ u⁵] M [c_i … c_(i+5)]ᵀ

scipy evaluates splines; M makes the pieces that the compiled step evaluates, and the rows of fits,
whose rounding every built-in drive would show.

Time in this module is measured in pieces; `step_s` converts derivatives to those per second.

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

from rrins.compiled.record import Floats, Integers

DEGREE = 5
ORDER = DEGREE + 1
_CORRECTIONS = 8


def _basis_matrix() -> Floats:
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
"""Weights of the five coefficients around a knot in its value: (1, 26, 66, 26, 1) / 120."""


def derivative(monomials: Floats, times: int = 1) -> Floats:
    """Return monomials (lowest first, last axis) of the derivative with respect to u."""
    for _ in range(times):
        monomials = monomials[..., 1:] * np.arange(1, monomials.shape[-1])
    return monomials


def horner(monomials: Floats, u: Floats) -> Floats:
    """Return the polynomials' values; `u` broadcasts against the leading axes of `monomials`."""
    value = np.zeros(np.broadcast_shapes(monomials.shape[:-1], u.shape))
    for power in range(monomials.shape[-1] - 1, -1, -1):
        value = value * u + monomials[..., power]
    return value


def monomials_of(coefficients: Floats) -> Floats:
    """Return the pieces' monomials, shape (n, channels, 6), of coefficients (n + 5, channels).

    Where all six coefficients of a piece are equal, the piece is exactly constant.
    """
    windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER, axis=0)
    first = windows[..., :1]
    monomials = (windows - first) @ BASIS.T
    monomials[..., 0] += first[..., 0]
    return np.asarray(monomials)


def _located(times: Floats, pieces: int) -> tuple[Integers, Floats]:
    """Return piece and u for times measured in pieces."""
    index = np.clip(np.floor(times).astype(np.int64), 0, pieces - 1)
    return index, times - index


def _basis_rows(u: Floats, order: int) -> Floats:
    """Return the weights of the six coefficients in the derivative at u, shape (m, 6)."""
    slopes = derivative(BASIS.T, order)  # (coefficient, power)
    return u[:, None] ** np.arange(slopes.shape[1]) @ slopes.T


@dataclass(frozen=True)
class Observations:
    """Observations for a spline to fit.

    Attributes
    ----------
    values, deviations : array, shape (m,)
        Observed values of the derivative and their standard deviations.
    """

    times: Floats  #: shape (m,); measured in pieces from the beginning of the spline
    values: Floats
    deviations: Floats
    order: int = 0  #: order of the derivative with respect to time in s: 0 for the value itself


@dataclass(frozen=True)
class Grid:
    """Pieces of a spline that is constant over some of them."""

    pieces: int
    step_s: float  #: length of a piece, s
    #: first and last (excluded) piece of spans that are exactly constant, in order
    still: tuple[tuple[int, int], ...] = ()

    @property
    def groups(self) -> Integers:
        """Index of the unknown that each coefficient stands for; shape (pieces + 5,)."""
        new = np.ones(self.pieces + DEGREE, dtype=np.int64)
        for first, last in self.still:
            if last > first:
                new[first + 1 : last + DEGREE] = 0
        return np.cumsum(new) - new[0]


class Fit:
    """Penalised least squares: sums of weighted squares and of the mean square third derivative.

    Minimises, with x the spline and q the density of its third derivative::

        Σ ((x^(k)(t_i) - y_i) / σ_i)² + (1/q²) ∫ x'''² dt

    The normal matrix is ill-conditioned if observations are far apart. Its solution is refined with
    the gradient, which differences of neighbouring coefficients yield without loss of precision.
    """

    def __init__(self, grid: Grid, density: float) -> None:
        self._grid = grid
        self._groups = grid.groups
        self._unknowns = int(self._groups[-1]) + 1
        self._band = np.zeros((ORDER, self._unknowns))
        self._observed: list[tuple[Observations, Integers, Floats]] = []
        third = derivative(BASIS.T, 3)
        powers = np.arange(third.shape[1])
        gram = third @ (1 / (powers[:, None] + powers + 1)) @ third.T
        self._gram = gram / (grid.step_s**5 * density**2)
        self._every = np.arange(grid.pieces)
        self._add_products(self._every, np.broadcast_to(self._gram, (grid.pieces, ORDER, ORDER)))

    def _add_products(self, index: Integers, products: Floats) -> None:
        """Add a 6 x 6 block per piece to the normal matrix, with tied unknowns merged."""
        for j in range(ORDER):
            row = self._groups[index + j]
            for k in range(j, ORDER):
                column = self._groups[index + k]
                # An off-diagonal pair stands for two entries; merged, both lie on the diagonal.
                twice = 1 + ((row == column) & (j != k))
                flat = (column - row) * self._unknowns + row
                added = np.bincount(flat, products[:, j, k] * twice, self._band.size)
                self._band += added.reshape(self._band.shape)

    def add(self, observed: Observations) -> None:
        """Add observations."""
        index, u = _located(observed.times, self._grid.pieces)
        rows = _basis_rows(u, observed.order) / self._grid.step_s**observed.order
        weights = observed.deviations**-2.0
        self._add_products(index, np.einsum("m,mj,mk->mjk", weights, rows, rows))
        self._observed.append((observed, index, rows))

    def _downhill(self, coefficients: Floats) -> Floats:
        """Return minus half the gradient of the cost, for each unknown."""
        windows = np.lib.stride_tricks.sliding_window_view(coefficients, ORDER)
        found = np.zeros(self._unknowns)

        def add(index: Integers, shares: Floats) -> None:
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

    def solve(self) -> Floats:
        """Return the coefficients, shape (pieces + 5,).

        Raises
        ------
        numpy.linalg.LinAlgError
            If the observations do not determine them.
        """
        from scipy.linalg import cho_solve_banded, cholesky_banded  # slow to import

        factor = cholesky_banded(self._band, lower=True)
        solution = np.zeros(self._unknowns)
        for _ in range(_CORRECTIONS):
            change = cho_solve_banded((factor, True), self._downhill(solution[self._groups]))
            solution += change
            if np.abs(change).max() <= 1e-12 * np.abs(solution).max():
                break
        return np.asarray(solution[self._groups])


def evaluate(coefficients: Floats, times: Floats, step_s: float = 1.0, order: int = 0) -> Floats:
    """Return splines, or their derivatives per second, at times measured in pieces.

    Parameters
    ----------
    coefficients : array, shape (n + 5,) or (n + 5, channels)
    times : array, shape (m,)
    step_s : float
        Length of a piece, s.
    order : int
        Order of the derivative.

    Returns
    -------
    array, shape (m,) or (m, channels)
        Derivatives of a constant are exactly zero.
    """
    from scipy.interpolate import BSpline  # slow to import

    knots = np.arange(-DEGREE, len(coefficients) + 1, dtype=np.float64)
    spline = BSpline(knots, coefficients, DEGREE)
    return np.asarray((spline.derivative(order) if order else spline)(times) / step_s**order)
