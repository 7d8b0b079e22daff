"""The real axis: jerk limit, stiction, ripple, runaway, encoder; always back on its target."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from rrins.dbc.values import AxisCommand, AxisState
from rrins.host_tools.hardware import turntable
from rrins.host_tools.hardware.memory import INNER, TurntableAxis
from rrins.host_tools.hardware.settings import power_on
from rrins.host_tools.hardware.tables import Turntable

DT = 0.005
OFF, HOLD, POSITION = AxisCommand.OFF, AxisCommand.HOLD, AxisCommand.POSITION


@pytest.fixture
def made(tools):
    """Return a function that makes an axis as the hardware does, of a scenario's keys."""

    def make(**keys):
        plants = power_on(tools.settings(turntable=Turntable(inner=keys)))
        return plants["axis"][0, INNER : INNER + 1].copy()

    return make


@njit
def run(axes, dt, log):
    """Log angle, rate, drive's angle and drive's rate after each epoch."""
    axis = axes[0]
    for k in range(log.shape[0]):
        turntable.advance(axis, dt)
        log[k, 0], log[k, 1] = axis.angle, axis.rate
        log[k, 2], log[k, 3] = axis.drive_angle, axis.drive_rate


def turned(axes, epochs, target=None, rate=0.5, what=POSITION):
    """Command, run and return the log."""
    if target is not None or what != POSITION:
        turntable.command(axes[0], what, target or 0.0, rate)
    log = np.zeros((epochs, 4))
    run(axes, DT, log)
    return log


# Jerk


def limited(rate, acceleration, rise_s):
    axes = np.zeros(1, dtype=TurntableAxis.dtype)
    axes["rate_limit"], axes["acceleration_limit"] = rate, acceleration
    axes["ramp_smoothing"] = math.ceil(rise_s / DT - 1e-9)
    axes["state"], axes["encoder_step_deg"] = AxisState.HOLDING, 0.01
    return axes, acceleration / (math.ceil(rise_s / DT - 1e-9) * DT)


def assert_smooth(rates, rate, acceleration, jerk):
    assert np.abs(rates).max() <= rate * (1 + 1e-9)
    accelerations = np.diff(rates) / DT
    assert np.abs(accelerations).max() <= acceleration * (1 + 1e-6)
    jerks = np.diff(np.r_[0.0, accelerations, 0.0]) / DT
    assert np.abs(jerks).max() <= jerk * (1 + 1e-6)


LIMITS = st.tuples(st.floats(0.05, 2.0), st.floats(0.05, 20.0), st.floats(0.011, 1.5))


@pytest.mark.slow
@settings(max_examples=150)
@given(LIMITS, st.floats(-7, 7).filter(lambda turn: abs(turn) > 1e-6), st.floats(-3, 3))
def test_rate_acceleration_and_jerk_stay_within_their_limits(limits, turn, start):
    rate, acceleration, rise_s = limits
    axes, jerk = limited(*limits)
    for angle in ("drive_angle", "load_angle", "angle"):
        axes[angle] = start
    peak = min(rate, math.sqrt(abs(turn) * acceleration))
    longest_s = abs(turn) / peak + peak / acceleration + rise_s
    slowest_s = longest_s + rise_s * math.sqrt(1 + abs(turn)) + 4 * rise_s + 1
    log = turned(axes, int(slowest_s / DT), start + turn, rate)
    rates = np.r_[0.0, log[:, 1]]
    assert log[-1, 0] == start + turn
    assert axes[0]["state"] == AxisState.HOLDING
    assert_smooth(rates, rate, acceleration, jerk)
    angles = np.r_[start, log[:, 0]]
    assert np.abs(np.diff(angles) - (rates[1:] + rates[:-1]) * DT / 2).max() < 1e-12


def test_a_long_turn_takes_as_much_longer_as_the_acceleration_rises(made):
    axes = made(jerk_limit_dps3=20.0)
    log = turned(axes, int(95 / DT), math.pi, math.radians(2))
    moving = np.count_nonzero(log[:, 1]) * DT
    assert moving == pytest.approx(90 + 2 / 10 + 10 / 20, abs=3 * DT)
    assert log[-1, 0] == math.pi


@settings(max_examples=150)
@given(LIMITS, st.integers(1, 800), st.sampled_from([HOLD, OFF, POSITION]))
def test_braking_holds_the_jerk_limit_too(limits, epochs, what):
    rate, acceleration, _ = limits
    axes, jerk = limited(*limits)
    before = turned(axes, epochs, 3.0, rate)
    target = -1.0 if what == POSITION else None
    after = turned(axes, 60_000, target, rate, what)
    rates = np.r_[0.0, before[:, 1], after[:, 1]]
    accelerations = np.diff(rates) / DT
    assert np.abs(rates).max() <= rate * (1 + 1e-9)
    assert np.abs(accelerations).max() <= acceleration * (1 + 1e-6)
    assert np.abs(np.diff(accelerations)).max() / DT <= jerk * (1 + 1e-6)
    assert rates[-1] == 0
    assert axes[0]["state"] == (AxisState.OFF if what == OFF else AxisState.HOLDING)
    if what == POSITION:
        assert axes[0]["angle"] == -1.0


def test_without_a_jerk_limit_braking_is_as_short_as_can_be(made):
    axes = made()
    turned(axes, 2000, 10.0, math.radians(20))
    log = turned(axes, 1000, what=HOLD)
    assert np.count_nonzero(log[:, 1]) == 399  # 20 °/s at 10 °/s² in epochs of 5 ms


# Stiction


def test_stiction_holds_the_table_until_the_drive_has_wound_up(made):
    stiction = math.radians(0.1)
    axes = made(stiction_arcsec=360)
    log = turned(axes, 4000, 0.5, math.radians(2))
    angle, drive = log[:, 0], log[:, 2]
    stands = drive <= stiction
    assert stands.sum() > 10
    assert not angle[stands].any()
    assert not log[stands, 1].any()
    assert angle[~stands].all()
    # Free, it follows with a time constant of 50 ms: at 2 °/s a tenth of a degree behind.
    assert (drive - angle)[2000] == pytest.approx(math.radians(2) * 0.05, rel=0.06)


def test_a_sticking_table_ends_within_a_thousandth_of_the_stiction(made):
    axes = made(stiction_arcsec=180)
    log = turned(axes, 6000, 0.5, math.radians(5))
    end = log[-1, 0]
    assert abs(end - 0.5) <= 1e-3 * math.radians(0.05)
    assert log[-1, 1] == 0
    back = turned(axes, 6000, 0.0, math.radians(5))
    assert abs(back[-1, 0]) <= 1e-3 * math.radians(0.05)
    assert axes[0]["sticks"]


def test_a_turn_smaller_than_the_stiction_moves_nothing(made):
    axes = made(stiction_arcsec=360)
    log = turned(axes, 1000, math.radians(0.09))
    assert not log[:, 0].any()
    assert turntable.encoder_angle_deg(axes[0]) == 0


# Ripple


def test_ripple_is_a_function_of_the_angle_and_its_rate_the_derivative(made):
    ripple, per_turn, rate = math.radians(20 / 3600), 36.0, math.radians(2)
    axes = made(ripple_arcsec=20, ripple_per_turn=per_turn)
    log = turned(axes, int(40 / DT), 1.0, rate)
    angle, load, load_rate = log[:, 0], log[:, 2], log[:, 3]
    assert angle == pytest.approx(load + ripple * np.sin(per_turn * load), abs=1e-14)
    assert log[:, 1] == pytest.approx(load_rate * (1 + ripple * per_turn * np.cos(per_turn * load)))
    moved = np.diff(angle)
    mean_rate = (log[1:, 1] + log[:-1, 1]) / 2
    assert moved == pytest.approx(mean_rate * DT, abs=1e-9)
    cruising = log[1000:4000, 1] / log[1000, 3] - 1
    assert cruising.max() == pytest.approx(ripple * per_turn, rel=1e-3)
    assert cruising.min() == pytest.approx(-ripple * per_turn, rel=1e-3)
    assert log[-1, 1] == 0


# Faults


def test_a_runaway_turns_at_its_rate_and_comes_back_when_it_is_over(made):
    axes = made()
    turned(axes, 100, 0.0)
    axes["runaway"], axes["runaway_rate"] = True, math.radians(-5)
    log = turned(axes, 400)
    assert log[-1, 1] == pytest.approx(math.radians(-5))
    assert np.abs(np.diff(log[:, 1])).max() <= math.radians(10) * DT * (1 + 1e-9)
    axes["runaway"] = False
    back = turned(axes, 4000)
    assert back[-1, 0] == 0.0
    assert axes[0]["state"] == AxisState.HOLDING
    assert np.abs(np.diff(np.r_[log[-1, 1], back[:, 1]])).max() <= math.radians(10) * DT * 1.001


@pytest.mark.parametrize("keys", [{}, {"stiction_arcsec": 180}, {"ripple_arcsec": 36}])
def test_a_stall_stands_at_once_and_the_turn_goes_on_afterwards(made, keys):
    axes = made(**keys)
    turned(axes, 1000, 1.0, math.radians(10))
    axes["blocked"] = True
    stalled = turned(axes, 200)
    assert np.ptp(stalled[:, 0]) == 0
    assert not stalled[:, 1].any()
    axes["blocked"] = False
    log = turned(axes, 3000)
    ripple = math.radians(keys.get("ripple_arcsec", 0) / 3600)
    assert log[-1, 0] == pytest.approx(1.0, abs=1e-3 * math.radians(0.05) + ripple)


# Encoder


def test_the_encoder_reads_the_table_with_offset_and_slip_in_its_steps(made):
    step = 360 / 2**12
    axes = made(encoder_bits=12, encoder_offset_deg=0.5)
    turned(axes, 4000, math.radians(33.3), math.radians(10))
    reading = turntable.encoder_angle_deg(axes[0])
    assert reading == pytest.approx(33.8, abs=step / 2 + 1e-9)
    assert reading / step == pytest.approx(round(reading / step), abs=1e-9)
    axes["encoder_error_deg"] = -2
    assert turntable.encoder_angle_deg(axes[0]) == pytest.approx(31.8, abs=step / 2 + 1e-9)
