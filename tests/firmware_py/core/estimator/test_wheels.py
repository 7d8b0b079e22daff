"""The odometer's rows against numerical differences of what they are the derivatives of."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import wheels
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    COMPONENTS,
    DONE,
    PITCH,
    SCALE,
    VELOCITY,
    YAW,
    Aid,
)
from rrins.firmware_py.core.records.memory import WHEEL_EPOCHS

ODOMETER = BIASES + 8
STATES = ODOMETER + 4
SECONDS = 1.2
VELOCITY_N = np.array([12.0, 16.0, 0.4])
LEARNED = np.array([0.01, -0.02, 0.015, 1.5])
"""Scale, yaw, pitch, pivot that the filter has found so far."""

LEVER_WAY_B, TURNED = np.array([0.4, 0.02, -0.01]), 0.3
"""Way by the lever arm as the body turns (m), and that turn to the right (rad)."""

LAG_S = 0.7
SLOPES = np.random.default_rng(5).normal(size=(3, STATES)) * 9.8
"""Changes of the velocity in a second by an error of the attitude or a bias of an accelerometer."""

CHANGES = [*range(ATTITUDE, ATTITUDE + 3), *range(BIASES + 4, ODOMETER)]
SLOPES[:, [k for k in range(STATES) if k not in CHANGES]] = 0.0

TRAVELLED = 24.5
FORWARD, ACROSS, UPWARD = wheels.FORWARD, wheels.ACROSS, wheels.UPWARD
WAITING = COMPONENTS * Aid.ODOMETER


@pytest.fixture
def attitude(tools):
    """C_b_n of a vehicle that rolls, climbs and heads north-east."""
    return tools.body_to_navigation(0.05, 0.03, math.radians(40.0))


@pytest.fixture
def state(kit, attitude):
    state = kit.state(odometer=kit.ODOMETER)
    estimator = state.estimator
    estimator.stretch_s = SECONDS
    estimator.stretch_m = TRAVELLED
    estimator.stretch_b[:] = attitude.T @ VELOCITY_N * SECONDS + LEVER_WAY_B
    estimator.lever_way_b[:] = LEVER_WAY_B
    estimator.stretch_turned = TURNED
    estimator.stretch_attitude[:] = attitude
    estimator.odometer[:] = LEARNED
    estimator.seconds[DONE], estimator.stretch_lag_s = 1.0, LAG_S
    estimator.transition[VELOCITY : VELOCITY + 3, :STATES] = SLOPES
    return state


def innovation(tools, attitude, component, learned, x):
    """Return measured less navigated once the errors x are fed back; the way has a part across.

    The velocity's error is that of the stretch's end; it was another one in the middle.
    """
    C_b_n = tools.exponential(x[ATTITUDE : ATTITUDE + 3]) @ attitude
    way_b = C_b_n.T @ (VELOCITY_N + x[VELOCITY : VELOCITY + 3] - LAG_S * SLOPES @ x) * SECONDS
    way_b += LEVER_WAY_B  # as the sensors say, whatever the attitude
    scale, yaw, pitch, pivot = learned + x[ODOMETER:]
    right, forward, up = tools.body_to_navigation(0.0, pitch, yaw).T @ way_b
    return {
        FORWARD: TRAVELLED * (1 + scale) - forward,
        ACROSS: -right - pivot * TURNED,
        UPWARD: -up,
    }[component]


@pytest.mark.parametrize("learned", [np.zeros(4), LEARNED], ids=["nothing", "learned"])
@pytest.mark.parametrize("component", [FORWARD, ACROSS, UPWARD])
def test_rows_are_derivatives_of_the_innovations(tools, state, attitude, component, learned):
    state.estimator.odometer[:] = learned
    found, _ = wheels.innovation.py_func(state, component)
    none = np.zeros(STATES)
    assert found == pytest.approx(innovation(tools, attitude, component, learned, none), abs=1e-12)
    differences = np.zeros(STATES)
    for k in range(STATES):
        x = np.zeros(STATES)
        x[k] = 1e-5
        high = innovation(tools, attitude, component, learned, x)
        differences[k] = (innovation(tools, attitude, component, learned, -x) - high) / 2e-5
    row = np.array(state.estimator.row[:STATES])
    assert row == pytest.approx(differences, abs=1e-6)
    assert abs(row[ODOMETER + {FORWARD: SCALE, ACROSS: YAW, UPWARD: PITCH}[component]]) > 20


def test_the_noise_is_that_of_intervals_pulses_and_slip(state):
    """Independent intervals: 0.02 m/s in each of 0.1 s; two pulses, each uniform over 1 cm."""
    _, forward = wheels.innovation.py_func(state, FORWARD)
    intervals = SECONDS / 0.1
    pulses = 2 * 0.01**2 / 12
    assert forward == pytest.approx(math.sqrt(intervals * (0.02 * 0.1) ** 2 + pulses))
    for component, pivot in ((ACROSS, 0.3), (UPWARD, 2.0)):
        _, sigma = wheels.innovation.py_func(state, component)
        assert sigma == pytest.approx(math.hypot(0.05 * SECONDS, pivot * TURNED))


class Stretches:
    """Counts of an odometer, one call each second."""

    def __init__(self, state):
        self.state, self.estimator, self.odometer = state, state.estimator, state.odometer
        self.odometer.available = True
        wheels.begin.py_func(state)
        state.wheel.first, state.wheel.last = 0, 2000

    def second(self, epoch, travelled, way_b, gaps=0, age=5):
        """Finish a second at an epoch, with a count an age (epochs) before."""
        self.state.epoch = epoch
        self.odometer.epoch = epoch - age
        self.odometer.travelled = travelled
        self.odometer.gaps = gaps
        self.state.wheel.track[(epoch - age) % WHEEL_EPOCHS, :3] = way_b
        self.estimator.waiting = 0
        wheels.finish_second.py_func(self.state)
        return int(self.estimator.waiting) >> WAITING & 0b111


def test_a_stretch_is_from_count_to_count(state):
    stretches, estimator = Stretches(state), state.estimator
    assert stretches.second(200, 10.0, (1.0, 2.0, 3.0)) == 0  # where it begins
    assert stretches.second(400, 31.0, (1.5, 22.0, 3.25), age=25) == 0b111
    assert estimator.stretch_m == pytest.approx(21.0)
    assert estimator.stretch_s == pytest.approx(0.9)
    assert estimator.stretch_b == pytest.approx([0.5, 20.0, 0.25])
    assert stretches.second(600, 40.0, (1.5, 30.0, 3.25)) == 0b111
    assert estimator.stretch_m == pytest.approx(9.0)
    assert estimator.stretch_s == pytest.approx(1.1)


@pytest.mark.parametrize("component", [FORWARD, ACROSS])
def test_in_a_turn_a_wheel_does_not_tell_the_heading(tools, state, component):
    """A way that is turned with the velocity about up is the same way along the vehicle."""
    stretches, estimator, rate, speed, dt = Stretches(state), state.estimator, 0.1, 10.0, 5e-3
    track, up, way = state.wheel.track, np.array([0.0, 0.0, 1.0]), np.zeros(12)
    for epoch in range(200, 396):
        C_b_n = tools.exponential(up * rate * epoch * dt)
        way[1] += speed * dt
        way[3:] += C_b_n.ravel() * dt
        track[epoch % WHEEL_EPOCHS, :12] = way
    velocity = C_b_n @ [0.0, speed, 0.0]
    stretches.second(205, 10.0, track[200, :3])
    assert stretches.second(400, 20.0, way[:3]) == 0b111
    x = np.zeros(STATES)
    x[ATTITUDE : ATTITUDE + 3] = up
    x[VELOCITY : VELOCITY + 3] = np.cross(up, velocity)
    slopes = estimator.transition[VELOCITY : VELOCITY + 3]
    slopes[:] = 0.0  # the velocity changes by rate x velocity, which the error turns, too
    slopes[:, ATTITUDE + 2] = np.cross(up, np.cross(rate * up, velocity))
    wheels.innovation.py_func(state, component)
    way_m, turned = speed * estimator.stretch_s, rate * estimator.stretch_s
    assert abs(estimator.row[:STATES] @ x) < way_m * turned**2  # a row of one instant: turned / 2


def test_a_stretch_with_a_gap_is_none(state):
    stretches = Stretches(state)
    stretches.second(200, 10.0, (0, 0, 0))
    assert stretches.second(400, 20.0, (0, 10, 0), gaps=1) == 0
    assert stretches.second(600, 30.0, (0, 20, 0), gaps=1) == 0b111
    state.odometer.available = False
    assert stretches.second(800, 30.0, (0, 20, 0), gaps=1) == 0
    state.odometer.available = True
    assert stretches.second(1000, 40.0, (0, 20, 0), gaps=1) == 0
    assert stretches.second(1200, 50.0, (0, 30, 0), gaps=1) == 0b111


def test_a_count_that_is_not_new_or_too_long_ago_makes_no_stretch(state):
    stretches = Stretches(state)
    stretches.second(200, 10.0, (0, 0, 0))
    assert stretches.second(400, 10.0, (0, 0, 0), age=205) == 0
    assert stretches.second(900, 20.0, (0, 10, 0)) == 0  # 3.5 s
    assert stretches.second(1100, 30.0, (0, 20, 0)) == 0b111


def test_where_the_height_is_held_nothing_upward_is_compared(kit):
    stretches = Stretches(kit.state(odometer=kit.ODOMETER, height_channel="held"))
    stretches.second(200, 10.0, (0, 0, 0))
    assert stretches.second(400, 20.0, (0, 10, 0)) == 0b011
