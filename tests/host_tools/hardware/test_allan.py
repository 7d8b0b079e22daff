"""Noise of data sheets, from scenario to counts, by its Allan deviation (allantools)."""

from __future__ import annotations

import math

import allantools
import numpy as np
import pytest
from numba import njit

from rrins.host_tools.hardware.sensors import drift, measure
from rrins.host_tools.hardware.settings import power_on
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

RATE_HZ = 50
RUN_S = 150_000
WHITE, INSTABILITY, WALK = 0, 1, 2  # the sensor that has it, and nothing else
ARW, B_DPH, RRW = 0.01, 0.05, 0.3  # °/√h, °/h, °/h/√h
VRW, B_UG, K_UG = 20.0, 30.0, 100.0  # µg/√Hz, µg, µg/√h
UNIT = {"gyros": 4e-9, "accelerometers": 1.25e-7}  # rad, m/s of a count
SHORTEST_S, RATIO, POLES = 2.0, 8.0, 6  # what the bias instability is made of


@njit
def record(sensors, rate_hz, seconds, unit, phase):
    """Log the sum of the counts of each sensor every second."""
    nothing = np.zeros(3)
    kind = sensors[0]
    total = np.zeros(kind.count, dtype=np.int64)
    for second in range(seconds):
        drift(kind, 0.0)
        for _ in range(rate_hz):
            measure(kind, nothing, nothing, unit, 1 << 23)
            for k in range(kind.count):
                total[k] += kind.counts[k]
        for k in range(kind.count):
            phase[k, second + 1] = total[k]


@pytest.fixture(scope="module")
def phases():
    """Return what the three sensors of each kind add up to: degrees, and m/s over g in µg s."""
    scenario = Scenario.model_validate(
        {
            "duration_s": 1,
            "rate_hz": RATE_HZ,
            "rimu": {"geometry": "orthogonal"},
            "gyros": {
                "angle_random_walk_deg_per_sqrt_h": [ARW, 0, 0],
                "bias_instability_dph": [0, B_DPH, 0],
                "rate_random_walk_dph_per_sqrt_h": [0, 0, RRW],
            },
            "accelerometers": {
                "white_noise_ug_per_sqrt_hz": [VRW, 0, 0],
                "bias_instability_ug": [0, B_UG, 0],
                "random_walk_ug_per_sqrt_h": [0, 0, K_UG],
            },
        }
    )
    plant = power_on(hardware_settings(scenario))
    logged = {}
    for kind, unit in UNIT.items():
        phase = np.zeros((3, RUN_S + 1))
        record(plant[kind], RATE_HZ, RUN_S, unit, phase)
        logged[kind] = phase * unit
    logged["gyros"] = np.degrees(logged["gyros"])
    logged["accelerometers"] /= 9.80665e-6
    return logged


def deviation(phase, per_unit_of_time, taus_s):
    """Return the Allan deviations at `taus_s`, with `per_unit_of_time` seconds to the unit."""
    taus = np.asarray(taus_s) / per_unit_of_time
    found, deviations, _, _ = allantools.oadev(
        phase, rate=per_unit_of_time, data_type="phase", taus=taus
    )
    assert found == pytest.approx(taus)
    return taus, deviations


def spread(tau_s):
    """Return four relative standard deviations of an Allan deviation of this run."""
    return 4 / math.sqrt(2 * (RUN_S / tau_s - 1))


TAUS_S = [2, 8, 32, 128, 512, 1024]
HOUR, SECOND = 3600, 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "coefficient", "unit_s"), [("gyros", ARW, HOUR), ("accelerometers", VRW, SECOND)]
)
def test_white_noise_falls_with_the_root_of_time(phases, kind, coefficient, unit_s):
    taus, deviations = deviation(phases[kind][WHITE], unit_s, TAUS_S)
    for tau_s, tau, found in zip(TAUS_S, taus, deviations, strict=True):
        assert found == pytest.approx(coefficient / math.sqrt(tau), rel=spread(tau_s))
    slope = np.polyfit(np.log(taus), np.log(deviations), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "coefficient"), [("gyros", RRW), ("accelerometers", K_UG)])
def test_rate_random_walk_grows_with_the_root_of_time(phases, kind, coefficient):
    taus_s = [64, 128, 256, 512, 1024, 2048]  # the walk's steps are of a second
    _, deviations = deviation(phases[kind][WALK], HOUR if kind == "gyros" else SECOND, taus_s)
    hours = np.array(taus_s) / 3600
    for tau_s, tau_h, found in zip(taus_s, hours, deviations, strict=True):
        assert found == pytest.approx(coefficient * math.sqrt(tau_h / 3), rel=spread(tau_s))
    slope = np.polyfit(np.log(hours), np.log(deviations), 1)[0]
    assert slope == pytest.approx(0.5, abs=0.1)


def gauss_markov_deviation(coefficient, tau_s):
    """Return the Allan deviation of the processes whose sum stands for 1/f noise, in closed form.

    Of one with variance s² and time constant T (IEEE Std 952, annex C): the bracket below. Above
    `POLES` time constants it falls off, so the floor is compared well within.
    """
    total = 0.0
    for T in SHORTEST_S * RATIO ** np.arange(POLES):
        x = tau_s / T
        bracket = 1 - (3 - 4 * math.exp(-x) + math.exp(-2 * x)) / (2 * x)
        total += coefficient**2 * math.log(RATIO) / math.pi * 2 / x * bracket
    return math.sqrt(total)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "coefficient"), [("gyros", B_DPH), ("accelerometers", B_UG)])
def test_bias_instability_has_its_floor(phases, kind, coefficient):
    taus_s = [16, 64, 256, 1024, 2048]
    _, deviations = deviation(
        phases[kind][INSTABILITY], HOUR if kind == "gyros" else SECOND, taus_s
    )
    for tau_s, found in zip(taus_s, deviations, strict=True):
        assert gauss_markov_deviation(coefficient, tau_s) == pytest.approx(
            0.664 * coefficient, rel=0.08
        )
        # Frequencies near 1/τ carry it, so it is as well known as white noise.
        assert found == pytest.approx(0.664 * coefficient, rel=0.08 + spread(tau_s))


def test_what_has_no_noise_stays_at_zero():
    scenario = Scenario.model_validate({"duration_s": 1, "rate_hz": RATE_HZ})
    plant = power_on(hardware_settings(scenario))
    phase = np.zeros((4, 101))
    for kind, unit in UNIT.items():
        record(plant[kind], RATE_HZ, 100, unit, phase)
        assert not phase.any()
