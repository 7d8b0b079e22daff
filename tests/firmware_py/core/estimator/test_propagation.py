"""The transition over a second, column by column, against the strapdown itself run twice."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import propagation
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    VELOCITY,
)
from rrins.firmware_py.core.records.memory import Ins

DT, EPOCHS = 0.005, 200
PLACE = (math.radians(47.0), 0.2, 300.0)
VELOCITY_N = np.array([12.0, 16.0, 0.0])  # 20 m/s
GRAVITY = earth.gravity(PLACE[0], PLACE[2])
FORCE_N = np.array([0.5, -0.3, GRAVITY])
RATE_S = math.radians(2.0) * np.array([2.0, -1.0, 2.0]) / 3.0
STATES = BIASES + 8

METRES = sum(earth.radii(PLACE[0])) / 2 + PLACE[2]
UNITS = np.ones(STATES)
"""Sizes that are alike in what they do within a second, by gravity: rad, m/s, m, rad/s, m/s²."""
UNITS[VELOCITY : VELOCITY + 3] = GRAVITY
UNITS[LATITUDE] = GRAVITY / METRES
UNITS[LONGITUDE] = GRAVITY / METRES / math.cos(PLACE[0])
UNITS[HEIGHT] = GRAVITY
UNITS[BIASES + 4 :] = GRAVITY

SIZE = 1e-5
GROUPS = {
    "attitude": (ATTITUDE, VELOCITY),
    "velocity": (VELOCITY, LATITUDE),
    "position": (LATITUDE, BIASES),
    "gyro biases": (BIASES, BIASES + 4),
    "accelerometer biases": (BIASES + 4, STATES),
}
BOUNDS = {
    "attitude": (1e-8, 2e-4, 1e-4),
    "velocity": (1e-9, 5e-6, 5e-6),
    "position": (1e-9, 1e-7, 5e-6),
    "gyro biases": (2e-4, 4e-3, 0.1),
    "accelerometer biases": (1e-8, 2e-4, 3e-3),
}
"""By how much attitude, velocity and position may be off, in `UNITS`, for errors of each group.

The matrix takes sums at the ends of epochs (half an epoch of the turn, 9e-5), a turn as spread
evenly over the second (2° / 12 of the velocity, 3e-3), and the way by the mean of the velocities at
both ends: g/4 in place of g/6 for a gyro's bias, 0.08."""


class Second:
    """A second of the strapdown, with errors x at its beginning."""

    def __init__(self, tools, state, x, note=False):
        start = tools.exponential([0.3, -0.2, 1.0])
        self.array = np.zeros(1, dtype=Ins.dtype)
        ins = self.array[0]
        latitude, longitude, height = (
            p + d for p, d in zip(PLACE, x[LATITUDE:BIASES], strict=True)
        )
        strapdown.initialise(
            ins, tools.exponential(x[ATTITUDE : ATTITUDE + 3]) @ start, latitude, longitude, height
        )
        ins.velocity_n[:] = VELOCITY_N + x[VELOCITY : VELOCITY + 3]
        # An error of an estimated bias is removed from the fused vector.
        rate = state.gyros.gain[:, :4] @ x[BIASES : BIASES + 4]
        force = state.accelerometers.gain[:, :4] @ x[BIASES + 4 :]
        step = tools.exponential(RATE_S * DT)
        middle = start @ tools.exponential(RATE_S * DT / 2)
        for _ in range(EPOCHS):
            dtheta, dv = (RATE_S - rate) * DT, (middle.T @ FORCE_N - force) * DT
            strapdown.update_array(self.array, dtheta, dv, DT, strapdown.HEIGHT_FREE)
            if note:
                propagation.note.py_func(state.estimator, ins, dtheta, dv, DT)
            middle = middle @ step

    def minus(self, other):
        one, two = self.array[0], other.array[0]
        turn = one.C_s_n @ two.C_s_n.T
        x = np.zeros(STATES)
        x[:3] = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
        x[:3] /= 2
        x[VELOCITY : VELOCITY + 3] = one.velocity_n - two.velocity_n
        x[LATITUDE] = one.latitude - two.latitude
        x[LONGITUDE] = one.longitude - two.longitude
        x[HEIGHT] = one.height - two.height
        return x


@pytest.fixture(scope="module")
def state(tools, kit):
    state = kit.state()
    sound = Second(tools, state, np.zeros(STATES), note=True)
    state.ins = sound.array[0]
    propagation.close.py_func(state.estimator)
    propagation.fill.py_func(state)
    return state


@pytest.fixture(scope="module")
def found(tools, state):
    """Effect of an error of each state in the strapdown, in `UNITS`."""
    found = np.zeros((BIASES, STATES))
    for k in range(STATES):
        x = np.zeros(STATES)
        x[k] = SIZE * UNITS[k]
        change = Second(tools, state, x).minus(Second(tools, state, -x)) / (2 * SIZE)
        found[:, k] = (change / UNITS)[:BIASES]
    return found


@pytest.mark.parametrize(("columns", "bounds"), BOUNDS.items())
def test_errors_grow_as_in_the_strapdown(state, found, columns, bounds):
    first, end = GROUPS[columns]
    matrix = state.estimator.transition[:, :STATES] * UNITS / UNITS[:BIASES, None]
    for k in range(first, end):
        for rows, bound in zip(("attitude", "velocity", "position"), bounds, strict=True):
            start, stop = GROUPS[rows]
            deviation = np.abs(found[start:stop, k] - matrix[start:stop, k])
            assert deviation.max() < bound, (rows, k)


def test_nothing_is_beyond_the_states(state):
    assert not state.estimator.transition[:, STATES:].any()


def test_the_sums_of_a_second_are_its_integrals(tools, state):
    estimator = state.estimator
    assert estimator.seconds[propagation.DONE] == pytest.approx(1.0)
    assert estimator.turned[propagation.DONE] == pytest.approx(math.radians(2.0))
    assert estimator.force_n[propagation.DONE] == pytest.approx(FORCE_N, abs=2e-3)
    acceleration = FORCE_N - [0, 0, GRAVITY]
    way = VELOCITY_N + acceleration / 2
    assert estimator.way_n[propagation.DONE] == pytest.approx(way, abs=5e-3)
    for name in ("seconds", "turned", "force_n", "way_n", "attitude_s"):
        assert not np.any(estimator[name][propagation.PRESENT])


def test_errors_and_covariance_go_with_the_matrix(state):
    estimator, n = state.estimator, STATES
    matrix = np.eye(n)
    matrix[:BIASES] = estimator.transition[:, :n]
    rng = np.random.default_rng(1)
    root = rng.standard_normal((n, n))
    estimator.P[:n, :n], estimator.x[:n] = root @ root.T, root[0]
    propagation.propagate_state.py_func(estimator)
    propagation.propagate_covariance.py_func(estimator)
    assert estimator.x[:n] == pytest.approx(matrix @ root[0], rel=1e-12)
    after = matrix @ root @ root.T @ matrix.T
    assert pytest.approx(after, rel=1e-10, abs=1e-12) == estimator.P[:n, :n]


def test_noise_is_that_of_the_data_sheets(kit, state):
    """White noise of each sensor along its share of the fused vector, turned by the table."""
    estimator, n = state.estimator, STATES
    estimator.P[:] = 0.0
    propagation.add_noise.py_func(state)
    P, C = estimator.P[:n, :n], estimator.attitude_s[propagation.DONE]
    gyros, accelerometers = state.gyros.gain[:, :4], state.accelerometers.gain[:, :4]
    turn = math.radians(2.0) * math.pi / 2 * kit.GYROS.slope_sigma**2 * np.eye(3)
    attitude = kit.GYROS.white_noise[0] ** 2 * C @ gyros @ gyros.T @ C.T + turn
    velocity = kit.ACCELEROMETERS.white_noise[0] ** 2 * C @ accelerometers @ accelerometers.T @ C.T
    assert pytest.approx(attitude, rel=1e-6, abs=1e-20) == P[:3, :3]
    assert pytest.approx(velocity, rel=1e-6, abs=1e-17) == P[3:6, 3:6]
    walk = estimator.walk_variance[:, :4].ravel()
    assert (walk > 0).all()
    of_gravity = np.array([kit.GYROS.force_sigma, kit.ACCELEROMETERS.slope_sigma])
    changes = math.radians(2.0) * (of_gravity * earth.GRAVITY_EQUATOR) ** 2  # as it turns
    walk += np.repeat(changes, 4)
    assert np.diag(P)[BIASES:] == pytest.approx(walk, rel=1e-6, abs=1e-20)
    P[:3, :3] = P[3:6, 3:6] = 0.0
    P[np.diag_indices(n)] = 0.0
    assert not P.any()


def test_where_the_height_is_held_nothing_is_vertical(tools, kit):
    state = kit.state(height_channel="held")
    state.ins = Second(tools, state, np.zeros(STATES), note=True).array[0]
    propagation.close.py_func(state.estimator)
    propagation.fill.py_func(state)
    estimator, up = state.estimator, VELOCITY + 2
    assert not estimator.transition[up].any()
    assert np.array_equal(estimator.transition[HEIGHT, :STATES], np.eye(STATES)[HEIGHT])
    assert np.array_equal(estimator.transition[:, HEIGHT], np.eye(BIASES)[HEIGHT])
    estimator.P[:STATES, :STATES] = 1.0
    propagation.add_noise.py_func(state)
    assert not estimator.P[up].any()
    assert not estimator.P[:, up].any()
