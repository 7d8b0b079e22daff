"""The propagation and the closed loop, against closed forms of scalar filters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.records.estimator_records import Aid
from rrins.host_tools.covariance.aided import closed
from rrins.host_tools.covariance.linear import OUTPUTS, System, after_rest, moments_of
from rrins.host_tools.covariance.trace import Second, Take

STEPS = 400


def scalar(phi, gain=None):
    """Return the closed loop of a scalar filter with a constant gain, and the noise's way in."""
    takes = ()
    if gain is not None:
        one = np.ones(1)
        takes = (Take(Aid.GNSS_POSITION, 0, one, gain * one, 1.0, 0.0, 0.0, 0),)
    loop, into = closed(Second(takes, np.array([[phi]]), 1.0))
    outputs = np.zeros((STEPS + 1, OUTPUTS, 1))
    outputs[:, 0, 0] = 1.0
    return System(np.tile(loop, (STEPS, 1, 1)), outputs), into


def gain_of(q, r):
    """Return the steady gain that a Kalman filter of a random walk chooses for its own q and r."""
    before = 0.5 * (q + math.sqrt(q * q + 4.0 * q * r))  # of P before the measurement
    return before / (before + r)


@pytest.mark.parametrize(("told_q", "told_r"), [(1.0, 4.0), (0.1, 4.0), (5.0, 4.0), (1.0, 0.5)])
def test_a_random_walk_under_a_filter_with_wrong_models(told_q, told_r):
    """``p = (K² r + (1 - K)² q) / (1 - (1 - K)²)`` after a measurement; Gelb, section 7.2."""
    q, r = 1.0, 4.0
    gain = gain_of(told_q, told_r)
    left = (1.0 - gain) ** 2
    after = (gain**2 * r + left * q) / (1.0 - left)
    system, into = scalar(1.0, gain)
    added = q + r * into @ into.T
    found = system.of_noise(np.array([[7.0]]), np.tile(added, (STEPS, 1, 1)))
    assert found.variance[-1, 0] == pytest.approx(after + q, rel=1e-9)
    assert found.horizontal[-1, 0, 0] == found.variance[-1, 0]
    if (told_q, told_r) == (q, r):  # the filter's own steady state: r K after a measurement
        assert after == pytest.approx(r * gain)


def test_correlated_noise_of_the_measurement_stays():
    """A process that decays by a: ``p = K² σ² (1 + a c) / ((1 - c²) (1 - a c))``, c = 1 - K."""
    gain, a, sigma = 0.2, 0.9, 3.0
    c = 1.0 - gain
    system, into = scalar(1.0, gain)
    begin = np.diag([0.0, sigma**2])
    inputs = np.tile(into, (STEPS, 1, 1))
    found = system.of_processes(begin, inputs, a, np.array([sigma**2 * (1 - a * a)]))
    expected = gain**2 * sigma**2 * (1 + a * c) / ((1 - c * c) * (1 - a * c))
    assert found.variance[-1, 0] == pytest.approx(expected, rel=1e-9)


def test_a_constant_error_of_the_measurement_becomes_that_of_the_state():
    system, into = scalar(1.0, 0.3)
    track = system.sensitivities(np.zeros((1, 1)), np.tile(into, (STEPS, 1, 1)))
    found = moments_of(track, np.array([2.0]), np.array([[9.0]]))
    assert found.mean[-1, 0] == pytest.approx(-2.0)  # e is true less estimated
    assert found.variance[-1, 0] == pytest.approx(9.0)


def test_measurements_of_one_second_count_in_their_order():
    """Two of the same: the second sees what the first left."""
    one = np.ones(1)
    takes = [Take(Aid.ALTIMETER, 0, one, k * one, 1.0, 0.0, 0.0, 1) for k in (0.5, 0.25)]
    loop, into = closed(Second(tuple(takes), np.array([[2.0]]), 1.0))
    assert loop[0, 0] == pytest.approx(2.0 * 0.75 * 0.5)
    assert into[0] == pytest.approx([-2.0 * 0.75 * 0.5, -2.0 * 0.25])


def test_a_walk_that_is_averaged_over_a_rest():
    """Of a walk from zero: the mean's variance is q t / 3, the end's q t, between them q t / 2."""
    found = after_rest(1.0, 0.01, 1000)
    assert found == pytest.approx(np.array([[10 / 3, 5.0], [5.0, 10.0]]), rel=1e-3)
