"""The Earth of the truth against published numbers, and against the firmware's own formula."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrins.firmware_py.core.maths import earth as firmware_earth
from rrins.host_tools.hardware import earth

LATITUDES = st.floats(-math.pi / 2, math.pi / 2)


@given(LATITUDES, st.floats(-1000, 100_000))
def test_truth_and_navigation_have_the_same_gravity_by_two_formulas(latitude, height):
    expected = firmware_earth.gravity(latitude, height)
    assert earth.normal_gravity(latitude, height) == pytest.approx(expected, rel=1e-12)


def test_the_ellipsoid_is_that_of_wgs_84():
    a, b = earth.EQUATORIAL_RADIUS, earth.POLAR_RADIUS
    assert a / (a - b) == pytest.approx(298.257223563, abs=1e-7)
    # Clairaut's theorem, f + f* = 5/2 m to first order, holds the four constants together.
    m = earth.ROTATION_RATE**2 * a * a * b / earth.GM
    gravity_flattening = earth.GRAVITY_POLE / earth.GRAVITY_EQUATOR - 1
    assert (a - b) / a + gravity_flattening == pytest.approx(2.5 * m, rel=5e-3)


@given(LATITUDES)
def test_the_earth_turns_about_its_axis(latitude):
    rate = earth.rotation_n(latitude)
    assert np.linalg.norm(rate) == pytest.approx(7.292115e-5, rel=1e-14)
    axis = [0, math.cos(latitude), math.sin(latitude)]  # the pole, as seen from here
    assert rate == pytest.approx(7.292115e-5 * np.array(axis), rel=1e-14, abs=1e-20)


@given(LATITUDES)
def test_truth_and_navigation_have_the_same_radii_by_two_formulas(latitude):
    assert earth.curvature_radii(latitude) == pytest.approx(firmware_earth.radii(latitude))


@given(LATITUDES)
def test_slopes_of_the_radii_are_their_derivatives(latitude):
    step = 1e-4
    after, before = earth.curvature_radii(latitude + step), earth.curvature_radii(latitude - step)
    expected = (np.array(after) - before) / (2 * step)
    assert earth.curvature_slopes(latitude) == pytest.approx(expected, abs=1e-3)
