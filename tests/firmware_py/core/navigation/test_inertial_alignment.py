"""Coarse alignment of a vehicle that moves: made by hand, with increments that are exact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import inertial_alignment
from rrins.firmware_py.core.sensors.fusion import prepare
from rrins.firmware_py.core.settings import power_on

RATE_HZ = 50
DT = 1 / RATE_HZ
LATITUDE = math.radians(40.0)  # the bench's
ALIGNMENT_S = 60.0


@pytest.fixture
def make_state(tools):
    def make(method):
        settings = tools.settings(rate_hz=RATE_HZ, initial_attitude=method, alignment_s=ALIGNMENT_S)
        state = power_on(settings, load_contract())[0]
        inertial_alignment.begin(state.inertial_alignment)
        return state

    return make


def swaying(tools, state, C_s_n, amplitude_mps, turn_rad, bias_dph=0.0):
    """Align for a minute on a body that heaves, surges and rolls; return its last attitude."""
    gravity = np.array([0.0, 0.0, earth.gravity(LATITUDE, 40.0)])
    earth_n = tools.earth_rate_n(LATITUDE)
    omega = 2 * math.pi / 8.0

    sway = np.sin(omega * DT * np.arange(round(ALIGNMENT_S * RATE_HZ) + 1))
    roll = Rotation.from_rotvec(turn_rad * sway[:, None] * [1.0, 0.0, 0.0])
    attitude = Rotation.from_matrix(C_s_n) * roll
    before, after = attitude[:-1], attitude[1:]
    # The turn of the Earth is one of s against inertial axes.
    rotated = (before.inv() * Rotation.from_rotvec(earth_n * DT) * after).as_rotvec()
    surge = np.diff(sway)[:, None] * amplitude_mps * np.array([1.0, -0.5, 0.7])
    middle = before * Rotation.from_rotvec(rotated / 2)
    dtheta_s = rotated + np.radians(bias_dph) / 3600 * DT
    dv_s = middle.inv().apply(gravity * DT + surge)
    for k in range(len(dtheta_s)):
        state.dtheta_s[:], state.dv_s[:], state.epoch = dtheta_s[k], dv_s[k], k
        inertial_alignment.follow(state)
    inertial_alignment.find(state)
    inertial_alignment.write_attitude(state)
    return attitude[-1].as_matrix()


def error_of(state, C_s_n):
    """Return the error of the attitude about the axes of n, rad."""
    return Rotation.from_matrix(C_s_n @ np.asarray(state.alignment.C_s_n).T).as_rotvec()


@pytest.mark.parametrize("heading", [-170.0, 20.0, 135.0])
def test_any_attitude_is_found_at_rest(tools, make_state, heading):
    state = make_state("self-aligned-swaying")
    C = tools.body_to_navigation(0.08, -2.0, math.radians(heading))
    last = swaying(tools, state, C, 0.0, 0.0)
    assert state.alignment.done
    assert error_of(state, last) == pytest.approx(np.zeros(3), abs=1e-6)


def test_sway_and_roll_cancel(tools, make_state):
    state = make_state("self-aligned-swaying")
    C = tools.body_to_navigation(0.05, -0.08, 2.0)
    last = swaying(tools, state, C, 0.05, 0.03)
    error = error_of(state, last)
    assert state.alignment.done
    assert np.abs(error[:2]).max() < 1e-4
    assert abs(error[2]) < math.radians(1.0)
    assert np.all(np.abs(error) < 3 * np.asarray(state.alignment.noise_sigma))
    rms = math.sqrt((1.0 + 0.25 + 0.49) / 2 / 2) * 0.05
    assert state.alignment.velocity_sigma == pytest.approx(rms, rel=0.3)


def test_an_east_gyro_bias_turns_the_heading_as_at_standstill(tools, make_state):
    state = make_state("self-aligned-swaying")
    last = swaying(tools, state, np.eye(3), 0.0, 0.0, np.array([0.5, 0.0, 0.0]))
    expected = math.radians(0.5) / 3600 / (earth.RATE * math.cos(LATITUDE))
    assert abs(error_of(state, last)[2]) == pytest.approx(expected, rel=0.02)


def test_the_sigma_has_the_gyros_biases_in_it(tools, make_state):
    state = make_state("self-aligned-swaying")
    state.estimator.bias_sigma[0] = math.radians(0.5) / 3600
    prepare(state.gyros, 0b1111, np.empty((3, 3)))
    swaying(tools, state, np.eye(3), 0.0, 0.0)
    fused = math.sqrt(0.75) * math.radians(0.5) / 3600  # four on a tetrahedron
    expected = fused / (earth.RATE * math.cos(LATITUDE))
    assert state.alignment.noise_sigma[2] == pytest.approx(expected, rel=0.02)


def test_while_the_heading_is_unknown_it_is_not_done(tools, make_state):
    state = make_state("self-aligned-swaying")
    swaying(tools, state, np.eye(3), 3.0, 0.0)
    assert not state.alignment.done
    assert not state.alignment.failed


def test_a_force_that_is_not_gravity_fails(make_state):
    state = make_state("self-aligned-swaying")
    for k in range(RATE_HZ):
        state.epoch = k
        state.dv_s[:] = [0.0, 0.0, 9.0 * DT]
        inertial_alignment.follow(state)
    inertial_alignment.find(state)
    assert state.alignment.failed


def test_a_sensor_that_is_left_out_begins_it_anew(make_state):
    state = make_state("self-aligned-swaying")
    for k in range(10):
        state.epoch = k
        state.dv_s[:] = [0.0, 0.0, 9.8 * DT]
        inertial_alignment.follow(state)
    assert state.alignment.epochs == 10
    state.redundancy.gyros.excluded = 2
    state.epoch = 10
    inertial_alignment.follow(state)
    assert state.alignment.epochs == 1
    assert state.inertial_alignment.samples == 1


def test_a_moving_vehicle_waits_for_fixes(make_state):
    state = make_state("self-aligned-moving")
    for k in range(20):
        state.epoch = k
        assert not inertial_alignment.follow(state)
    assert state.inertial_alignment.samples == 0
