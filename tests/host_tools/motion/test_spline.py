"""Quintic splines against scipy's, and fits against what they must reproduce."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from rrins.host_tools.motion import spline
from rrins.host_tools.motion.spline import Fit, Grid, Observations


@pytest.fixture
def coefficients():
    return np.random.default_rng(1).normal(size=16)


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_values_and_derivatives_are_those_of_the_pieces(coefficients, order):
    times = np.linspace(0, 11, 200)
    pieces = spline.derivative(spline.monomials_of(coefficients[:, None])[:, 0], order)
    index = np.minimum(times.astype(int), 10)
    expected = spline.horner(pieces[index], times - index) / 0.25**order
    found = spline.evaluate(coefficients, times, 0.25, order)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(expected).max())


def test_channels_are_evaluated_together_and_derivatives_of_rest_are_zero(coefficients):
    both = np.stack([coefficients, np.full(16, 0.1)], axis=1)
    times = np.linspace(0, 11, 50)
    assert np.array_equal(spline.evaluate(both, times)[:, 0], spline.evaluate(coefficients, times))
    assert not spline.evaluate(both, times, 1.0, 1)[:, 1].any()


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_matrix_is_scipys_basis(order):
    u = np.linspace(0, 1, 30)
    basis = BSpline(np.arange(-5, 7), np.eye(6), 5)
    expected = (basis.derivative(order) if order else basis)(u)
    slopes = spline.derivative(spline.BASIS.T, order)
    found = u[:, None] ** np.arange(slopes.shape[1]) @ slopes.T
    assert found == pytest.approx(expected, abs=1e-14)


def test_monomials_are_the_pieces(coefficients):
    pieces = spline.monomials_of(coefficients[:, None])[:, 0]
    u = np.linspace(0, 1, 5)
    found = spline.horner(pieces[:, None, :], u)
    times = (np.arange(11)[:, None] + u).ravel()
    assert found.ravel() == pytest.approx(spline.evaluate(coefficients, times), abs=1e-13)


@given(st.floats(-1e6, 1e6))
def test_equal_coefficients_make_an_exact_constant(value):
    pieces = spline.monomials_of(np.full((8, 1), value))
    assert (pieces[:, 0, 0] == value).all()
    assert not pieces[:, 0, 1:].any()


@pytest.mark.parametrize("gap_s", [0, 10, 60, 120])
def test_a_fit_bridges_a_gap_by_the_least_jerk(gap_s):
    def parabola(t):
        return 3.0 + 5.0 * t - 0.02 * t * t

    step_s, end_s = 0.25, 40.0 + gap_s
    every = np.arange(0, end_s, step_s)
    times = every[(every < 20) | (every > 20 + gap_s)]
    fit = Fit(Grid(round(end_s / step_s), step_s), density=1.0)
    fit.add(Observations(times / step_s, parabola(times), np.full(len(times), 0.01)))
    found = spline.evaluate(fit.solve(), every / step_s)
    assert found == pytest.approx(parabola(every), abs=1e-4)


def test_spans_at_rest_are_exactly_constant_and_the_rest_follows():
    grid = Grid(80, 0.25, ((0, 8), (40, 50), (76, 80)))
    times = np.arange(0, 80, 0.5)
    wanted = np.interp(times, [8, 40, 50, 76], [0, 5, 5, -2])
    fit = Fit(grid, density=100.0)
    fit.add(Observations(times, wanted, np.full(len(times), 0.01)))
    pieces = spline.monomials_of(fit.solve()[:, None])[:, 0]
    for first, last in grid.still:
        assert not pieces[first:last, 1:].any()
        assert len(set(pieces[first:last, 0])) == 1
    assert pieces[45, 0] == pytest.approx(5, abs=0.05)


def test_velocities_count_as_well():
    grid = Grid(40, 0.5)
    times = np.arange(0, 40, 1.0)
    fit = Fit(grid, density=1.0)
    fit.add(Observations(np.array([0.0]), np.array([7.0]), np.array([0.01])))
    fit.add(Observations(times, np.cos(times * 0.05), np.full(40, 0.01), order=1))
    expected = 7 + np.sin(times * 0.05) * 10
    assert spline.evaluate(fit.solve(), times) == pytest.approx(expected, abs=0.01)
