"""True increments against numerical integration of the continuous formulas and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.host_tools.hardware import truth
from rrins.host_tools.hardware.memory import INNER, MOTION_CHANNELS, MOTION_TERMS, OUTER, Plant

OMEGA_B = np.array([3e-5, -5e-5, 4e-5])
FORCE_B = np.array([0.5, -0.3, 9.7])
NO_MOTION = np.zeros((1, MOTION_CHANNELS, MOTION_TERMS))
ANGLE, RATE, CHANGE = st.floats(-14, 14), st.floats(-1, 1), st.floats(-0.1, 0.1)


def gimbals(inner, outer):
    """Return C_s_b = Rx(outer) Rz(inner)."""
    ci, si, co, so = math.cos(inner), math.sin(inner), math.cos(outer), math.sin(outer)
    about_x = np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
    return about_x @ np.array([[ci, -si, 0], [si, ci, 0], [0, 0, 1]])


def new_plant():
    plant = np.zeros(1, dtype=Plant.dtype)[0]
    plant["omega_ib_b"], plant["specific_force_b"] = OMEGA_B, FORCE_B
    return plant


def move(plant, dt, inner, outer):
    """Let both axes go on for `dt` with rates that end at the given ones; integrate."""
    for axis, rate in ((INNER, inner), (OUTER, outer)):
        record = plant["axis"][axis]
        record["angle_before"], record["rate_before"] = record["angle"], record["rate"]
        record["angle"] += 0.5 * (record["rate"] + rate) * dt
        record["rate"] = rate
    truth.integrate(plant, NO_MOTION, dt)
    return plant["dtheta_s"].copy(), plant["dv_s"].copy()


def integrated(plant, dt, points=10):
    """Return the increments of the epoch just moved over, by quadrature of rate and force."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    weights *= 2 / weights.sum()
    dtheta, dv = np.zeros(3), np.zeros(3)
    for t, weight in zip(dt * (nodes + 1) / 2, weights * dt / 2, strict=True):
        angles, rates = [], []
        for axis in (INNER, OUTER):
            record = plant["axis"][axis]
            slope = (record["rate"] - record["rate_before"]) / dt
            rates.append(record["rate_before"] + slope * t)
            angles.append(record["angle_before"] + record["rate_before"] * t + slope * t * t / 2)
        C_s_b = gimbals(*angles)
        # The outer axis is x of the body, the inner z of the sensors.
        relative = C_s_b.T @ [rates[OUTER], 0, 0] + [0, 0, rates[INNER]]
        dtheta += weight * (C_s_b.T @ OMEGA_B + relative)
        dv += weight * (C_s_b.T @ FORCE_B)
    return dtheta, dv


@settings(max_examples=60)
@given(ANGLE, ANGLE, st.tuples(RATE, RATE, CHANGE, CHANGE), st.sampled_from([0.001, 0.005, 0.02]))
def test_increments_are_the_integrals_of_rate_and_force(inner, outer, rates, dt):
    # Within an epoch the rate changes by the tenth of 1 rad/s at most: 5 rad/s² and more.
    plant = new_plant()
    for axis, angle, rate in ((INNER, inner, rates[0]), (OUTER, outer, rates[1])):
        plant["axis"][axis]["angle"], plant["axis"][axis]["rate"] = angle, rate
    dtheta, dv = move(plant, dt, rates[0] + rates[2], rates[1] + rates[3])
    expected_dtheta, expected_dv = integrated(plant, dt)
    assert dtheta == pytest.approx(expected_dtheta, abs=2e-15)  # the spacing of 14 rad
    assert dv == pytest.approx(expected_dv, abs=1e-15)


@given(ANGLE, ANGLE)
def test_at_rest_the_increments_are_rate_and_force_times_the_period(inner, outer):
    plant = new_plant()
    plant["axis"][INNER]["angle"], plant["axis"][OUTER]["angle"] = inner, outer
    C_b_s = gimbals(inner, outer).T
    for _ in range(3):
        dtheta, dv = move(plant, 0.005, 0.0, 0.0)
        assert dtheta == pytest.approx(C_b_s @ OMEGA_B * 0.005, abs=1e-20)
        assert dv == pytest.approx(C_b_s @ FORCE_B * 0.005, abs=1e-16)


def test_after_a_turn_the_increments_at_rest_are_those_of_the_new_angle():
    plant = new_plant()
    move(plant, 1.0, 0.0, 0.0)
    move(plant, 1.0, 0.4, 0.0)
    move(plant, 1.0, 0.0, 0.0)
    dtheta, _ = move(plant, 1.0, 0.0, 0.0)
    assert dtheta == pytest.approx(gimbals(0.4, 0.0).T @ OMEGA_B, abs=1e-18)


def total_over_a_turn(inner_rate, outer_rate, epochs=1000):
    plant = new_plant()
    plant["axis"][INNER]["rate"], plant["axis"][OUTER]["rate"] = inner_rate, outer_rate
    dt = 2 * math.pi / abs(inner_rate + outer_rate) / epochs
    total = np.zeros((2, 3))
    for _ in range(epochs):
        total += move(plant, dt, inner_rate, outer_rate)
    return total, dt * epochs


@pytest.mark.parametrize("rate", [0.5, -0.5])
def test_a_whole_inner_turn_leaves_the_parts_along_z_only(rate):
    (dtheta, dv), seconds = total_over_a_turn(rate, 0.0)
    turn = math.copysign(2 * math.pi, rate)
    assert dtheta == pytest.approx([0, 0, OMEGA_B[2] * seconds + turn], abs=1e-12)
    assert dv == pytest.approx([0, 0, FORCE_B[2] * seconds], abs=1e-11)


@pytest.mark.parametrize("rate", [0.5, -0.5])
def test_a_whole_outer_turn_leaves_the_parts_along_x_only(rate):
    (dtheta, dv), seconds = total_over_a_turn(0.0, rate)
    turn = math.copysign(2 * math.pi, rate)
    assert dtheta == pytest.approx([OMEGA_B[0] * seconds + turn, 0, 0], abs=1e-12)
    assert dv == pytest.approx([FORCE_B[0] * seconds, 0, 0], abs=1e-11)
