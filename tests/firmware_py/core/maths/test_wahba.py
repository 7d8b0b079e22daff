"""Wahba's problem and its small linear algebra, beside numpy's and scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rrins.firmware_py.core.maths.attitude import matrix_of_quaternion
from rrins.firmware_py.core.maths.wahba import fill_davenport, invert_symmetric, largest_eigenvector


def solved(B):
    """Return the rotation that maximises ``Σ w bᵀ C a``."""
    K, vectors, q, C = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(4), np.zeros((3, 3))
    fill_davenport(K, B)
    value = largest_eigenvector(K, vectors, q)
    matrix_of_quaternion(C, q)
    return C, value


@pytest.mark.parametrize("seed", range(8))
def test_vectors_that_were_turned_give_the_turn(seed):
    random = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    a = random.normal(size=(20, 3)) * [100.0, 1.0, 0.1]  # as gravity beside its turning
    b = a @ turn.T
    found, value = solved(b.T @ a)
    assert found == pytest.approx(turn, abs=1e-9)
    assert value == pytest.approx(np.sum(a * a), rel=1e-12)


def test_noisy_vectors_are_turned_as_scipy_turns_them():
    random = np.random.default_rng(5)
    a, b = random.normal(size=(2, 30, 3))
    expected = Rotation.align_vectors(b, a)[0].as_matrix()
    assert solved(b.T @ a)[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("axis", range(3))
def test_half_a_turn_is_found(axis):
    turn = np.diag([1.0 if i == axis else -1.0 for i in range(3)])
    assert solved(turn @ np.diag([3.0, 2.0, 1.0]))[0] == pytest.approx(turn, abs=1e-12)


def test_all_eigenvectors_are_those_of_numpy():
    random = np.random.default_rng(1)
    K = random.normal(size=(4, 4))
    K = K + K.T
    values, columns = np.linalg.eigh(K)
    diagonal, vectors, q = K.copy(), np.zeros((4, 4)), np.zeros(4)
    assert largest_eigenvector(diagonal, vectors, q) == pytest.approx(values[-1])
    assert abs(q @ columns[:, -1]) == pytest.approx(1.0)
    assert np.sort(np.diag(diagonal)) == pytest.approx(values)
    assert vectors.T @ K @ vectors == pytest.approx(np.diag(np.diag(diagonal)), abs=1e-12)


def test_a_positive_matrix_is_inverted_and_a_singular_one_refused():
    random = np.random.default_rng(2)
    A = random.normal(size=(3, 3))
    A = A @ A.T
    inverse = np.zeros((3, 3))
    assert invert_symmetric(inverse, A)
    assert inverse @ A == pytest.approx(np.eye(3), abs=1e-9)
    assert not invert_symmetric(inverse, np.diag([1.0, 1.0, 0.0]))
