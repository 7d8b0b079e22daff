"""Disturbances of a calibration are found in its residuals, and told apart."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, UG
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.checks import trouble_of
from rrins.host_tools.calibration.estimation import estimate
from rrins.host_tools.calibration.model import inputs, rotation
from rrins.host_tools.calibration.monte_carlo import errors_of
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


def step(seconds: Seconds, size: float, sensor: int, at_s: float = 860.0) -> np.ndarray:
    added = np.zeros_like(seconds.gyro)
    added[np.cumsum(seconds.duration_s) > at_s, sensor] = size
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


def said_s(found: str | None) -> float:
    """Return the time that words give."""
    assert found is not None
    return float(re.findall(r"(\d+) s\b", found)[0])


@pytest.mark.parametrize(
    "at_s", [900.0, *(pytest.param(one, marks=pytest.mark.soak) for one in (300.0, 1400.0))]
)
def test_a_change_is_told_at_its_time(sound: Seconds, at_s: float) -> None:
    for size in (5 * DPH, 0.3 * DPH):
        found = words(changed(sound, gyro=step(sound, size, 2, at_s)))
        assert found is not None
        assert found.startswith("gyro 3")
        assert said_s(found) == pytest.approx(at_s, abs=60)


def test_a_base_on_waves_moves(sound: Seconds) -> None:
    """Waves of 1 cm in 8 s, in the surge and sway of the vehicle."""
    ends = np.cumsum(sound.duration_s)
    speed = 0.01 * 2 * np.pi / 8 * np.sin(2 * np.pi * ends / 8)
    surge = np.diff(speed, prepend=0.0)[:, None] * UNIT.accelerometers.h[:, 0]
    found = words(changed(sound, accelerometer=surge))
    assert found is not None
    assert found.startswith("the base moves: the accelerometers scatter")
    loud = np.zeros_like(sound.accelerometer)
    loud[:, 1] = np.random.default_rng(1).normal(0, 100 * UG, len(sound))
    found = words(changed(sound, accelerometer=loud))
    assert found is not None
    assert found.startswith("accelerometer 2 scatters")


def test_a_base_that_tilts_is_not_a_sensors_fault(sound: Seconds) -> None:
    upright = inputs(sound, UNIT.site, UNIT.C_b_n, 0.0)[1].x
    tilted = inputs(sound, UNIT.site, UNIT.C_b_n @ rotation(np.array([60 * ARCSEC, 0, 0])), 0.0)
    added = (tilted[1].x - upright) @ UNIT.accelerometers.h.T
    added[: len(sound) // 2] = 0.0
    found = words(changed(sound, accelerometer=added))
    assert found is not None
    assert found.startswith("the base tilted")
    assert said_s(found) == pytest.approx(865, abs=30)


def test_sensors_that_warm_up_have_not_settled(sound: Seconds) -> None:
    ramp = np.linspace(0.0, 500 * UG, len(sound)) * sound.duration_s
    found = words(changed(sound, accelerometer=ramp[:, None] * np.array([1.0, 0.8, 0.9, -1.1])))
    assert found is not None
    assert "temperature has not settled" in found


def test_too_little_time_is_told(sound: Seconds) -> None:
    found = words(sound.where(slice(0, 400)))
    assert found is not None
    assert found.startswith("too little time")


@pytest.mark.parametrize("per_turn", [1.0, pytest.param(2.0, marks=pytest.mark.soak)])
def test_a_wobble_that_the_table_is_known_for_is_found(per_turn: float) -> None:
    """Once a turn it is a turn of all sensors, and the installation is known no better."""
    table = {"turntable__wobble_arcsec": 5.0, "turntable__wobble_per_turn": per_turn}
    scenario = drawn_unit(4).varied(**table)
    unit, seconds = unit_of(scenario), record(scenario, Scheme(turns=SCHEMES["calibration"]))
    found = estimate(unit, seconds)
    assert trouble_of(unit, found) is None
    for errors in errors_of(scenario, found):
        assert np.mean((errors.error / errors.sigma) ** 2) < 2.0
    installation = found.accelerometers.sigma[:, 3:] / ARCSEC
    assert (installation.max() > 1.0) == (per_turn == 1.0)
    if per_turn != 1.0:
        stranger = dataclasses.replace(unit, wobble=(0.0, 1.0))
        told = trouble_of(stranger, estimate(stranger, seconds))
        assert told is not None
        assert told.startswith("the inner axis wobbles by 5")
        assert "2 times a turn" in told


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


TABLE_2 = {
    "gyros__bias_instability_dph": (0.0502, 0.0303, 0.0355, 0.0517),
    "accelerometers__bias_instability_ug": (12.4, 8.3, 27.7, 11.7),
}
WARM = {"gyros__bias_temperature_dph_per_k": 0.01, "accelerometers__bias_temperature_ug_per_k": 3.0}
BY_FORCE = {"gyros__g_sensitivity_dph_per_g": 0.5}
ERRORS = {
    "white": {},
    "instability": TABLE_2,
    "instability unknown": TABLE_2,
    "warm-up": WARM | {"thermal__warm_up_k": 10.0},
    "wobble 2": {"turntable__wobble_arcsec": 2.0},
    "wobble 5": {"turntable__wobble_arcsec": 5.0},
    "g": BY_FORCE,
    "g and wobble": BY_FORCE | {"turntable__wobble_arcsec": 2.0},
}


@pytest.mark.soak
@pytest.mark.parametrize("name", ERRORS)
def test_sigma_is_honest_or_the_calibration_refused(name: str) -> None:
    squares, scheme = [], Scheme(turns=SCHEMES["calibration"])
    for seed in range(1, 21):
        scenario = drawn_unit(seed).varied(**ERRORS[name])
        unit = unit_of(scenario)
        if "unknown" in name:
            unit = dataclasses.replace(unit, sheets=None)
        found = estimate(unit, record(scenario, scheme))
        trouble = trouble_of(unit, found)
        if name == "warm-up":
            assert trouble is not None
            assert "temperature has not settled" in trouble
            continue
        assert trouble is None
        for errors in errors_of(scenario, found):
            squares += list(((errors.error / errors.sigma) ** 2).ravel())
    assert not squares or 0.7 < np.mean(squares) < (2.0 if "unknown" in name else 1.4)
