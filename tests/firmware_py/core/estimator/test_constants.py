"""Scale factors and installation errors as states: each column against the strapdown run twice."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.estimator import constants, covariance, feedback, follow, propagation
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.estimator_records import (
    ACROSS_U,
    ACROSS_V,
    ASYMMETRY,
    BIASES,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    SCALE_FACTOR,
    SENSOR_CONSTANTS,
    VELOCITY,
)
from rrins.firmware_py.core.records.memory import Ins

DT, EPOCHS = 0.005, 200
PLACE = (math.radians(47.0), 0.2, 300.0)
GRAVITY = earth.gravity(PLACE[0], PLACE[2])
FORCE_N = np.array([0.5, -0.3, GRAVITY])
RATE_S = math.radians(2.0) * np.array([2.0, -1.0, 2.0]) / 3.0
ERRORS = {"scale": SCALE_FACTOR, "asymmetry": ASYMMETRY, "u": ACROSS_U, "v": ACROSS_V}
SIZE = 1e-5


def axes(state, kind, k):
    """Return h, u, v of a sensor."""
    fusion = (state.gyros, state.accelerometers)[kind]
    u, v = state.estimator.transverse[kind, k]
    return np.array(fusion.H[k]), u, v


def measured_too_much(state, kind, k, error, moved):
    """Return what a unit of an error adds to an increment. Paper, (13), (16), (17)."""
    h, u, v = axes(state, kind, k)
    added = {
        SCALE_FACTOR: h @ moved,
        ASYMMETRY: abs(h @ moved),
        ACROSS_U: -v @ moved,
        ACROSS_V: -u @ moved,
    }
    return added[error]


def second(tools, state, kind=0, k=0, error=SCALE_FACTOR, size=0.0, note=False):
    """Return the strapdown after a second in which a sensor has an error less than was thought."""
    start = tools.exponential([0.3, -0.2, 1.0])
    array = np.zeros(1, dtype=Ins.dtype)
    ins = array[0]
    strapdown.initialise(ins, start, *PLACE)
    fusion = (state.gyros, state.accelerometers)[kind]
    step = tools.exponential(RATE_S * DT)
    middle = start @ tools.exponential(RATE_S * DT / 2)
    for _ in range(EPOCHS):
        moved = [RATE_S * DT, middle.T @ FORCE_N * DT]
        added = size * measured_too_much(state, kind, k, error, moved[kind])
        dtheta, dv = np.array(moved[0]), np.array(moved[1])
        (dtheta, dv)[kind][:] -= fusion.gain[:, k] * added
        strapdown.update_array(array, dtheta, dv, DT, strapdown.HEIGHT_FREE)
        if note:
            propagation.note.py_func(state.estimator, ins, dtheta, dv, DT)
            state.ins, state.dtheta_s[:], state.dv_s[:] = ins, dtheta, dv
            constants.note.py_func(state)
        middle = middle @ step
    return array[0]


@pytest.fixture(scope="module")
def state(tools, kit):
    state = kit.state(estimator=kit.estimator(constants=True))
    second(tools, state, note=True)
    propagation.close.py_func(state.estimator)
    propagation.fill.py_func(state)
    return state


def difference(one, two):
    turn = np.array(one.C_s_n) @ np.array(two.C_s_n).T
    x = np.zeros(BIASES)
    x[:3] = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    x[:3] /= 2
    x[VELOCITY : VELOCITY + 3] = np.array(one.velocity_n) - np.array(two.velocity_n)
    x[LATITUDE] = one.latitude - two.latitude
    x[LONGITUDE] = one.longitude - two.longitude
    x[HEIGHT] = one.height - two.height
    return x


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("kind", [0, 1])
def test_each_error_grows_as_in_the_strapdown(tools, state, kind, error):
    metres = sum(earth.radii(PLACE[0])) / 2 + PLACE[2]
    scale = np.array([1.0] * 3 + [GRAVITY] * 3 + [GRAVITY / metres] * 2 + [GRAVITY])
    for k in range(4):
        ahead = second(tools, state, kind, k, ERRORS[error], SIZE)
        back = second(tools, state, kind, k, ERRORS[error], -SIZE)
        found = difference(ahead, back) / (2 * SIZE) / scale
        at = constants.state_of.py_func(state, ERRORS[error], kind, k)
        column = np.array(state.estimator.transition[:BIASES, at]) / scale
        # Of the turn of 2° or of gravity: half an epoch, and a turn spread evenly over the second.
        size = 0.035 if kind == 0 else 1.0
        assert np.abs(found - column)[:3].max() < 2e-4 * size
        assert np.abs(found - column)[3:6].max() < 6e-3 * size
        assert np.abs(found - column)[6:].max() < 0.1 * size
        assert np.abs(column[:6]).max() > 0.01 * size


def test_every_state_is_one_error_of_one_sensor(state):
    first = state.estimator.constants_state
    found = [
        constants.state_of.py_func(state, error, kind, k)
        for error in range(SENSOR_CONSTANTS)
        for kind in range(2)
        for k in range(4)
    ]
    assert found == list(range(first, first + 32))
    assert state.estimator.states == first + 32 == BIASES + 5 * 8


def test_the_compensation_removes_what_the_errors_add(state):
    rng = np.random.default_rng(2)
    estimator = state.estimator
    estimator.constant[:, :4] = 1e-4 * rng.standard_normal((8, 4))
    for kind, fusion in enumerate((state.gyros, state.accelerometers)):
        moved = rng.standard_normal(3)
        measured = np.array(fusion.H[:4]) @ moved
        for k in range(4):
            for error in range(SENSOR_CONSTANTS):
                size = estimator.constant[SENSOR_CONSTANTS * kind + error, k]
                measured[k] += size * measured_too_much(state, kind, k, error, moved)
        fused = np.array(fusion.gain[:, :4]) @ measured
        assert np.abs(fused - moved).max() > 3e-5
        constants.remove.py_func(estimator, fusion, kind, fused)
        assert fused == pytest.approx(moved, abs=1e-7)  # second order
    estimator.constant[:] = 0.0


def test_what_is_found_is_fed_back_and_the_filter_begins_without(tools, kit):
    state = kit.state(estimator=kit.estimator(constants=True))
    strapdown.initialise(state.ins, np.eye(3), *PLACE)
    estimator, first = state.estimator, int(state.estimator.constants_state)
    estimator.x[first : first + 32] = np.arange(1, 33) * 1e-6
    feedback.apply.py_func(state)
    expected = np.arange(1, 33).reshape(4, 2, 4).swapaxes(0, 1).reshape(8, 4) * 1e-6
    assert estimator.constant[:, :4] == pytest.approx(expected)
    assert not estimator.constant[:, 4:].any()
    assert not estimator.x.any()
    estimator.moved_s[:] = estimator.size_s[:] = 1.0
    follow.begin.py_func(state)
    assert not estimator.constant.any()
    assert not estimator.moved_s.any()
    assert not estimator.size_s.any()
    sigmas = np.sqrt(np.diag(estimator.P))[first : first + 32].reshape(4, 2, 4)
    for kind, sheet in enumerate((kit.GYROS, kit.ACCELEROMETERS)):
        for error, sigma in (
            (SCALE_FACTOR, sheet.scale_sigma),
            (ASYMMETRY, sheet.asymmetry_sigma),
            (ACROSS_U, sheet.installation_sigma),
            (ACROSS_V, sheet.installation_sigma),
        ):
            assert sigmas[error, kind] == pytest.approx(sigma)


def test_only_what_moves_is_propagated_and_to_the_bit():
    """As if all moved."""
    rng = np.random.default_rng(1)
    n, moving = 20, 9
    whole = np.eye(n)
    whole[:moving] += 0.1 * rng.standard_normal((moving, n)) * (rng.random((moving, n)) < 0.7)
    root = rng.standard_normal((n, n))
    P = root @ root.T
    P = (P + P.T) / 2
    one, two = P.copy(), P.copy()
    covariance.propagate.py_func(one, n, n, whole, np.zeros((n, n)))
    covariance.propagate.py_func(two, n, moving, whole[:moving], np.zeros((moving, n)))
    assert one.tobytes() == two.tobytes()
    assert two == pytest.approx(whole @ P @ whole.T)
