"""The filter's covariance against matrix algebra, and in a case that breaks the short form."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import covariance


def random_covariance(n, seed):
    root = np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T + np.eye(n)


def test_it_propagates_as_matrices_do():
    rng = np.random.default_rng(1)
    P = random_covariance(12, 2)
    transition = np.eye(12) + 0.1 * rng.standard_normal((12, 12)) * (rng.random((12, 12)) < 0.3)
    expected = transition @ P @ transition.T
    covariance.propagate(P, 12, transition, np.zeros((12, 12)))
    assert expected == pytest.approx(P, rel=1e-13)
    assert np.array_equal(P, P.T)


def test_a_measurement_weighs_by_the_inverse_variances():
    P, x = random_covariance(5, 3), np.arange(5.0)
    h = np.eye(5)[2]
    after = np.linalg.inv(np.linalg.inv(P) + np.outer(h, h) / 0.3)
    mean = x + after @ h / 0.3 * (7.0 - x[2])
    variance = P[2, 2] + 0.3
    found = covariance.measure(x, P, 2, 7.0, 0.3, np.zeros(5), np.zeros((5, 5)))
    assert found == pytest.approx((5.0, variance))
    assert pytest.approx(after, rel=1e-12) == P
    assert x == pytest.approx(mean, rel=1e-12)


def test_it_stays_positive_where_the_prior_is_a_million_times_as_uncertain():
    P, x = np.eye(3) * 1e16, np.zeros(3)
    P += np.ones((3, 3)) * 1e15
    gain, work = np.zeros(3), np.zeros((3, 3))
    turn = np.eye(3) + np.diag([0.1, 0.1], 1)
    for k in range(300):
        covariance.measure(x, P, k % 3, 1.0, 1e-6, gain, work)
        covariance.propagate(P, len(P), turn, work)
        assert np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P))))[0] > -1e-12
        assert np.array_equal(P, P.T)


def test_noise_along_a_direction_is_added_there_only():
    P = np.zeros((6, 6))
    covariance.add_along(P, 3, np.array([3.0, 0.0, 4.0]), 2.0)
    assert np.array_equal(P[3:, 3:], 2.0 * np.outer([3, 0, 4], [3, 0, 4]))
    assert not P[:3].any()
