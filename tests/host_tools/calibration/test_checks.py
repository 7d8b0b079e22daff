"""Disturbances of a calibration are found in its residuals, and told apart."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, UG
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.checks import trouble_of
from rrins.host_tools.calibration.estimation import estimate
from rrins.host_tools.calibration.model import inputs, rotation
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import drawn_unit, unit_of
from rrins.host_tools.scenario.schemes import SCHEMES

SCENARIO = drawn_unit(3)
UNIT = unit_of(SCENARIO)


@pytest.fixture(scope="module")
def sound() -> Seconds:
    """A calibration with the prototype's noise."""
    return record(SCENARIO, Scheme(turns=SCHEMES["calibration"]))


def changed(seconds: Seconds, **more: np.ndarray) -> Seconds:
    sums = {name: getattr(seconds, name) + added for name, added in more.items()}
    return Seconds(**{**vars(seconds), **sums})


def step(seconds: Seconds, size: float, sensor: int) -> np.ndarray:
    added = np.zeros_like(seconds.gyro)
    added[len(seconds) // 2 :, sensor] = size
    return added * seconds.duration_s[:, None]


def words(seconds: Seconds) -> str | None:
    return trouble_of(UNIT, estimate(UNIT, seconds))


def test_a_sound_calibration_has_no_trouble(sound: Seconds) -> None:
    assert words(sound) is None


def test_a_bias_that_changes_is_that_sensors(sound: Seconds) -> None:
    found = words(changed(sound, accelerometer=step(sound, 300 * UG, 2)))
    assert found is not None
    assert found.startswith("accelerometer 3 changed")
    found = words(changed(sound, gyro=step(sound, 4 * DPH, 0)))
    assert found is not None
    assert found.startswith("gyro 1 changed")


def test_a_base_that_tilts_is_not_a_sensors_fault(sound: Seconds) -> None:
    upright = inputs(sound, UNIT.site, UNIT.C_b_n, 0.0)[1].x
    tilted = inputs(sound, UNIT.site, UNIT.C_b_n @ rotation(np.array([60 * ARCSEC, 0, 0])), 0.0)
    added = (tilted[1].x - upright) @ UNIT.accelerometers.h.T
    added[: len(sound) // 2] = 0.0
    found = words(changed(sound, accelerometer=added))
    assert found is not None
    assert found.startswith("the base tilted")


def test_sensors_that_warm_up_have_not_settled(sound: Seconds) -> None:
    ramp = np.linspace(0.0, 500 * UG, len(sound)) * sound.duration_s
    found = words(changed(sound, accelerometer=ramp[:, None] * np.array([1.0, 0.8, 0.9, -1.1])))
    assert found is not None
    assert "temperature has not settled" in found


def test_too_little_time_is_told(sound: Seconds) -> None:
    found = words(sound.where(slice(0, 400)))
    assert found is not None
    assert found.startswith("too little time")
