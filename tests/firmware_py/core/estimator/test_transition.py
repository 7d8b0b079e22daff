"""How errors grow: against the navigation itself, run twice."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import transition
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import Ins

LATITUDE, LONGITUDE, HEIGHT = math.radians(47.0), 0.2, 300.0
DT, STEPS = 0.01, 100
VELOCITY_N = np.array([30.0, -20.0, 0.5])
FORCE_N = np.array([0.7, -0.4, earth.gravity(LATITUDE, HEIGHT) + 0.1])
RATE_S = np.array([0.02, -0.03, 0.05])


def rotation(vector):
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def navigate(error=(), turn_n=(0, 0, 0), change_n=(0, 0, 0), rate_s=(0, 0, 0), force_s=(0, 0, 0)):
    """Navigate a second with an error at its beginning and of its increments."""
    x = np.zeros(transition.SIZE)
    for state, value in error:
        x[state] = value
    start = rotation(np.array([0.3, -0.2, 1.0]))
    array = Ins.zeros()
    strapdown.initialise(
        array[0],
        rotation(x[:3]) @ start,
        LATITUDE + x[transition.LATITUDE],
        LONGITUDE + x[transition.LONGITUDE],
        HEIGHT,
    )
    array[0].velocity_n[:] = VELOCITY_N + x[3:6]
    attitude = start.copy()
    force, way, sums = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    velocity = VELOCITY_N.copy()
    seconds = DT * STEPS
    for _ in range(STEPS):
        middle = attitude @ rotation(RATE_S * DT / 2)
        dtheta = RATE_S * DT + np.array(rate_s) * DT + middle.T @ turn_n * DT / seconds
        dv = middle.T @ FORCE_N * DT + np.array(force_s) * DT + middle.T @ change_n * DT / seconds
        strapdown.update_array(array, dtheta, dv, DT, strapdown.HEIGHT_FREE)
        force += FORCE_N * DT
        way += velocity * DT
        velocity += (FORCE_N - [0, 0, earth.gravity(LATITUDE, HEIGHT)]) * DT
        sums += middle * DT
        attitude = attitude @ rotation(RATE_S * DT)
    return array[0], force, way, sums


def difference(one, other):
    turn = np.array(one.C_s_n) @ np.array(other.C_s_n).T
    psi = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    x = np.zeros(transition.SIZE)
    x[:3] = psi
    x[3:6] = np.array(one.velocity_n) - np.array(other.velocity_n)
    x[transition.LATITUDE] = one.latitude - other.latitude
    x[transition.LONGITUDE] = one.longitude - other.longitude
    return x


@pytest.fixture(scope="module")
def sound():
    return navigate()


@pytest.fixture(scope="module")
def response(sound):
    _, force, way, _ = sound
    response = np.zeros((transition.SIZE, transition.SIZE))
    transition.fill(response, force, way, 1.0, LATITUDE, HEIGHT, True)
    return response


def assert_alike(found, expected, size):
    """Check states against each other; each may be off by what the second order makes."""
    scale = np.array([1e-8] * 3 + [1e-6] * 3 + [1e-9] * 6 + [2e-11] * 2)  # 0.1 mm
    assert np.abs(found - expected).max() > 0 or size == 0
    for state in (*range(6), transition.LATITUDE, transition.LONGITUDE):
        bound = scale[state] + 0.03 * abs(expected[state])
        assert abs(found[state] - expected[state]) < bound, state


@pytest.mark.parametrize("state", [*range(6), transition.LATITUDE])
def test_an_error_at_the_beginning_grows_as_in_the_navigation(sound, response, state):
    size = {0: 1e-4, 3: 0.1, 12: 1e-6}[state // 3 * 3]
    found = difference(navigate(error=[(state, size)])[0], sound[0])
    assert_alike(found, response[:, state] * size, size)


@pytest.mark.parametrize("axis", range(3))
def test_turns_and_velocity_changes_grow_as_in_the_navigation(sound, response, axis):
    one = np.eye(3)[axis]
    turned = difference(navigate(turn_n=one * 1e-4)[0], sound[0])
    assert_alike(turned, response[:, transition.TURN + axis] * 1e-4, 1e-4)
    pushed = difference(navigate(change_n=one * 0.01)[0], sound[0])
    assert_alike(pushed, response[:, transition.CHANGE + axis] * 0.01, 0.01)


@pytest.mark.parametrize("axis", range(3))
def test_biases_of_the_turning_sensors_grow_as_in_the_navigation(sound, response, axis):
    one = np.eye(3)[axis]
    phi = np.zeros((transition.FILTER_SIZE, transition.FILTER_SIZE))
    transition.of_biases(phi, response, sound[3])
    for column, error in (
        (transition.TURN, {"rate_s": one * 1e-4}),
        (transition.CHANGE, {"force_s": one * 0.01}),
    ):
        found = difference(navigate(**error)[0], sound[0])
        expected = np.zeros(transition.SIZE)
        expected[:12] = phi[:, column + axis] * np.max(list(error.values()))
        expected[transition.LATITUDE :] = found[transition.LATITUDE :]
        assert_alike(found, expected, 1)
        assert np.array_equal(phi[6:], np.eye(12)[6:])


def test_where_the_height_is_held_vertical_errors_end(response):
    held = response.copy()
    transition.fill(held, FORCE_N, VELOCITY_N, 1.0, LATITUDE, HEIGHT, False)
    assert not held[5].any()
