"""The wheel's way by the navigation, on motions whose way is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.aiding import wheel
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.memory import WHEEL_EPOCHS, blank_ram

DT = 0.005
EPOCHS = 200


@pytest.fixture
def state():
    state = blank_ram()[0]
    state.odometer.interval_epochs = 20
    state.modes.mode = Mode.NAVIGATION_STRAPDOWN
    state.parameters.period_ns = round(DT * 1e9)
    return state


def drive(tools, state, rate_b, velocity_n, epochs=EPOCHS):
    """Let a vehicle turn about its axes at a rate, over a second after the first epoch."""
    C_b_n = tools.exponential([0.0, 0.0, 0.3])
    strapdown.initialise.py_func(state.ins, C_b_n, 0.7, 2.0, 40.0)
    state.C_s_b = np.eye(3)
    state.ins.C_s_n = C_b_n
    step = tools.exponential(np.array(rate_b) * DT)
    attitudes = []
    for k in range(epochs + 1):
        state.epoch = 1000 + k
        state.ins.first = k == 0
        if k > 0:
            C_b_n = C_b_n @ step
            attitudes.append(C_b_n)
        state.ins.C_s_n = C_b_n
        state.ins.velocity_n[:] = velocity_n
        wheel.follow.py_func(state)
    return np.array(attitudes)


def test_the_way_is_the_velocity_along_the_body(tools, state):
    C_b_n = drive(tools, state, (0, 0, 0), (3.0, 4.0, 0.0))[-1]
    assert state.wheel.way_b == pytest.approx(C_b_n.T @ [3.0, 4.0, 0.0], abs=1e-12)
    assert state.wheel.turned_b == pytest.approx(0.0, abs=1e-12)


def test_the_wheel_moves_where_the_vehicle_turns_on_the_spot(tools, state):
    """2 m to the right of the centre at 0.5 rad/s to the left: 1 m/s forward."""
    state.odometer.lever_arm_b = 2.0, 0.0, 0.0
    drive(tools, state, (0, 0, 0.5), (0, 0, 0))
    assert state.wheel.way_b == pytest.approx([0.0, 1.0, 0.0], abs=3e-3)
    assert state.wheel.turned_b == pytest.approx(-0.5, abs=1e-5)


def test_what_the_lever_arm_makes_is_known_apart(tools, state):
    state.odometer.lever_arm_b = 2.0, -1.0, 0.5
    drive(tools, state, (0.1, -0.2, 0.4), (0, 0, 0))
    assert state.wheel.lever_way_b == pytest.approx(state.wheel.way_b, abs=1e-12)
    assert np.linalg.norm(state.wheel.way_b) > 0.5


def test_a_correction_of_the_attitude_does_not_move_the_wheel(tools, state):
    state.odometer.lever_arm_b = 2.0, -1.0, 0.5
    drive(tools, state, (0, 0, 0), (0, 0, 0), epochs=10)
    state.ins.C_s_n = tools.exponential([0.0, 0.0, 0.02]) @ state.ins.C_s_n
    wheel.turn_lever.py_func(state)
    state.epoch += 1
    wheel.follow.py_func(state)
    assert state.wheel.way_b == pytest.approx(np.zeros(3), abs=1e-12)
    assert state.wheel.turned_b == pytest.approx(0.0, abs=1e-12)


def test_attitude_and_turn_add_up(tools, state):
    attitudes = drive(tools, state, (0.1, -0.2, 0.4), (0, 0, 0))
    assert state.wheel.attitude_b == pytest.approx(attitudes.sum(axis=0) * DT, abs=1e-12)
    assert state.wheel.turned_b == pytest.approx(-0.4, abs=1e-3)


@pytest.mark.slow
def test_each_epoch_is_kept_for_a_while(tools, state):
    drive(tools, state, (0, 0, 0), (3.0, 4.0, 0.0), epochs=WHEEL_EPOCHS + 10)
    last, speed = 1000 + WHEEL_EPOCHS + 10, 5.0
    known = [wheel.is_known.py_func(state.wheel, epoch) for epoch in (1010, 1011, last, last + 1)]
    assert known == [False, True, True, False]
    ways = state.wheel.track[[1011 % WHEEL_EPOCHS, last % WHEEL_EPOCHS], :3]
    assert np.linalg.norm(ways, axis=1) == pytest.approx(
        [11 * DT * speed, (last - 1000) * DT * speed]
    )


def test_after_a_pause_the_way_begins_anew(tools, state):
    drive(tools, state, (0, 0, 0), (3.0, 4.0, 0.0))
    state.modes.mode = Mode.STANDBY
    state.epoch += 1
    wheel.follow.py_func(state)
    state.modes.mode = Mode.NAVIGATION_STRAPDOWN
    state.epoch += 1
    wheel.follow.py_func(state)
    assert not np.any(state.wheel.way_b)
    assert not wheel.is_known.py_func(state.wheel, state.epoch - 1)
    assert wheel.is_known.py_func(state.wheel, state.epoch)


def test_a_vehicle_slips_a_little_more_in_a_turn_and_hardly_where_it_stands():
    ahead, still = np.array([0.0, 10.0, 0.0]), np.array([0.0, 0.1, 0.0])
    assert wheel.slip_sigma.py_func(10.0, ahead, 0.0, 1.2) == pytest.approx(0.05 * 1.2)
    turning = wheel.slip_sigma.py_func(10.0, ahead, -0.2, 1.2)
    assert turning == pytest.approx(math.hypot(0.05 * 1.2, 2.0 * 0.2))
    assert wheel.slip_sigma.py_func(0.0, still, 0.0, 1.2) == pytest.approx(0.005 * 1.2)
    locked = wheel.slip_sigma.py_func(0.0, ahead, 0.0, 1.2)
    assert locked == pytest.approx(0.05 * 1.2)
