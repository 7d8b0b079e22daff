"""The firmware's Earth against published numbers of WGS-84."""

from __future__ import annotations

import math

import pytest

from rrins.firmware_py.core.maths import earth


@pytest.mark.parametrize(
    ("latitude_deg", "expected"),
    [(0, 9.7803253359), (90, 9.8321849378), (-90, 9.8321849378), (45, 9.8061977693)],
)
def test_gravity_on_the_ellipsoid_is_the_published_one(latitude_deg, expected):
    assert earth.gravity(math.radians(latitude_deg), 0.0) == pytest.approx(expected, abs=2e-10)


@pytest.mark.parametrize(
    ("latitude_deg", "meridian", "prime_vertical"),
    [
        (0, 6335439.3273, 6378137.0),
        (45, 6367381.8156, 6388838.2901),
        (90, 6399593.6258, 6399593.6258),
    ],
)
def test_radii_of_curvature_are_the_published_ones(latitude_deg, meridian, prime_vertical):
    radii = earth.radii(math.radians(latitude_deg))
    assert radii == pytest.approx((meridian, prime_vertical), abs=1e-4)


@pytest.mark.parametrize("latitude_deg", [0, 30, 45, 90])
def test_gravity_falls_with_height_by_the_free_air_gradient(latitude_deg):
    # Bruns' formula is exact: -(1/M + 1/N) γ - 2 ω²; ours leaves out terms of f².
    latitude = math.radians(latitude_deg)
    curvature = sum(1 / radius for radius in earth.radii(latitude))
    expected = -curvature * earth.gravity(latitude, 0.0) - 2 * earth.RATE**2
    gradient = (earth.gravity(latitude, 1.0) - earth.gravity(latitude, -1.0)) / 2
    assert gradient == pytest.approx(expected, rel=4e-5)
    assert gradient == pytest.approx(-3.086e-6, rel=1e-3)
