"""Sensors: equations (5) to (17) term by term, range, counting and what it leaves over."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.host_tools.hardware.memory import Sensors
from rrins.host_tools.hardware.sensors import input_axis, installed_axis, measure, transverse_axes

LARGEST = (1 << 23) - 1
FINE = 1e-12  # a count so small that what is measured can be read from the counts
DIRECTIONS = st.tuples(st.floats(0, math.pi), st.floats(0, 2 * math.pi))
X = np.array([0.003, 0.0, 0.0])
NO_FORCE = np.zeros(3)


def one_sensor(**values):
    """Return a sensor along x with a wide range."""
    sensors = np.zeros(1, dtype=Sensors.dtype)[0]
    sensors["count"], sensors["range_increment"] = 1, 1e3
    sensors["axis"][0] = [1, 0, 0]
    for name, value in values.items():
        if name == "range_increment":
            sensors[name] = value
        else:
            sensors[name][0] = value
    return sensors


def measured(sensors, true_s, largest=1 << 50):
    measure(sensors, np.asarray(true_s, dtype=float), NO_FORCE, FINE, largest)
    return sensors["counts"][0] * FINE


@pytest.mark.parametrize(
    ("alpha_deg", "beta_deg", "axis"),
    [(0, 0, [0, 0, 1]), (90, 0, [1, 0, 0]), (90, 90, [0, 1, 0]), (180, 77, [0, 0, -1])],
)
def test_the_angles_of_an_axis_count_from_z_and_from_x(alpha_deg, beta_deg, axis):
    h = input_axis(math.radians(alpha_deg), math.radians(beta_deg))
    assert h == pytest.approx(axis, abs=1e-15)


@given(DIRECTIONS)
def test_h_u_and_v_are_right_handed_and_orthonormal(direction):
    h = input_axis(*direction)
    u, v = transverse_axes(*direction)
    triad = np.array([h, u, v])
    assert triad @ triad.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(triad) == pytest.approx(1)


SMALL = st.floats(-1e-4, 1e-4)


@given(DIRECTIONS, SMALL, SMALL)
def test_the_installed_axis_is_turned_by_the_rotation_vector(direction, delta_u, delta_v):
    h = input_axis(*direction)
    u, v = transverse_axes(*direction)
    phi = delta_u * u - delta_v * v  # (12)
    turned = h + np.cross(phi, h) + np.cross(phi, np.cross(phi, h)) / 2
    assert installed_axis(*direction, delta_u, delta_v) == pytest.approx(turned, abs=2e-8)
    off = installed_axis(*direction, delta_u, delta_v) - h  # (13)
    assert (off @ u, off @ v) == pytest.approx((-delta_v, -delta_u), abs=5e-16)


def test_an_ideal_sensor_measures_along_its_axis():
    assert measured(one_sensor(axis=[0.6, 0.8, 0.0]), [0.01, 0.02, 0.5]) == pytest.approx(0.022)


def test_the_sign_is_that_of_the_installed_axis():
    sensors = one_sensor(asymmetric_scale_error=0.1, axis=[-1, 0, 0])
    assert measured(sensors, X) == pytest.approx(-0.003 + 0.0003)


def test_all_errors_together_are_equation_16():
    x, scale, asymmetric, bias = -0.003, 2e-3, 5e-4, 1e-5
    sensors = one_sensor(scale_error=scale, asymmetric_scale_error=asymmetric, bias_increment=bias)
    expected = (1 + scale + asymmetric * np.sign(x)) * x + bias
    assert measured(sensors, [x, 0.2, 0.3]) == pytest.approx(expected)


def test_noise_has_its_mean_and_variance():
    sensors = one_sensor(noise_increment=1e-5, noise_state=99)
    n = 5000
    sample = np.array([measured(sensors, X) for _ in range(n)]) - 0.003
    assert abs(sample.mean()) < 4e-5 / math.sqrt(n)
    assert sample.std() == pytest.approx(1e-5, rel=4 / math.sqrt(2 * n))


INCREMENTS = st.lists(st.floats(-5e-8, 5e-8), min_size=1, max_size=200)


@settings(max_examples=50)
@given(INCREMENTS)
def test_counts_are_never_further_than_half_a_count_from_the_truth(increments):
    sensors, unit, total, truth = one_sensor(), 4e-9, 0, 0.0
    for increment in increments:
        measure(sensors, np.array([increment, 0, 0]), NO_FORCE, unit, LARGEST)
        total += int(sensors["counts"][0])
        truth += increment
        assert abs(total - truth / unit) <= 0.5 + 1e-9


def test_a_rate_of_a_hundredth_of_a_count_is_not_lost():
    sensors, total = one_sensor(), 0
    for _ in range(1000):
        measure(sensors, np.array([4e-11, 0, 0]), NO_FORCE, 4e-9, LARGEST)
        total += int(sensors["counts"][0])
    assert total == 10


@pytest.mark.parametrize("sign", [1, -1])
def test_a_sensor_saturates_at_its_range_and_says_so(sign):
    sensors = one_sensor(range_increment=0.002)
    assert measured(sensors, sign * X) == pytest.approx(sign * 0.002)
    assert sensors["saturated"] == 1
    assert measured(sensors, sign * X / 2) == pytest.approx(sign * 0.0015)
    assert sensors["saturated"] == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_a_count_saturates_at_what_a_frame_can_carry(sign):
    sensors = one_sensor()
    for true, count, saturated in ((0.9, 9, 0), (1.0, 10, 0), (2.06, 10, 1), (0.5, 5, 0)):
        measure(sensors, np.array([sign * true, 0, 0]), NO_FORCE, 0.1, 10)
        assert sensors["counts"][0] == sign * count
        assert sensors["saturated"] == saturated


def test_each_sensor_saturates_for_itself():
    sensors = one_sensor(range_increment=0.5)
    sensors["count"] = 3
    sensors["axis"][1:3] = [[0, 1, 0], [0, 0, 1]]
    measure(sensors, np.array([0.1, -0.9, 0.9]), NO_FORCE, FINE, 1 << 50)
    assert sensors["saturated"] == 0b110
    assert sensors["counts"][:3] * FINE == pytest.approx([0.1, -0.5, 0.5])
