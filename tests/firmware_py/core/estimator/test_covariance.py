"""The filter's covariance against matrix algebra, and in a case that breaks the short form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.estimator import covariance


def random_covariance(n, seed):
    root = np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T + np.eye(n)


def test_it_propagates_as_matrices_do():
    rng = np.random.default_rng(1)
    P = random_covariance(12, 2)
    transition = np.eye(12) + 0.1 * rng.standard_normal((12, 12)) * (rng.random((12, 12)) < 0.3)
    expected = transition @ P @ transition.T
    covariance.propagate(P, 12, 12, transition, np.zeros((12, 12)))
    assert expected == pytest.approx(P, rel=1e-13)
    assert np.array_equal(P, P.T)


def test_noise_along_a_direction_is_added_there_only():
    P = np.zeros((6, 6))
    covariance.add_along(P, 3, np.array([3.0, 0.0, 4.0]), 2.0)
    assert np.array_equal(P[3:, 3:], 2.0 * np.outer([3, 0, 4], [3, 0, 4]))
    assert not P[:3].any()


@given(
    n=st.integers(1, 12),
    seed=st.integers(0, 2**32 - 1),
    zeros=st.floats(0, 0.9),
    log_variance=st.floats(-6, 6),
)
def test_a_measurement_of_several_states_is_the_textbook_update(n, seed, zeros, log_variance):
    """Groves (2nd ed., 2013), (3.21), (3.24), (3.58); beyond n the capacity stays as it is."""
    rng = np.random.default_rng(seed)
    P, x = np.full((14, 14), 7.0), np.full(14, 7.0)
    P[:n, :n] = prior = random_covariance(n, seed)
    x[:n] = state = rng.standard_normal(n)
    h = rng.standard_normal(n) * (rng.random(n) >= zeros)
    row, gain = np.full(14, 7.0), np.full(14, 7.0)
    row[:n] = h
    variance, innovation = 10.0**log_variance, float(rng.standard_normal())

    expected = covariance.expect(P, n, row, variance, gain)
    assert expected == pytest.approx(h @ prior @ h + variance, rel=1e-12)
    assert gain[:n] == pytest.approx(prior @ h, rel=1e-12, abs=1e-12)
    covariance.update(x, P, n, gain, innovation, expected)

    K = prior @ h / (h @ prior @ h + variance)
    left = np.eye(n) - np.outer(K, h)
    after = left @ prior @ left.T + variance * np.outer(K, K)
    size = np.abs(prior).max()
    assert pytest.approx(after, rel=1e-10, abs=1e-11 * size) == P[:n, :n]
    assert x[:n] == pytest.approx(state + K * innovation, rel=1e-10, abs=1e-11)
    assert np.array_equal(P, P.T)
    assert (P[n:] == 7.0).all()
    assert (x[n:] == 7.0).all()


def test_ten_thousand_measurements_of_tiny_variances_leave_it_positive():
    """Measurements a million times as good as the states, and a transition after each ten."""
    n, rng = 9, np.random.default_rng(5)
    P, x = random_covariance(n, 6), np.zeros(n)
    truth, gain, work = rng.standard_normal(n), np.zeros(n), np.zeros((n, n))
    transition = np.eye(n) + np.diag(np.full(n - 1, 0.1), 1)
    walk = 1e-8
    for k in range(10_000):
        row = np.zeros(n)
        row[rng.integers(n)] = 1.0
        row[rng.integers(n)] += 0.5
        expected = covariance.expect(P, n, row, 1e-12, gain)
        assert expected > 0
        covariance.update(x, P, n, gain, row @ truth - row @ x, expected)
        if k % 10 == 9:
            truth = transition @ truth / 2
            x[:] = transition @ x / 2
            covariance.propagate(P, n, n, transition / 2, work)
            P[np.diag_indices(n)] += walk
        if k % 100 == 99:
            sigma = np.sqrt(np.diag(P))
            assert np.linalg.eigvalsh(P / np.outer(sigma, sigma))[0] > 0
            assert np.array_equal(P, P.T)
    assert np.abs(x - truth).max() < 1e-3
