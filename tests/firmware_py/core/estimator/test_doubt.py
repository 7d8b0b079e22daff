"""What a fault may have done, in the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import doubt
from rrins.firmware_py.core.records.estimator_records import BIASES
from rrins.firmware_py.core.records.redundancy_records import GYROS


def test_no_angle_is_less_known_than_not_at_all(kit):
    estimator = kit.state().estimator
    n = int(estimator.states)
    root = np.random.default_rng(1).normal(size=(n, n))
    root[1] *= 1e3
    before = root @ root.T
    estimator.P[:n, :n] = before
    doubt.confine(estimator)
    after = np.array(estimator.P[:n, :n])
    assert np.sqrt(np.diag(after)[:3]).max() == pytest.approx(doubt.UNKNOWN)
    sigma_before, sigma = np.sqrt(np.diag(before)), np.sqrt(np.diag(after))
    assert after / np.outer(sigma, sigma) == pytest.approx(
        before / np.outer(sigma_before, sigma_before)
    )


@pytest.fixture
def doubted(kit):
    """A state in which a gyro's bias has been estimated, with what the fault has done."""
    estimator = (state := kit.state()).estimator
    estimator.doubt_variance[GYROS, 2] = 4e-8
    estimator.variance_before[GYROS, 2] = 1e-10
    estimator.bias_before[GYROS, 2] = 3e-6
    estimator.gyro_bias[2] = 5e-5
    estimator.P[BIASES + 2, BIASES + 2] = 1e-8
    estimator.P[0, BIASES + 2] = estimator.P[BIASES + 2, 0] = 1e-7
    return state


@pytest.mark.parametrize(
    ("change", "size", "variance", "correlated"),
    [(1e-5, 5e-5, 1e-8 + 1e-10, True), (5e-5, 1e-6, 1e-10 + 1e-12, False)],
    ids=["changed", "ended"],
)
def test_a_bias_in_doubt_changes_with_its_fault(doubted, change, size, variance, correlated):
    """Once the fault has ended the bias is what it was, and the attitude is corrected no more."""
    estimator, at = doubted.estimator, BIASES + 2
    attitude = float(estimator.P[0, 0])
    estimator.change[GYROS, 2], estimator.changed_size[GYROS, 2] = change, size
    doubt.change(doubted)
    assert estimator.P[at, at] == pytest.approx(variance)
    assert (estimator.P[0, at] != 0.0) == correlated
    assert estimator.P[0, 0] == attitude
    if not correlated:
        assert estimator.gyro_bias[2] + estimator.x[at] == pytest.approx(3e-6)


def test_a_bias_that_nothing_has_aided_waits_for_the_repair(doubted):
    estimator = doubted.estimator
    before = np.array(estimator.P)
    estimator.unaided[GYROS] = 1
    estimator.change[GYROS, 2] = 1e-4
    doubt.change(doubted)
    assert np.array_equal(estimator.P, before)


def test_a_sensor_that_fails_and_is_used_is_in_doubt_as_long_as_it_is(doubted):
    """What it has done in the first second, too."""
    estimator, at = doubted.estimator, BIASES + 1
    doubted.epoch = 1000
    before = float(estimator.P[0, 0])
    for _ in range(2):
        estimator.kept_size[GYROS, 1] = 0.03
        doubt.change(doubted)
        assert estimator.P[at, at] == pytest.approx(9e-4)
        assert estimator.P[0, 0] - before == pytest.approx(9e-4)
    assert doubt.explains(estimator, doubted.epoch)


def test_a_sensor_that_is_sound_again_has_the_bias_that_it_had(doubted):
    estimator, at = doubted.estimator, BIASES + 1
    doubted.epoch = 1000
    estimator.past_count, estimator.past_epoch[0] = 1, 200
    estimator.past_bias[0, GYROS, 1], estimator.past_variance[0, GYROS, 1] = 2e-6, 1e-12
    estimator.kept_size[GYROS, 1] = 0.03
    doubt.change(doubted)
    estimator.gyro_bias[1] = 0.01  # what the filter took for a bias
    doubt.change(doubted)
    assert estimator.gyro_bias[1] + estimator.x[at] == pytest.approx(2e-6)
    assert estimator.P[at, at] == pytest.approx(1e-12)
