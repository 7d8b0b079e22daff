"""Rotations against matrix exponentials, closed forms and the conventions of the package."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.maths import attitude

ANGLES = st.floats(-math.pi, math.pi)
COMPONENT = st.floats(-2.0, 2.0)
VECTORS = st.tuples(COMPONENT, COMPONENT, COMPONENT).map(np.array)
SCALES = st.sampled_from([1.0, 1e-1, 4e-3, 1e-5, 1e-12])
X, Y, Z = np.eye(3)


def matrix_of_vector(phi):
    q, C = np.empty(4), np.empty((3, 3))
    attitude.quaternion_of_vector(q, phi)
    attitude.matrix_of_quaternion(C, q)
    return C


def matrix_of_euler(roll, pitch, heading):
    C = np.empty((3, 3))
    attitude.matrix_of_euler(C, roll, pitch, heading)
    return C


@given(VECTORS, SCALES)
def test_a_rotation_vector_gives_the_matrix_exponential(tools, phi, scale):
    expected = tools.exponential(scale * phi)
    assert matrix_of_vector(scale * phi) == pytest.approx(expected, abs=1e-13)


@given(VECTORS, VECTORS)
def test_a_product_of_quaternions_turns_by_the_second_first(a, b):
    p, q, r, C = np.empty(4), np.empty(4), np.empty(4), np.empty((3, 3))
    attitude.quaternion_of_vector(p, a)
    attitude.quaternion_of_vector(q, b)
    attitude.multiply(r, p, q)
    attitude.matrix_of_quaternion(C, r)
    assert pytest.approx(matrix_of_vector(a) @ matrix_of_vector(b), abs=1e-14) == C


@given(VECTORS, VECTORS, SCALES)
def test_a_turn_back_undoes_the_turn_that_came_first(a, b, scale):
    phi = scale * a
    attitude.turn_back(phi, scale * b, np.empty((3, 4)))
    expected = matrix_of_vector(scale * a) @ matrix_of_vector(scale * b).T
    assert matrix_of_vector(phi) == pytest.approx(expected, abs=1e-13)


@given(VECTORS)
def test_a_matrix_gives_back_its_quaternion(phi):
    q, again = np.empty(4), np.empty(4)
    attitude.quaternion_of_vector(q, phi)
    attitude.quaternion_of_matrix(again, matrix_of_vector(phi))
    assert math.copysign(1, again @ q) * again == pytest.approx(q, abs=1e-14)


@pytest.mark.parametrize("axis", [X, Y, Z, -X, (X + Y) / math.sqrt(2), (X + Y + Z) / math.sqrt(3)])
def test_half_a_turn_survives_the_way_through_the_quaternion(axis):
    C = 2 * np.outer(axis, axis) - np.eye(3)
    q, again = np.empty(4), np.empty((3, 3))
    attitude.quaternion_of_matrix(q, C)
    attitude.matrix_of_quaternion(again, q)
    assert again == pytest.approx(C, abs=1e-15)


def test_heading_turns_forward_to_the_east_and_right_to_the_south():
    C = matrix_of_euler(0.0, 0.0, math.pi / 2)
    assert pytest.approx([1, 0, 0], abs=1e-15) == C @ Y
    assert pytest.approx([0, -1, 0], abs=1e-15) == C @ X


def test_pitch_raises_the_nose():
    assert matrix_of_euler(0.0, 0.1, 0.0) @ Y == pytest.approx([0, math.cos(0.1), math.sin(0.1)])


def test_roll_lowers_the_right_side():
    assert matrix_of_euler(0.1, 0.0, 0.0) @ X == pytest.approx([math.cos(0.1), 0, -math.sin(0.1)])


@given(ANGLES, st.floats(-1.57, 1.57), ANGLES)
def test_euler_angles_are_the_product_of_three_turns(tools, roll, pitch, heading):
    expected = tools.body_to_navigation(roll, pitch, heading)
    assert matrix_of_euler(roll, pitch, heading) == pytest.approx(expected, abs=1e-15)


@given(ANGLES, st.floats(-1.5, 1.5), st.floats(0, 2 * math.pi, exclude_max=True))
def test_a_matrix_gives_back_its_euler_angles(roll, pitch, heading):
    found = attitude.euler_of_matrix(matrix_of_euler(roll, pitch, heading))
    difference = np.subtract(found, (roll, pitch, heading))
    assert np.angle(np.exp(1j * difference)) == pytest.approx(np.zeros(3), abs=1e-13)


@pytest.mark.parametrize("heading", [-1e-17, -1e-16, -0.0, 0.0])
def test_a_heading_just_west_of_north_is_no_whole_turn(heading):
    assert 0.0 <= attitude.euler_of_matrix(matrix_of_euler(0, 0, heading))[2] < 2 * math.pi


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_a_vertical_nose_gives_finite_angles(pitch):
    C = matrix_of_euler(0.3, pitch, 0.4)
    C[2, 1] *= 1 + 1e-15  # what rounding may do
    roll, found, heading = attitude.euler_of_matrix(C)
    assert found == pytest.approx(pitch, abs=1e-7)
    assert math.isfinite(roll)
    assert math.isfinite(heading)


@given(ANGLES, ANGLES)
def test_the_gimbals_turn_as_the_paper_has_it(tools, inner, outer):
    C = np.empty((3, 3))
    attitude.gimbal_matrix(C, inner, outer)
    expected = tools.rotation(0, outer) @ tools.rotation(2, inner)  # (22)
    assert pytest.approx(expected, abs=1e-15) == C
