"""Standing as the sensors feel it: by force, attitude and speed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import standstill
from rrins.firmware_py.core.maths.attitude import matrix_of_euler
from rrins.firmware_py.core.records.estimator_records import VELOCITY

DT, GRAVITY = 0.005, 9.8
RATE_HZ = 200


@pytest.fixture
def state(kit):
    state = kit.state(kit.estimator(detects_standing=True))
    state.estimator.P[VELOCITY, VELOCITY] = state.estimator.P[VELOCITY + 1, VELOCITY + 1] = 0.01**2
    state.ins.C_s_n[:] = np.eye(3)
    state.C_s_b[:] = np.eye(3)
    standstill.begin.py_func(state)
    return state


def second(state, force_mps2=(0.0, 0.0, GRAVITY), shake=0.0, turns=0, table_dps=0.0):
    """Feel a second, the number `turns` of a turn; return whether the vehicle stands after it."""
    random = np.random.default_rng(3)
    noise = float(np.sqrt(np.mean(state.estimator.white_variance[1, :4])) * math.sqrt(DT))
    for epoch in range(RATE_HZ):
        angle = math.radians(table_dps * epoch * DT)
        matrix_of_euler(state.C_s_b, 0.0, 0.0, angle)
        turned = math.radians(0.2) * (turns + epoch / RATE_HZ) if turns else 0.0
        matrix_of_euler(state.ins.C_s_n, 0.0, 0.0, angle + turned)
        force_n = np.array(force_mps2) + np.array([shake * math.sin(0.3 * epoch), 0, 0])
        state.dv_s[:] = state.ins.C_s_n.T @ (force_n * DT + random.normal(0, noise, 3))
        standstill.note.py_func(state)
    standstill.finish_second(state)
    return bool(state.estimator.standing)


def test_two_steady_seconds_are_standing_also_while_the_table_turns(state):
    assert [second(state) for _ in range(3)] == [False, True, True]
    assert second(state, table_dps=2.0)


def test_a_vehicle_on_a_road_does_not_stand(state):
    assert not any(second(state, shake=0.2) for _ in range(4))
    assert [second(state) for _ in range(2)] == [False, True]
    assert not second(state, shake=0.2)


def test_a_vehicle_that_turns_on_the_spot_does_not_stand(state):
    assert not any(second(state, turns=k) for k in range(1, 5))


def test_a_vehicle_that_glides_feels_the_same_but_is_too_fast(state):
    state.estimator.velocity_n[0] = 1.0
    assert not any(second(state) for _ in range(4))


def test_a_navigation_that_does_not_know_its_speed_does_not_guess(state):
    state.estimator.P[VELOCITY, VELOCITY] = 1.0
    assert not any(second(state) for _ in range(4))


def test_off_it_finds_nothing(state):
    state.estimator.detects_standing = False
    assert not any(second(state) for _ in range(3))
