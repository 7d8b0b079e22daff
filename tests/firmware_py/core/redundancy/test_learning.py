"""The parity is learned by least squares, with an honest σ."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.records.redundancy_records import REGRESSORS, Learner
from rrins.firmware_py.core.redundancy import learning

COUNT, ROWS = 5, 2


def new_learner(prior):
    learner = np.zeros(1, Learner.dtype)[0]
    learner["prior"][: len(prior)] = prior
    learning.forget_all(learner, 1.0)
    return learner


def learn(learner, X, Y):
    for x, y in zip(X, Y, strict=True):
        regressors = np.zeros(REGRESSORS)
        regressors[:COUNT] = x
        variance = learning.leverage(learner, regressors, COUNT)
        innovations = y.copy()
        for row in range(ROWS):
            innovations[row] -= learning.expected(learner, row, regressors, COUNT)
        learning.learn(learner, innovations, ROWS, variance, COUNT)


@pytest.fixture
def samples():
    random = np.random.default_rng(5)
    X = random.normal(size=(300, COUNT))
    return X, X @ random.normal(size=(COUNT, ROWS)) + random.normal(size=(300, ROWS))


def test_second_by_second_is_all_at_once(samples):
    X, Y = samples
    prior = np.array([4.0, 9.0, 1.0, 25.0, 100.0])
    learner = new_learner(prior)
    learn(learner, X, Y)
    information = X.T @ X + np.diag(1 / prior)
    expected = np.linalg.solve(information, X.T @ Y)
    assert learner["coefficients"][:ROWS, :COUNT] == pytest.approx(expected.T, rel=1e-9)
    covariance = np.linalg.inv(information)
    assert learner["covariance"][:COUNT, :COUNT] == pytest.approx(covariance, rel=1e-8)


def test_what_was_learned_becomes_less_certain_up_to_the_prior(samples):
    learner = new_learner(np.full(COUNT, 100.0))
    learner["walk"][:COUNT] = 0.5
    learn(learner, *samples)
    before = learner["covariance"][0, 0]
    learning.age(learner, COUNT)
    assert learner["covariance"][0, 0] == pytest.approx(before + 0.5)
    for _ in range(1000):
        learning.age(learner, COUNT)
    assert learner["covariance"][0, 0] == pytest.approx(100.0, abs=0.5)


def test_confined_it_is_what_a_narrower_prior_would_have_given(samples):
    X, Y = (half[:4] for half in samples)  # fewer than coefficients: the prior counts
    limits, usual = np.array([4.0, 9.0, 1.0, 25.0, 100.0]), np.array([4.0, 1.0, 0.0, 2.5, 0.1])
    learner = new_learner(limits)
    learner["usual"][:COUNT] = usual
    learn(learner, X, Y)
    learning.confine(learner, COUNT)
    varies = usual > 0  # a coefficient of variance zero is none
    information = X[:, varies].T @ X[:, varies] + np.diag(1 / usual[varies])
    expected = np.zeros((COUNT, ROWS))
    expected[varies] = np.linalg.solve(information, X[:, varies].T @ Y)
    found = learner["coefficients"][:ROWS, :COUNT]
    assert found == pytest.approx(expected.T, rel=1e-9, abs=1e-12)
    covariance = np.zeros((COUNT, COUNT))
    covariance[np.ix_(varies, varies)] = np.linalg.inv(information)
    found = learner["covariance"][:COUNT, :COUNT]
    assert found == pytest.approx(covariance, rel=1e-8, abs=1e-12)
