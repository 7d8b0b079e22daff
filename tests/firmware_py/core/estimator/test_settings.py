"""The estimator's set-up: its beginning by closed forms, and what it estimates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.records.estimator_records import BIASES, ODOMETER_STATES
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, UG

LATITUDE = math.radians(40.0)
TETRAHEDRON = math.sqrt(3) / 2
"""Of one sensor's error in a component of the vector: four axes to three components evenly."""


def test_a_given_attitude_is_as_uncertain_as_is_said(kit):
    state = kit.state(kit.estimator(level_sigma=1e-3, heading_sigma=2e-2))
    assert list(state.estimator.attitude_sigma) == [1e-3, 1e-3, 2e-2]


def test_a_given_attitude_is_never_exact(kit):
    sigma = kit.state(kit.estimator()).estimator.attitude_sigma
    assert sigma == pytest.approx([ARCSEC, ARCSEC, 10 * ARCSEC])


def test_a_self_aligned_attitude_has_the_errors_of_its_sensors(kit):
    """Level: bias by gravity; heading: bias by the Earth's horizontal rate; each with its noise."""
    state = kit.state(
        kit.estimator(level_sigma=1.0, heading_sigma=1.0),
        initial_attitude="self-aligned",
        alignment_s=100.0,
    )
    force = math.hypot(50 * UG * TETRAHEDRON, 1e-5 / math.sqrt(100))
    rate = math.hypot(0.01 * DPH * TETRAHEDRON, 1e-6 / math.sqrt(100))
    level = force / earth.gravity(LATITUDE, 40.0)
    heading = rate / (earth.RATE * math.cos(LATITUDE))
    assert state.estimator.attitude_sigma == pytest.approx([level, level, heading], rel=1e-9)


def test_a_longer_alignment_knows_the_heading_better(kit):
    def heading(seconds):
        state = kit.state(initial_attitude="self-aligned", alignment_s=seconds)
        return float(state.estimator.attitude_sigma[2])

    bias = 0.01 * DPH * TETRAHEDRON / (earth.RATE * math.cos(LATITUDE))
    assert heading(1.0) > heading(100.0) > heading(10_000.0) > bias


@pytest.mark.parametrize("sensors", [4, 5])
def test_it_estimates_navigation_biases_and_the_odometer(kit, sensors):
    axes = ((0.0, 0.0), (90.0, 0.0), (90.0, 90.0), (45.0, 45.0), (45.0, 135.0))[:sensors]
    changes = {"gyro_axes_deg": axes, "accelerometer_axes_deg": axes}
    without = kit.state(**changes).estimator
    assert without.states == BIASES + 2 * sensors
    with_one = kit.state(odometer=kit.ODOMETER, **changes).estimator
    assert with_one.states == BIASES + 2 * sensors + ODOMETER_STATES


def test_biases_are_as_the_data_sheets_say(kit):
    estimator = kit.state().estimator
    assert estimator.bias_sigma == pytest.approx([0.01 * DPH, 50 * UG])  # a third, or as said
    assert estimator.white_variance[0, :4] == pytest.approx(1e-12)
    assert estimator.white_variance[1, :4] == pytest.approx(1e-10)
    least = (1e-4 * 0.01 * DPH) ** 2 / 3600
    assert estimator.walk_variance[0, :4] == pytest.approx((0.003 * DPH) ** 2 / 1000 + least)
    assert not estimator.white_variance[:, 4:].any()
    assert not estimator.walk_variance[:, 4:].any()


def test_a_bias_walks_even_by_a_perfect_data_sheet(kit):
    perfect = kit.GYROS.model_copy(update={"bias_instability": (0.0,) * 4})
    assert np.all(kit.state(kit.estimator(gyros=perfect)).estimator.walk_variance[0, :4] > 0)


@pytest.mark.parametrize(("channel", "vertical"), [("free", True), ("held", False)])
def test_the_vertical_is_estimated_where_it_is_free(kit, channel, vertical):
    assert bool(kit.state(height_channel=channel).estimator.vertical) == vertical


def test_times_are_in_epochs(kit):
    estimator = kit.state(kit.estimator(fine_alignment_s=2.5), rate_hz=100).estimator
    assert (estimator.fine_epochs, estimator.second_epochs) == (250, 100)
    assert kit.state().estimator.fine_epochs == 0
    assert bool(estimator.enabled)


def test_without_settings_there_is_no_estimator(tools):
    bench = tools.Bench()
    assert not bench.state.estimator.enabled
    assert bench.state.estimator.states == 0
