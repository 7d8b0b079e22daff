"""The turntable's axes: exactly to the target, never beyond the limits, whatever is commanded."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba import njit

from rrins.dbc.values import AxisCommand, AxisState
from rrins.host_tools.hardware import turntable
from rrins.host_tools.hardware.memory import TurntableAxis

DT = 0.005
OFF, HOLD, POSITION = AxisCommand.OFF, AxisCommand.HOLD, AxisCommand.POSITION
FOLLOW = AxisCommand.FOLLOW


def new_axis(rate_limit=0.5, acceleration_limit=0.2):
    axis = np.zeros(1, dtype=TurntableAxis.dtype)[0]
    axis["rate_limit"], axis["acceleration_limit"] = rate_limit, acceleration_limit
    axis["encoder_step_deg"] = 0.01
    axis["state"] = AxisState.HOLDING
    return axis


def advance(axis, dt=DT):
    """Run an epoch; check rate, acceleration, and that the angle is the integral of the rate."""
    turntable.advance(axis, dt)
    before, rate = axis["rate_before"], axis["rate"]
    assert abs(rate) <= axis["rate_limit"] * (1 + 1e-9)
    assert abs(rate - before) <= axis["acceleration_limit"] * dt * (1 + 1e-9)
    scale = 1 + abs(axis["angle"])
    moved = axis["angle"] - axis["angle_before"]
    assert moved == pytest.approx((before + rate) * dt / 2, abs=1e-14 * scale)


def run_until(axis, state, limit=100_000):
    for k in range(1, limit):
        advance(axis)
        if axis["state"] == state:
            return k
    raise AssertionError(f"not {state.name} within {limit} epochs")


LIMITS = st.tuples(st.floats(0.05, 2.0), st.floats(0.05, 20.0))


@njit
def drive(axes, dt, log):
    """Run until the turn is over; log angle and rate. Return how many epochs it took."""
    axis = axes[0]
    for k in range(log.shape[0]):
        turntable.advance(axis, dt)
        log[k, 0], log[k, 1] = axis.angle, axis.rate
        if axis.state != AxisState.MOVING:
            return k + 1
    return -1


@pytest.mark.slow
@settings(max_examples=200)
@given(
    LIMITS,
    st.floats(-7, 7).filter(lambda target: abs(target) > 1e-6),
    st.floats(0.05, 2.0),
    st.sampled_from([0.001, 0.005, 0.02]),
    st.floats(-3, 3),
)
def test_a_turn_ends_on_its_target_within_the_limits(limits, turn, commanded, dt, start):
    axes, log = np.zeros(1, dtype=TurntableAxis.dtype), np.zeros((200_000, 2))
    axes[0] = new_axis(*limits)
    for angle in ("drive_angle", "load_angle", "angle"):
        axes[0][angle] = start
    target, rate, acceleration = start + turn, min(limits[0], commanded), limits[1]
    turntable.command(axes[0], POSITION, target, commanded)
    epochs = drive(axes, dt, log)
    angles, rates = np.r_[start, log[:epochs, 0]], np.r_[0.0, log[:epochs, 1]]
    assert angles[-1] == axes[0]["angle"] == target
    assert rates[-1] == 0
    assert axes[0]["state"] == AxisState.HOLDING
    assert np.abs(rates).max() <= rate * (1 + 1e-9)
    assert np.abs(np.diff(rates)).max() <= acceleration * dt * (1 + 1e-9)
    # The angle is the integral of a rate that is linear in each epoch: no jump, no jerk unseen.
    assert np.abs(np.diff(angles) - (rates[1:] + rates[:-1]) * dt / 2).max() < 2e-14
    peak = min(rate, math.sqrt(abs(turn) * acceleration))
    assert epochs * dt <= abs(turn) / peak + peak / acceleration + 3 * dt  # and no time is wasted
    turntable.advance(axes[0], dt)
    assert axes[0]["angle"] == axes[0]["angle_before"] == target


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1, -1])
def test_the_papers_half_turn_takes_90_seconds_and_the_ramp(sign):
    axis = new_axis(math.radians(30), math.radians(10))
    turntable.command(axis, POSITION, sign * math.pi, math.radians(2))
    epochs = run_until(axis, AxisState.HOLDING)
    assert epochs * DT == pytest.approx(90.2, abs=DT)
    assert axis["angle"] == sign * math.pi


@pytest.mark.slow
@settings(max_examples=40)
@example(limits=(2.0, 20.0), epochs=40, target=1.5, what=POSITION)  # the same target, more slowly
@given(LIMITS, st.integers(1, 400), st.floats(-3, 3), st.sampled_from([POSITION, HOLD, OFF]))
def test_a_new_command_amid_a_turn_brakes_within_the_limits(limits, epochs, target, what):
    axis = new_axis(*limits)
    turntable.command(axis, POSITION, 1.5, 2.0)
    for _ in range(epochs):
        advance(axis)
    goes_on = what == POSITION and target == 1.5 and limits[0] <= 1.0
    moving = axis["state"] == AxisState.MOVING and not goes_on
    fastest = max(1.0, abs(axis["rate"]))
    turntable.command(axis, what, target, 1.0)
    advance(axis)
    if moving and abs(axis["rate_before"]) > 1.0:
        assert abs(axis["rate"]) < abs(axis["rate_before"])
    if moving and axis["rate_before"] != 0 and (what != POSITION or target != 1.5):
        assert axis["state"] in (AxisState.BRAKING, AxisState.OFF, AxisState.HOLDING)
    end = AxisState.OFF if what == OFF else AxisState.HOLDING
    for _ in range(200_000):
        assert abs(axis["rate"]) <= fastest * (1 + 1e-9)
        fastest = max(1.0, abs(axis["rate"]))  # above the new limit it only slows down
        if (
            axis["rate"] == 0
            and axis["state"] == end
            and (what != POSITION or axis["angle"] == target)
        ):
            break
        advance(axis)
    assert axis["state"] == end
    if what == POSITION:
        assert axis["angle"] == target


@pytest.mark.parametrize("smoothing", [0, 20])
def test_a_lower_rate_for_the_same_target_is_obeyed_amid_the_turn(smoothing):
    axis = new_axis(2.0, 4.0)
    axis["ramp_smoothing"] = smoothing
    turntable.command(axis, POSITION, 6.0, 2.0)
    for _ in range(250):
        turntable.advance(axis, DT)
    assert axis["rate"] == pytest.approx(2.0)
    turntable.command(axis, POSITION, 6.0, 0.5)
    rates, states = [], []
    for _ in range(3000):
        turntable.advance(axis, DT)
        rates.append(float(axis["rate"]))
        states.append(AxisState(int(axis["state"])))
    slow = next(k for k, rate in enumerate(rates) if rate <= 0.5)
    assert slow * DT < 1.5 * 2.0 / 4.0
    assert max(rates[slow:]) == pytest.approx(0.5)
    assert np.abs(np.diff(rates)).max() <= 4.0 * DT * (1 + 1e-9) * (1.5 if smoothing else 1)
    assert axis["angle"] == 6.0
    assert states[-1] == AxisState.HOLDING


@pytest.mark.parametrize("rate", [0.3, 0.5, 2.0])
def test_a_turn_goes_on_if_the_new_rate_allows_it(rate):
    once, again = new_axis(), new_axis()
    for axis in (once, again):
        turntable.command(axis, POSITION, 0.4, 0.3)
    for k in range(500):
        if k == 100:
            turntable.command(again, POSITION, 0.4, rate)
        advance(once)
        advance(again)
        assert once["angle"] == again["angle"]


def test_braking_takes_no_longer_than_the_deceleration_allows():
    axis = new_axis(0.5, 0.2)
    turntable.command(axis, POSITION, 10.0, 0.5)
    for _ in range(1000):
        advance(axis)
    assert axis["rate"] == pytest.approx(0.5)
    turntable.command(axis, HOLD, 0.0, 0.5)
    before = float(axis["angle"])
    epochs = run_until(axis, AxisState.HOLDING)
    assert epochs == 500  # 0.5 rad/s at 0.2 rad/s² in epochs of 5 ms
    assert axis["angle"] - before == pytest.approx(0.5 * 2.5 / 2)


@pytest.mark.parametrize(
    ("what", "state"), [(HOLD, AxisState.HOLDING), (OFF, AxisState.OFF), (7, AxisState.HOLDING)]
)
def test_an_axis_at_rest_stays_for_all_but_a_position(what, state):
    axis = new_axis()
    axis["angle"] = 0.3
    turntable.command(axis, what, 2.0, 1.0)
    for _ in range(10):
        advance(axis)
    assert axis["angle"] == 0.3
    assert axis["state"] == state


def test_an_axis_that_is_off_turns_again_when_commanded():
    axis = new_axis()
    turntable.command(axis, OFF, 0.0, 0.0)
    advance(axis)
    turntable.command(axis, POSITION, 0.1, 0.1)
    advance(axis)
    assert axis["state"] == AxisState.MOVING
    run_until(axis, AxisState.HOLDING)
    assert axis["angle"] == 0.1


@given(st.floats(-40, 40), st.sampled_from([360 / 2**10, 360 / 2**24, 0.01]))
def test_the_encoder_rounds_to_its_steps(angle, step):
    axis = new_axis()
    axis["angle"], axis["encoder_step_deg"] = angle, step
    read = turntable.encoder_angle_deg(axis)
    assert abs(read - math.degrees(angle)) <= step / 2 * (1 + 1e-9)
    assert read / step == pytest.approx(round(read / step), abs=1e-9)


def blocked_amid_a_turn():
    axis = new_axis(0.5, 10.0)
    turntable.command(axis, POSITION, 1.0, 0.5)
    for _ in range(100):
        advance(axis)
    assert axis["rate"] == 0.5
    axis["blocked"] = True
    return axis


def test_a_blocked_axis_does_not_move():
    axis = blocked_amid_a_turn()
    angle = float(axis["angle"])
    for _ in range(100):
        turntable.advance(axis, DT)
        assert axis["angle"] == angle
        assert axis["rate"] == 0


def test_a_released_axis_starts_again_within_its_limits():
    axis = blocked_amid_a_turn()
    for _ in range(10):
        turntable.advance(axis, DT)
    axis["blocked"] = False
    advance(axis)
    run_until(axis, AxisState.HOLDING)
    assert axis["angle"] == 1.0


def test_commands_and_states_are_those_of_the_dbc(tools):
    for name in ("INNER", "OUTER"):
        commands = tools.codec.choices(f"AXIS_{name}_COMMAND", "command")
        states = tools.codec.choices(f"AXIS_{name}_STATUS", "state")
        assert {int(c): c.name for c in AxisCommand} == commands
        assert {int(s): s.name for s in AxisState} == states


def test_a_target_that_moves_is_followed_without_lag():
    axis = new_axis(0.5, 0.2)
    log = []
    for k in range(1, 4001):
        target = 0.3 * DT * k
        turntable.command(axis, FOLLOW, target, 1.0)
        advance(axis)
        log.append(axis["angle"] - target)
    assert np.abs(log).max() < 0.3**2 / 0.2  # behind while it speeds up
    assert np.abs(log[-1000:]).max() < 1e-6
    assert axis["state"] == AxisState.MOVING


@settings(max_examples=50)
@given(LIMITS, st.lists(st.floats(-3, 3), min_size=1, max_size=8), st.floats(0.05, 2.0))
def test_whatever_is_to_be_followed_the_limits_hold(limits, targets, commanded):
    axis = new_axis(*limits)
    for target in targets:
        for _ in range(100):
            turntable.command(axis, FOLLOW, target, commanded)
            advance(axis)
            assert abs(axis["rate"]) <= commanded * (1 + 1e-9)


@pytest.mark.slow
def test_a_target_that_jumps_is_reached_and_kept():
    axis = new_axis(0.5, 0.2)
    turntable.command(axis, FOLLOW, 1.0, 1.0)
    angles = []
    for _ in range(4000):
        advance(axis)
        angles.append(axis["angle"])
    assert max(angles) < 1.0 + 1e-3
    assert angles[-1] == pytest.approx(1.0, abs=1e-9)


def test_after_following_an_axis_brakes_and_turns_to_its_position():
    axis = new_axis(0.5, 0.2)
    for k in range(1000):
        turntable.command(axis, FOLLOW, 0.3 * DT * k, 1.0)
        advance(axis)
    turntable.command(axis, POSITION, 0.2, 1.0)
    advance(axis)
    assert axis["state"] == AxisState.BRAKING
    run_until(axis, AxisState.HOLDING)
    run_until(axis, AxisState.MOVING)
    run_until(axis, AxisState.HOLDING)
    assert axis["angle"] == 0.2


def test_an_axis_with_limited_jerk_follows_nothing():
    axis = new_axis()
    axis["ramp_smoothing"] = 20
    turntable.command(axis, FOLLOW, 1.0, 1.0)
    advance(axis)
    assert axis["angle"] == 0
    assert axis["state"] == AxisState.HOLDING
