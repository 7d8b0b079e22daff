"""The sway about a known place: its states against the oscillator's exact solution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from rrins.firmware_py.core.estimator import sway
from rrins.firmware_py.core.records.estimator_records import LATITUDE, LONGITUDE, SWAY_NORTH

SIGMA = 0.3


@pytest.fixture
def state(kit):
    state = kit.state(initial_attitude="self-aligned-swaying")
    state.estimator.north_radius, state.estimator.east_radius = 6.36e6, 4.9e6
    sway.begin.py_func(state.estimator, SIGMA)
    return state


def test_states_go_over_a_second_as_the_oscillator_does(state):
    omega, damping = sway.FREQUENCY, sway._DAMPING
    exact = expm(np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]]))
    assert np.allclose(state.estimator.sway_transition, exact, atol=1e-12)


def test_a_ship_that_sways_for_long_sways_no_more_and_no_less(state):
    estimator, at = state.estimator, int(state.estimator.sway_state)
    before = np.array(estimator.P[at : at + 4, at : at + 4])
    with_place = float(estimator.P[LONGITUDE, at + 1])
    for _ in range(3):
        sway.propagate(estimator, SIGMA)
    assert np.allclose(estimator.P[at : at + 4, at : at + 4], before)
    assert before[1, 1] == pytest.approx(SIGMA**2)
    P = np.array(estimator.P)
    assert np.allclose(P, P.T)
    assert 0 < abs(float(estimator.P[LONGITUDE, at + 1])) < with_place


def test_the_navigation_is_off_by_the_way_at_the_beginning(state):
    estimator = state.estimator
    at = int(estimator.sway_state) + SWAY_NORTH + 1
    place = float(estimator.P[LATITUDE, LATITUDE]) * estimator.north_radius**2
    assert float(estimator.P[LATITUDE, at]) * estimator.north_radius == pytest.approx(place)


def test_what_was_found_is_carried_on(state):
    estimator, at = state.estimator, int(state.estimator.sway_state)
    estimator.x[at : at + 4] = 0.1, 0.2, -0.3, 0.05
    sway.carry.py_func(estimator)
    exact = estimator.sway_transition @ np.array([[0.1, -0.3], [0.2, 0.05]])
    assert np.allclose(estimator.sway_way, exact.T.ravel())
