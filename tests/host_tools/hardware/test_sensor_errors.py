"""What data sheets add to (16), (17): power-up, temperature, force, bandwidth, latency, steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import frame_array
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.sensors import measure
from rrins.host_tools.hardware.settings import SensorErrors, SensorSet, power_on
from rrins.host_tools.runs.set_up.settings import hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

FINE = 1e-12  # a count so small that what is measured can be read from the counts
NO_FORCE = np.zeros(3)
EARTH_RATE = 7.292115e-5  # rad/s
G = 9.80665


def settings_of(**tables):
    """Return the hardware's settings for tables of a scenario on three orthogonal sensors."""
    values = {"duration_s": 1, "rate_hz": 50, "rimu": {"geometry": "orthogonal"}} | tables
    return hardware_settings(Scenario.model_validate(values))


def one_sensor(tools, rate_hz=200, common=None, **errors):
    """Return a sensor along x, made as the hardware makes it."""
    sensors = SensorSet(
        axes=((math.pi / 2, 0.0),),
        errors=(SensorErrors(**errors),),
        measuring_range=1e3,
        **common or {},
    )
    made = power_on(tools.settings(rate_hz=rate_hz, gyros=sensors))
    return made[0]["gyros"].copy()


def outputs(sensor, inputs, force=NO_FORCE):
    """Return what a sensor along x makes of increments along x."""
    found = []
    for x in inputs:
        measure(sensor, np.array([x, 0.0, 0.0]), force, FINE, 1 << 60)
        found.append(sensor["counts"][0] * FINE)
    return np.array(found)


# Units


def test_every_key_of_the_gyros_reaches_the_hardware_in_si():
    keys = {
        "bias_dph": 1, "bias_repeatability_dph": 2, "bias_instability_dph": 3,
        "bias_temperature_dph_per_k": 4, "angle_random_walk_deg_per_sqrt_h": 5,
        "rate_random_walk_dph_per_sqrt_h": 6, "g_sensitivity_dph_per_g": 7, "dead_zone_dph": 8,
        "scale_error_ppm": 9, "asymmetric_scale_error_ppm": 10, "installation_u_arcsec": 11,
        "installation_v_arcsec": 12, "scale_repeatability_ppm": 13,
        "scale_temperature_ppm_per_k": 14,
    }  # fmt: skip
    gyros = settings_of(
        gyros=keys | {"resolution_arcsec": 2, "range_dps": 90, "bandwidth_hz": 7, "latency_ms": 3}
    ).gyros
    dph, arcsec = math.pi / 180 / 3600, math.pi / 180 / 3600
    expected = {
        "bias": 1 * dph, "bias_repeatability": 2 * dph, "bias_instability": 3 * dph,
        "temperature_bias": 4 * dph, "white_noise": 5 * math.pi / 180 / math.sqrt(3600),
        "rate_random_walk": 6 * dph / math.sqrt(3600), "force_coefficient": 7 * dph / G,
        "dead_zone": 8 * dph, "scale_error": 9e-6, "asymmetric_scale_error": 10e-6,
        "delta_u": 11 * arcsec, "delta_v": 12 * arcsec, "scale_repeatability": 13e-6,
        "temperature_scale": 14e-6, "position_x": 0, "position_y": 0, "position_z": 0,
    }  # fmt: skip
    for errors in gyros.errors:
        assert vars(errors) == pytest.approx(expected)
    assert gyros.resolution == pytest.approx(2 * arcsec)
    assert gyros.measuring_range == pytest.approx(math.pi / 2)
    assert (gyros.bandwidth_hz, gyros.latency_s) == (7, pytest.approx(0.003))


def test_every_key_of_the_accelerometers_reaches_the_hardware_in_si():
    keys = {
        "bias_ug": 1, "bias_repeatability_ug": 2, "bias_instability_ug": 3,
        "bias_temperature_ug_per_k": 4, "white_noise_ug_per_sqrt_hz": 5,
        "random_walk_ug_per_sqrt_h": 6, "dead_zone_ug": 8,
        "position_x_mm": 10, "position_y_mm": -20, "position_z_mm": 30,
    }  # fmt: skip
    made = settings_of(accelerometers=keys | {"resolution_um_per_s": 3, "range_g": 5})
    ug = 9.80665e-6
    expected = {
        "bias": 1 * ug, "bias_repeatability": 2 * ug, "bias_instability": 3 * ug,
        "temperature_bias": 4 * ug, "white_noise": 5 * ug, "rate_random_walk": 6 * ug / 60,
        "dead_zone": 8 * ug, "position_x": 0.01, "position_y": -0.02, "position_z": 0.03,
    }  # fmt: skip
    for errors in made.accelerometers.errors:
        values = {key: value for key, value in vars(errors).items() if value}
        assert values == pytest.approx(expected)
    assert made.accelerometers.resolution == pytest.approx(3e-6)
    assert made.accelerometers.measuring_range == pytest.approx(5 * G)


# Power-up

POWER_UPS = 600


@pytest.fixture(scope="module")
def powered_up():
    """Return the constants of many power-ups, shape (n, 3) each, in °/h, µg, ppm."""
    made = settings_of(
        gyros={
            "bias_dph": 5,
            "bias_repeatability_dph": [0.1, 2, 0],
            "scale_repeatability_ppm": 20,
        },
        accelerometers={"bias_repeatability_ug": 40, "scale_repeatability_ppm": [0, 10, 10]},
    )
    dt = 1 / 50
    units = {
        ("gyros", "bias_increment"): math.radians(1) / 3600 * dt,
        ("accelerometers", "bias_increment"): 9.80665e-6 * dt,
        ("gyros", "scale_error"): 1e-6,
        ("accelerometers", "scale_error"): 1e-6,
    }
    drawn = {key: np.zeros((POWER_UPS, 3)) for key in units}
    for seed in range(POWER_UPS):
        plant = power_on(replace(made, seed=seed))[0]
        for (kind, name), unit in units.items():
            drawn[kind, name][seed] = plant[kind][name][:3] / unit
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name", "mean", "deviations"),
    [
        ("gyros", "bias_increment", 5, [0.1, 2, 0]),
        ("gyros", "scale_error", 0, [20, 20, 20]),
        ("accelerometers", "bias_increment", 0, [40, 40, 40]),
        ("accelerometers", "scale_error", 0, [0, 10, 10]),
    ],
)
def test_each_power_up_draws_its_constants(powered_up, kind, name, mean, deviations):
    drawn = powered_up[kind, name]
    for k, deviation in enumerate(deviations):
        assert drawn[:, k].std() == pytest.approx(deviation, rel=4 / math.sqrt(2 * POWER_UPS))
        bound = 4 * deviation / math.sqrt(POWER_UPS) + 1e-9
        assert drawn[:, k].mean() == pytest.approx(mean, abs=bound)


def test_power_ups_of_different_sensors_have_nothing_in_common(powered_up):
    columns = [column for drawn in powered_up.values() for column in drawn.T if column.std() > 1e-9]
    correlations = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlations).max() < 5 / math.sqrt(POWER_UPS)


# Temperature


def test_sensors_warm_up_exponentially():
    made = settings_of(
        thermal={"ambient_offset_k": -10, "warm_up_k": 25, "time_constant_s": 100},
        gyros={"bias_dph": 3, "bias_temperature_dph_per_k": [0.5, 0, -1]},
        accelerometers={"scale_temperature_ppm_per_k": 2, "bias_temperature_ug_per_k": 4},
    )
    hardware = Hardware(made)
    plant, inbox = hardware.plant[0], frame_array(1)
    gravity = float(np.linalg.norm(plant["specific_force_b"]))
    for second in range(301):
        counted = np.zeros(2)
        for _ in range(50):
            hardware.step(inbox, 0)
            counted += plant["gyros"]["counts"][0], plant["accelerometers"]["counts"][2]
        if second % 60:
            continue
        warmer = -10 + 25 * (1 - math.exp(-second / 100))
        bias_dph = math.degrees(counted[0] * 4e-9) * 3600
        assert bias_dph == pytest.approx(3 + 0.5 * warmer, abs=0.002)  # half a count a second
        force = counted[1] * 1.25e-7
        expected = gravity * (1 + 2e-6 * warmer) + 4 * 9.80665e-6 * warmer
        assert force == pytest.approx(expected, abs=1.3e-7)


# Force


def test_g_sensitivity_is_a_bias_for_each_g_along_the_axis():
    # At rest, level: one g (nearly) along z of the body, none along x and y.
    made = settings_of(gyros={"g_sensitivity_dph_per_g": [9, 9, 9]})
    hardware = Hardware(made)
    plant, inbox = hardware.plant[0], frame_array(1)
    total = np.zeros(3)
    for _ in range(50 * 20):
        hardware.step(inbox, 0)
        total += plant["gyros"]["counts"][:3]
    rate_dph = np.degrees(total * 4e-9) / 20 * 3600
    latitude = math.radians(40.3554)
    earth_dph = math.degrees(EARTH_RATE) * 3600
    expected = [0, earth_dph * math.cos(latitude), earth_dph * math.sin(latitude)]
    expected[2] += 9 * plant["specific_force_b"][2] / G
    assert rate_dph == pytest.approx(expected, abs=1e-3)


# Bandwidth and latency


def test_a_step_follows_the_first_order_response(tools):
    rate_hz, bandwidth_hz, rate = 200, 8.0, 0.3
    sensor = one_sensor(tools, rate_hz, {"bandwidth_hz": bandwidth_hz})
    time_s = np.arange(1, 101) / rate_hz
    angle = np.cumsum(outputs(sensor, np.full(100, rate / rate_hz)))
    constant_s = 1 / (2 * math.pi * bandwidth_hz)
    expected = rate * (time_s - constant_s * (1 - np.exp(-time_s / constant_s)))
    assert angle == pytest.approx(expected, abs=1e-10)


def test_at_its_bandwidth_a_sine_is_3_db_down_and_an_eighth_of_a_turn_late(tools):
    rate_hz, bandwidth_hz, cycles = 1000, 10, 60
    sensor = one_sensor(tools, rate_hz, {"bandwidth_hz": bandwidth_hz})
    phase = 2 * math.pi * bandwidth_hz / rate_hz * np.arange(cycles * rate_hz // bandwidth_hz + 1)
    passed = outputs(sensor, np.diff(1e-3 * np.sin(phase)))
    settled = slice(len(passed) // 2, None)
    response = np.sum(passed[settled] * np.exp(-1j * phase[1:][settled]))
    response /= np.sum(np.diff(1e-3 * np.sin(phase))[settled] * np.exp(-1j * phase[1:][settled]))
    assert 20 * math.log10(abs(response)) == pytest.approx(-3.01, abs=0.03)
    assert math.degrees(np.angle(response)) == pytest.approx(-45, abs=0.3)


INPUTS = st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=60)


@settings(max_examples=40)
@given(INPUTS, st.floats(0.5, 500), st.floats(0, 0.024))
def test_neither_bandwidth_nor_latency_loses_an_increment(tools, inputs, bandwidth_hz, latency_s):
    sensor = one_sensor(tools, 200, {"bandwidth_hz": bandwidth_hz, "latency_s": latency_s})
    settling = int(200 * 25 / (2 * math.pi * bandwidth_hz)) + 10
    passed = outputs(sensor, [*inputs, *[0.0] * settling])
    assert passed.sum() == pytest.approx(sum(inputs), abs=1e-11)


@pytest.mark.parametrize(("epochs", "shares"), [(0.25, [0.75, 0.25]), (3.0, [0, 0, 0, 1]),
                                                (2.5, [0, 0, 0.5, 0.5])])  # fmt: skip
def test_latency_counts_in_parts_of_an_epoch(tools, epochs, shares):
    sensor = one_sensor(tools, 200, {"latency_s": epochs / 200})
    passed = outputs(sensor, [1e-3, 0, 0, 0, 0, 0])
    assert passed[: len(shares)] == pytest.approx(np.array(shares) * 1e-3)
    assert passed[len(shares) :] == pytest.approx(0)


# Dead zone, resolution, range


@pytest.mark.parametrize("sign", [1, -1])
def test_a_dead_zone_swallows_what_is_smaller(tools, sign):
    sensor = one_sensor(tools, 200, dead_zone=0.2, bias=0.02)
    passed = outputs(sensor, [sign * 0.00099, sign * 0.00101, sign * 0.5])
    assert passed == pytest.approx([1e-4, 1e-4 + sign * 0.00101, 1e-4 + sign * 0.5])


@settings(max_examples=40)
@given(st.lists(st.floats(-1e-4, 1e-4), min_size=1, max_size=100))
def test_a_coarse_resolution_comes_in_steps_and_loses_nothing(tools, inputs):
    step = 3e-5
    sensor = one_sensor(tools, 200, {"resolution": step})
    passed = outputs(sensor, inputs)
    assert passed / step == pytest.approx(np.rint(passed / step), abs=1e-6)
    assert np.abs(np.cumsum(passed) - np.cumsum(inputs)).max() <= step / 2 * (1 + 1e-6)


def test_a_stuck_sensor_repeats_itself_and_goes_on_where_it_would_be(tools):
    sensor = one_sensor(tools)
    outputs(sensor, [1e-3])
    sensor["stuck"] = 1
    assert outputs(sensor, [2e-3, 3e-3]) == pytest.approx([1e-3, 1e-3])
    sensor["stuck"] = 0
    assert outputs(sensor, [4e-3]) == pytest.approx([4e-3])


def test_noise_of_a_fault_adds_to_the_sensors_own_as_variances(tools):
    sensor = one_sensor(tools, 200, white_noise=3e-6 * math.sqrt(200))
    sensor["fault_noise_increment"][0] = 4e-6
    passed = outputs(sensor, np.zeros(6000))
    assert passed.std() == pytest.approx(5e-6, rel=4 / math.sqrt(12000))
