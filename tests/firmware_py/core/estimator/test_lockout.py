"""A filter that rejects all fixes and has nothing else takes them again after its patience."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import covariance, doubt, lockout
from rrins.firmware_py.core.records.estimator_records import (
    BIASES,
    LATITUDE,
    MOST_DISTRUST,
    VELOCITY,
    Aid,
)

STATES = BIASES + 8


@pytest.fixture
def state(kit):
    state = kit.state()
    estimator = state.estimator
    lockout.begin.py_func(estimator)
    doubt.begin.py_func(estimator)
    root = np.random.default_rng(1).normal(size=(STATES, STATES)) * 1e-3
    root[BIASES:] *= 1e-6
    estimator.P[:STATES, :STATES] = root @ root.T
    state.gnss.available = True
    for aid in (Aid.GNSS_POSITION, Aid.GNSS_VELOCITY):
        estimator.sources[int(aid)].distrust = MOST_DISTRUST
    return state


def seconds(state, count, excess=100.0, used=None):
    """Close seconds in which fixes were rejected; `used` names an aid that was taken in each."""
    for _ in range(count):
        state.estimator.excess = excess
        if used is not None:
            state.estimator.sources[int(used)].used += 1
        lockout.follow(state)


def test_it_doubts_itself_after_two_minutes(state):
    estimator = state.estimator
    before = np.array(estimator.P[:STATES, :STATES])
    seconds(state, lockout.PATIENCE_S - 1)
    assert np.array_equal(estimator.P[:STATES, :STATES], before)
    seconds(state, 1)
    after = np.array(estimator.P[:STATES, :STATES])
    assert estimator.reopened
    assert estimator.reopenings == 1
    assert np.linalg.eigvalsh(after).min() > -1e-18
    ratio = np.sqrt(np.diag(after) / np.diag(before))
    assert ratio[VELOCITY:BIASES] == pytest.approx(10.0)
    assert np.all(ratio >= 1.0)
    limits = np.repeat(estimator.bias_sigma, 4)
    assert np.all(np.sqrt(np.diag(after))[BIASES:] <= limits * (1 + 1e-9))
    seconds(state, 1)
    assert not estimator.reopened


@pytest.mark.parametrize("aid", [Aid.ODOMETER, Aid.ZERO_VELOCITY])
def test_it_trusts_another_aid(state, aid):
    seconds(state, 3 * lockout.PATIENCE_S, used=aid)
    assert state.estimator.reopenings == 0


def test_an_odometer_that_is_rejected_is_no_help(state):
    state.estimator.sources[int(Aid.ODOMETER)].distrust = MOST_DISTRUST
    seconds(state, lockout.PATIENCE_S, used=Aid.ODOMETER)
    assert state.estimator.reopenings == 1


def test_an_outage_neither_counts_nor_undoes(state):
    seconds(state, lockout.PATIENCE_S - 1)
    state.gnss.available = False
    seconds(state, 100, excess=0.0)
    assert state.estimator.reopenings == 0
    state.gnss.available = True
    seconds(state, 1)
    assert state.estimator.reopenings == 1


def test_a_receiver_that_agrees_in_one_of_two_is_not_locked_out(state):
    velocity = state.estimator.sources[int(Aid.GNSS_VELOCITY)]
    velocity.distrust = 0
    seconds(state, 2 * lockout.PATIENCE_S)
    assert state.estimator.reopenings == 0


def test_standing_that_is_rejected_opens_the_gate_too(state):
    """Where there is no receiver: the filter trusts itself too much, or the vehicle moves."""
    state.gnss.available = False
    still = state.estimator.sources[int(Aid.ZERO_VELOCITY)]
    seconds(state, 2 * lockout.PATIENCE_S)
    assert state.estimator.reopenings == 0
    still.distrust = MOST_DISTRUST
    seconds(state, lockout.PATIENCE_S)
    assert state.estimator.reopenings == 1


def test_a_stop_of_the_car_only_delays_it(state):
    velocity = state.estimator.sources[int(Aid.GNSS_VELOCITY)]
    seconds(state, lockout.PATIENCE_S - 1)
    velocity.distrust = 0
    seconds(state, 20)
    assert state.estimator.reopenings == 0
    velocity.distrust = MOST_DISTRUST
    seconds(state, 1)
    assert state.estimator.reopenings == 1


def test_a_gate_that_opens_at_once_heeds_positions_and_velocities(state):
    """Where P has them go together, and the fault does not."""
    estimator, north = state.estimator, VELOCITY + 1
    estimator.north_radius = 1.0
    estimator.P[:] = np.diag(np.full(len(estimator.P), 1e-9))
    estimator.P[north, north], estimator.P[LATITUDE, LATITUDE] = 1e-4, 1.0
    estimator.P[north, LATITUDE] = estimator.P[LATITUDE, north] = 0.999e-2
    for at, measured, sigma in [(north, -1.0, 0.05), (LATITUDE, 100.0, 2.0)] * 3:
        estimator.row[:] = 0.0
        estimator.row[at] = 1.0
        x, P, gain = estimator.x, estimator.P, estimator.gain
        innovation = measured - x[at]
        expected = covariance.expect(P, STATES, estimator.row, sigma**2, gain)
        if innovation**2 > 25.0 * expected:
            expected = lockout.open_along(estimator, innovation, expected, 1.0)
            assert expected == innovation**2
            assert np.array(gain[:BIASES]) == pytest.approx(np.array(P)[:BIASES, at])
        covariance.update(x, P, STATES, gain, innovation, expected)
    assert estimator.x[LATITUDE] == pytest.approx(100.0, abs=5.0)
    assert estimator.x[north] == pytest.approx(-1.0, abs=0.2)
    assert estimator.P[0, 0] > 0.5 * (1.0 / 9.8) ** 2  # of a tilt in a second
    assert np.linalg.eigvalsh(np.array(P)[:STATES, :STATES]).min() > -1e-9


def test_two_aids_against_the_filter_open_the_gate_at_once(state):
    """Not one, with what another said before it fell silent."""
    state.epoch = 1000
    state.estimator.sources[int(Aid.ODOMETER)].distrust = MOST_DISTRUST
    for fixes, counts in ((True, False), (False, True), (True, True)):
        assert not doubt.explains(state.estimator, state.epoch)
        state.gnss.available, state.odometer.available = fixes, counts
        seconds(state, 1)
    assert doubt.explains(state.estimator, state.epoch)
