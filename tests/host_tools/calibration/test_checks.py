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
from rrins.host_tools.scenario.scenario import parse
from rrins.host_tools.scenario.schemes import SCHEMES

SCENARIO = drawn_unit(3)
UNIT = unit_of(SCENARIO)
SITE = {"latitude_deg": 40.0, "longitude_deg": 116.0, "height_m": 40.0}


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


def with_scale(seconds: Seconds, ppm: float, sensor: int) -> Seconds:
    """Return the seconds with a gyro whose scale factor changes half-way."""
    along = inputs(seconds, UNIT.site, UNIT.C_b_n, 0.0)[0].x @ UNIT.gyros.h[sensor]
    added = np.zeros_like(seconds.gyro)
    added[len(seconds) // 2 :, sensor] = 1e-6 * ppm * along[len(seconds) // 2 :]
    return changed(seconds, gyro=added)


def test_a_sensor_that_is_not_constant_is_named(sound: Seconds) -> None:
    """Each of these leaves constants that are off by 9 to 70 σ."""
    drift = np.zeros_like(sound.accelerometer)
    drift[:, 2] = 2 * UG / 60 * np.cumsum(sound.duration_s) * sound.duration_s
    for spoilt, sensor in (
        (changed(sound, gyro=step(sound, 0.2 * DPH, 1)), "gyro 2"),
        (changed(sound, accelerometer=step(sound, 20 * UG, 0)), "accelerometer 1"),
        (with_scale(sound, 200, 3), "gyro 4"),
        (changed(sound, accelerometer=drift), "accelerometer 3"),
    ):
        found = words(spoilt)
        assert found is not None
        assert found.startswith(f"{sensor} was not constant")
    assert words(sound) is None


@pytest.mark.soak
@pytest.mark.parametrize("sensors", ["navigation", "prototype", "drawn", "drawn, no noise"])
def test_no_sound_calibration_is_refused(sensors: str) -> None:
    for seed in range(1, 21):
        scenario = drawn_unit(seed, noise=0.0 if "no noise" in sensors else 1.0)
        if "drawn" not in sensors:
            table = {"title": sensors, "sensors": sensors, "seed": seed, "duration_s": 9000}
            scenario = parse(table | {"rimu": {"geometry": "tetrahedron"}, "site": SITE}, sensors)
        unit = unit_of(scenario)
        seconds = record(scenario, Scheme(turns=SCHEMES["calibration"]))
        assert trouble_of(unit, estimate(unit, seconds)) is None
