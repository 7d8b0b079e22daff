"""Axes that are not square, wobble or miss the centre, against formulas of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rrins.host_tools.hardware import truth, turntable
from rrins.host_tools.hardware.memory import INNER, MOTION_CHANNELS, MOTION_TERMS, OUTER, Plant

NO_MOTION = np.zeros((1, MOTION_CHANNELS, MOTION_TERMS))
OMEGA_B = np.array([3e-5, -5e-5, 4e-5])
FORCE_B = np.array([0.5, -0.3, 9.7])
ARCSEC = math.radians(1 / 3600)


def table_of(tilt=0.0, wobble=0.0, per_turn=1.0):
    plant = np.zeros(1, dtype=Plant.dtype)[0]
    plant["omega_ib_b"], plant["specific_force_b"] = OMEGA_B, FORCE_B
    table = plant["table"]
    table["non_orthogonality"], table["wobble"], table["wobble_per_turn"] = tilt, wobble, per_turn
    table["is_crooked"] = tilt != 0 or wobble != 0
    return plant


def attitude(plant, inner, outer):
    """Return C_s_b = Rx(outer) E(inner) Rz(inner), E an exact rotation."""
    table = plant["table"]
    phase = table["wobble_per_turn"] * inner
    e = [
        table["wobble"] * math.cos(phase),
        table["non_orthogonality"] + table["wobble"] * math.sin(phase),
        0.0,
    ]
    about_x, about_z = Rotation.from_rotvec([outer, 0, 0]), Rotation.from_rotvec([0, 0, inner])
    return (about_x * Rotation.from_rotvec(e) * about_z).as_matrix()


def increments(plant, dt, angles_at, points=12):
    """Return the increments of an epoch by quadrature; the turning by differences of attitudes."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    dtheta, dv = np.zeros(3), np.zeros(3)
    step = 1e-4 * dt
    for t, weight in zip(dt * (nodes + 1) / 2, weights * dt / 2, strict=True):
        C = attitude(plant, *angles_at(t))
        ends = [attitude(plant, *angles_at(t + k * step)) for k in (-2, -1, 1, 2)]
        slope = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * step)
        skew = C.T @ slope
        turning = np.array([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0],
                            skew[1, 0] - skew[0, 1]]) / 2  # fmt: skip
        dtheta += weight * (C.T @ OMEGA_B + turning)
        dv += weight * (C.T @ FORCE_B)
    return dtheta, dv


ANGLE, RATE, CHANGE = st.floats(-7, 7), st.floats(-1, 1), st.floats(-0.02, 0.02)
CROOKED = st.tuples(st.floats(-60, 60), st.floats(0, 60), st.sampled_from([1.0, 2.0, 5.0]))


@settings(max_examples=40)
@example((0.0, 0.0, 1.0), 2.0, -1.0, (0.5, -0.7, 0.01, -0.02))
@given(CROOKED, ANGLE, ANGLE, st.tuples(RATE, RATE, CHANGE, CHANGE))
def test_increments_on_a_crooked_table_are_those_of_its_attitude(crooked, inner, outer, rates):
    tilt, wobble, per_turn = crooked
    plant = table_of(tilt * ARCSEC, wobble * ARCSEC, per_turn)
    dt = 0.01
    moves = []
    for axis, angle, rate, change in ((INNER, inner, *rates[::2]), (OUTER, outer, *rates[1::2])):
        record = plant["axis"][axis]
        record["angle_before"], record["rate_before"] = angle, rate
        record["angle"], record["rate"] = angle + (rate + change / 2) * dt, rate + change
        moves.append((angle, rate, change / dt))
    truth.integrate(plant, NO_MOTION, dt)

    def angles_at(t):
        return [angle + rate * t + slope * t * t / 2 for angle, rate, slope in moves]

    dtheta, dv = increments(plant, dt, angles_at)
    # Left out: the third order of E (60″ cubed: 2.5e-11) of what is turned in the epoch.
    assert plant["dtheta_s"] == pytest.approx(dtheta, abs=5e-12)
    assert plant["dv_s"] == pytest.approx(dv, abs=1e-11)


def turn_through(plant, turns, dt=0.005):
    """Turn the axes one after the other; yield after every epoch."""
    for axis in (INNER, OUTER):
        record = plant["axis"][axis]
        record["rate_limit"], record["acceleration_limit"] = math.radians(60), math.radians(200)
        record["encoder_step_deg"] = 1e-6
    targets = [0.0, 0.0]
    for axis, turn_deg in turns:
        targets[axis] += math.radians(turn_deg)
        turntable.command(plant["axis"][axis], 2, targets[axis], math.radians(60))
        for _ in range(int((abs(turn_deg) / 60 + 0.5) / dt)):
            for one in (INNER, OUTER):
                turntable.advance(plant["axis"][one], dt)
            truth.integrate(plant, NO_MOTION, dt)
            yield


@pytest.mark.parametrize(("axis", "lever"), [(INNER, 0.002), (OUTER, -0.003)])
def test_run_out_is_felt_as_the_centres_own_acceleration(axis, lever):
    plant = table_of()
    plant["specific_force_b"] = 0.0
    plant["axis"][axis]["run_out"] = lever
    velocity, dt = np.zeros(3), 0.005
    largest = 0.0
    turns = [(INNER, 30), (OUTER, 100)] if axis == OUTER else [(OUTER, 30), (INNER, 100)]
    for _ in turn_through(plant, turns, dt):
        angles = plant["axis"]["angle"].copy()
        middle = (angles + plant["axis"]["angle_before"]) / 2
        velocity += attitude(plant, *middle) @ plant["dv_s"]
        inner, outer = plant["axis"]["rate"]
        if axis == INNER:  # the centre lies on x of the sensors
            expected = attitude(plant, *angles) @ np.cross([0, 0, inner], [lever, 0, 0])
        else:  # on y of the outer gimbal
            about_x = Rotation.from_rotvec([angles[OUTER], 0, 0]).as_matrix()
            expected = about_x @ np.cross([outer, 0, 0], [0, lever, 0])
        assert velocity == pytest.approx(expected, abs=1e-5 * abs(lever))
        largest = max(largest, np.abs(expected).max())
    assert largest == pytest.approx(abs(lever) * math.radians(60), rel=0.01)
    assert velocity == pytest.approx(0, abs=1e-5 * abs(lever))
