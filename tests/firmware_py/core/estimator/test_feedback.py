"""What the filter found, in the navigation and in the compensation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import feedback
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    VELOCITY,
)

STATES = BIASES + 8 + 3


@pytest.fixture
def state(tools, kit):
    state = kit.state(odometer=kit.ODOMETER)
    C_s_n = tools.exponential([0.3, -0.2, 1.0])
    strapdown.initialise.py_func(state.ins, C_s_n, 0.7, 2.0, 40.0)
    estimator = state.estimator
    estimator.latitude, estimator.longitude, estimator.height = 0.7, 2.0, 40.0
    state.epoch = 77
    return state


def test_every_error_is_added_and_cleared(tools, state):
    estimator, ins = state.estimator, state.ins
    before = np.array(ins.C_s_n)
    ins.velocity_n[:] = 1.0, 2.0, 3.0
    estimator.velocity_n[:] = 4.0, 5.0, 6.0  # where the filter stands
    estimator.gyro_bias[:4] = 1e-7
    x = np.linspace(1.0, 2.0, STATES)
    x[ATTITUDE : ATTITUDE + 3] = turn = np.array([0.02, -0.01, 0.03])
    x[LATITUDE], x[LONGITUDE], x[HEIGHT] = 1e-6, -2e-6, 3.0
    estimator.x[:STATES] = x
    feedback.apply.py_func(state)
    assert pytest.approx(tools.exponential(turn) @ before, abs=1e-14) == ins.C_s_n
    assert np.linalg.norm(ins.q_s_n) == pytest.approx(1.0, abs=1e-15)
    v = x[VELOCITY : VELOCITY + 3]
    assert ins.velocity_n == pytest.approx(np.array([1.0, 2.0, 3.0]) + v)
    assert estimator.velocity_n == pytest.approx(np.array([4.0, 5.0, 6.0]) + v)
    for place in (ins, estimator):
        assert place.latitude == pytest.approx(0.7 + 1e-6, abs=1e-15)
        assert place.longitude == pytest.approx(2.0 - 2e-6, abs=1e-15)
        assert place.height == pytest.approx(43.0)
    assert estimator.gyro_bias[:4] == pytest.approx(1e-7 + x[BIASES : BIASES + 4])
    assert estimator.accelerometer_bias[:4] == pytest.approx(x[BIASES + 4 : BIASES + 8])
    assert estimator.odometer == pytest.approx(x[BIASES + 8 :])
    assert estimator.correction[0] == pytest.approx([1e-6, -2e-6, 3.0, *v])
    assert (estimator.correction_epoch[0], estimator.corrections) == (77, 1)
    assert not estimator.x.any()


def test_without_an_odometer_there_is_nothing_to_learn_of_it(kit):
    state = kit.state()
    strapdown.initialise.py_func(state.ins, np.eye(3), 0.0, 0.0, 0.0)
    state.estimator.x[: BIASES + 8] = 1e-6
    feedback.apply.py_func(state)
    assert not state.estimator.odometer.any()
    assert not state.estimator.x.any()


@pytest.mark.parametrize("side", [-1, 1])
def test_the_longitude_wraps(state, side):
    estimator, ins = state.estimator, state.ins
    ins.longitude = estimator.longitude = side * (math.pi - 1e-6)
    estimator.x[LONGITUDE] = side * 3e-6
    feedback.apply.py_func(state)
    for place in (ins, estimator):
        assert place.longitude == pytest.approx(-side * (math.pi - 2e-6), abs=1e-14)


def test_biases_are_removed_as_the_sensors_add_them(state):
    """Rates along the input axes make the increments; with their biases, the fused are the same."""
    rng = np.random.default_rng(1)
    dt = 0.005
    for fusion, bias, fused in (
        (state.gyros, state.estimator.gyro_bias, state.dtheta_s),
        (state.accelerometers, state.estimator.accelerometer_bias, state.dv_s),
    ):
        bias[:4] = rng.standard_normal(4)
        true = rng.standard_normal(3)
        fused[:] = fusion.gain[:, :4] @ (fusion.H[:4] @ true + bias[:4]) * dt
    expected = []
    rng = np.random.default_rng(1)
    for _ in range(2):
        rng.standard_normal(4)
        expected.append(rng.standard_normal(3) * dt)
    feedback.compensate.py_func(state)
    assert state.dtheta_s == pytest.approx(expected[0], abs=1e-15)
    assert state.dv_s == pytest.approx(expected[1], abs=1e-15)
