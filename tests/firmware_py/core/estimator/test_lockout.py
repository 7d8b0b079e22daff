"""A filter that rejects all fixes and has nothing else takes them again after its patience."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import lockout
from rrins.firmware_py.core.records.estimator_records import BIASES, MOST_DISTRUST, VELOCITY, Aid

STATES = BIASES + 8


@pytest.fixture
def state(kit):
    state = kit.state()
    estimator = state.estimator
    lockout.begin.py_func(estimator)
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
