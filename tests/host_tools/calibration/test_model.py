"""The measurement model against the hardware's own truth, its derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.sensors.calibration import ARCSEC
from rrins.host_tools.calibration.model import (
    BASE,
    Axes,
    Site,
    derivatives,
    inputs,
    predicted,
    rotation,
)
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.calibration.unit import SQUARE_ARCSEC, true_constants
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.scenario.scenario import Scenario

AXES = Axes.of(GEOMETRIES["tetrahedron"])


def test_predicts_what_the_hardware_counts(silent: tuple[Scenario, Seconds]) -> None:
    scenario, seconds = silent
    site = Site(np.radians(scenario.site.latitude_deg), scenario.site.height_m)
    true_attitude = body_to_navigation(0.0, 0.0, 0.0)
    given = inputs(seconds, site, true_attitude, SQUARE_ARCSEC * ARCSEC)
    for sums, constants, one, count in zip(
        (seconds.gyro, seconds.accelerometer),
        true_constants(scenario),
        given,
        (1e-8, 1e-5),  # of a second: steps of the encoder (0.08″), counts, changes of sign
        strict=True,
    ):
        off = sums - predicted(AXES, constants, one, seconds.duration_s)
        assert np.sqrt((off**2).mean()) < 20 * count
        turning = np.abs(one.x).sum()
        assert np.abs(off).sum() < 1e-5 * turning


@pytest.mark.parametrize("kind", [0, 1])
def test_derivatives_are_those_of_differences(silent: tuple[Scenario, Seconds], kind: int) -> None:
    _, seconds = silent
    seconds = seconds.where(slice(100, 900, 7))
    site = Site(0.7, 0.0)
    C_b_n, epsilon = rotation(np.array([0.1, -0.2, 0.5])), 1e-3
    rng = np.random.default_rng(3)
    constants = rng.normal(0, 1e-3, (4, 5))
    T = seconds.duration_s
    given = inputs(seconds, site, C_b_n, epsilon)[kind]
    step = 1e-6
    for sensor in range(4):
        own, base = derivatives(AXES, constants, given, T, sensor)
        for k in range(5):
            changed = constants.copy()
            changed[sensor, k] += step
            ahead = predicted(AXES, changed, given, T)[:, sensor]
            changed[sensor, k] -= 2 * step
            behind = predicted(AXES, changed, given, T)[:, sensor]
            size = np.abs(own[:, k]).max()
            np.testing.assert_allclose((ahead - behind) / (2 * step), own[:, k], atol=1e-6 * size)
        for k in range(BASE):
            turn = np.zeros(BASE)
            turn[k] = step
            both = [
                predicted(
                    AXES,
                    constants,
                    inputs(
                        seconds, site, C_b_n @ rotation(sign * turn[:3]), epsilon + sign * turn[3]
                    )[kind],
                    T,
                )[:, sensor]
                for sign in (1, -1)
            ]
            size = np.abs(base[:, k]).max()
            np.testing.assert_allclose(
                (both[0] - both[1]) / (2 * step), base[:, k], atol=1e-6 * size
            )


def test_a_common_turn_about_z_is_the_zero_of_the_inner_encoder() -> None:
    turned = AXES.turn_about_z()
    small = 1e-6
    constants = np.zeros((4, 5))
    constants[:, 3:] = small * turned
    expected = AXES.h @ rotation(np.array([0.0, 0.0, small])).T
    np.testing.assert_allclose(AXES.installed(constants), expected, atol=1e-11)
