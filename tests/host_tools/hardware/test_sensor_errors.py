"""Terms of data sheets beyond (16), (17): power-up, temperature, bandwidth, latency, steps."""

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
from rrins.host_tools.hardware.settings import power_on
from rrins.host_tools.hardware.tables import (
    Accelerometers,
    Altimeter,
    Axis,
    GnssReceiver,
    Gyros,
    Odometer,
    Thermal,
    Turntable,
)
from rrins.host_tools.hardware.units import ARCSEC, DEG_PER_SQRT_H, DPH, UNITS, in_si, split
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


def one_sensor(tools, rate_hz=200, **keys):
    """Return a sensor along x, made as the hardware makes it."""
    gyros = Gyros(**{"range_dps": 60_000.0} | keys)
    made = tools.settings(rate_hz=rate_hz, gyro_axes_deg=((90.0, 0.0),), gyros=gyros)
    return power_on(made)[0]["gyros"].copy()


def outputs(sensor, inputs, force=NO_FORCE):
    """Return what a sensor along x makes of increments along x."""
    found = []
    for x in inputs:
        measure(sensor, np.array([x, 0.0, 0.0]), force, FINE, 1 << 60)
        found.append(sensor["counts"][0] * FINE)
    return np.array(found)


# Units


RAD, G_PER_MICRO = math.pi / 180, 9.80665e-6
IN_SI = {
    "deg": RAD, "dps": RAD, "dps2": RAD, "dps3": RAD, "arcsec": RAD / 3600,
    "deg_per_sqrt_h": RAD / math.sqrt(3600), "dph": RAD / 3600, "dph_per_k": RAD / 3600,
    "dph_per_g": RAD / 3600 / G, "dph_per_sqrt_h": RAD / 3600 / math.sqrt(3600), "g": G,
    "ug": G_PER_MICRO, "ug_per_k": G_PER_MICRO, "ug_per_sqrt_hz": G_PER_MICRO,
    "ug_per_sqrt_h": G_PER_MICRO / math.sqrt(3600), "ppm": 1e-6, "ppm_per_k": 1e-6,
    "um": 1e-6, "um_per_s": 1e-6, "mm": 1e-3, "ms": 1e-3,
    "hz": 1, "k": 1, "m": 1, "m_per_sqrt_h": 1 / math.sqrt(3600), "mps": 1, "s": 1,
}  # fmt: skip


def test_units_in_si():
    assert {name: unit.si for name, unit in UNITS.items()} == pytest.approx(IN_SI)


def test_values_of_a_table_in_si():
    values = in_si(Gyros(bias_dph=(1, 2), angle_random_walk_deg_per_sqrt_h=5, range_dps=90))
    assert values["bias"] == pytest.approx(np.array([1, 2]) * RAD / 3600)
    assert values["white_noise"] == pytest.approx(5 * RAD / 60)
    assert values["range"] == pytest.approx(math.pi / 2)
    assert values["bandwidth"] is None
    walk = in_si(Accelerometers(random_walk_ug_per_sqrt_h=6))["rate_random_walk"]
    assert walk == pytest.approx(6 * G_PER_MICRO / 60)


FITTED = {"altimeter": Altimeter(), "gnss": GnssReceiver(), "odometer": Odometer()}
KEYS = [
    *((name, key) for name, table in (
        ("gyros", Gyros()), ("accelerometers", Accelerometers()), ("thermal", Thermal()),
        ("turntable", Turntable()), *FITTED.items(),
    ) for key in type(table).model_fields if not isinstance(getattr(table, key), Axis)),
    *((axis, key) for axis in ("inner", "outer") for key in Axis.model_fields),
]  # fmt: skip


def power_on_with(tools, name, **keys):
    """Return the memory after power-on with some keys of a table, all others by default."""
    if name in ("inner", "outer"):
        name, keys = "turntable", {name: Axis(**keys)}
    base = getattr(tools.settings(**FITTED), name)
    return power_on(tools.settings(**FITTED | {name: type(base)(**keys)})).tobytes()


@pytest.mark.parametrize(("name", "key"), KEYS)
def test_no_key_is_lost_on_the_way_to_the_memory(tools, name, key):
    others = {"lever_arm_m": (1, 2, 3), "encoder_bits": 10, "rate_hz": 2, "jerk_limit_dps3": 2}
    value = others.get(key, 0.5)
    assert power_on_with(tools, name, **{key: value}) != power_on_with(tools, name)


@pytest.mark.parametrize(
    ("key", "name", "symbol"),
    [("bias_temperature_dph_per_k", "bias_temperature", "°/h/K"), ("range_g", "range", "g"),
     ("resolution_um_per_s", "resolution", "µm/s"), ("ripple_per_turn", "ripple_per_turn", "")],
)  # fmt: skip
def test_the_end_of_a_name_is_its_unit(key, name, symbol):
    found, unit = split(key)
    assert (found, unit.symbol) == (name, symbol)


def test_a_list_has_a_value_for_each_sensor(tools):
    gyros = Gyros(dead_zone_dph=(1, 2, 3, 4), g_sensitivity_dph_per_g=5)
    found = power_on(tools.settings(gyros=gyros))[0].gyros
    dph = math.pi / 180 / 3600
    expected = np.array([1, 2, 3, 4]) * dph / 200
    assert found.dead_zone_increment[:5] == pytest.approx([*expected, 0])
    assert found.g_sensitivity[:5] == pytest.approx([5 * dph / G] * 4 + [0])


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
    sensor = one_sensor(tools, rate_hz, bandwidth_hz=bandwidth_hz)
    time_s = np.arange(1, 101) / rate_hz
    angle = np.cumsum(outputs(sensor, np.full(100, rate / rate_hz)))
    constant_s = 1 / (2 * math.pi * bandwidth_hz)
    expected = rate * (time_s - constant_s * (1 - np.exp(-time_s / constant_s)))
    assert angle == pytest.approx(expected, abs=1e-10)


def test_at_its_bandwidth_a_sine_is_3_db_down_and_an_eighth_of_a_turn_late(tools):
    rate_hz, bandwidth_hz, cycles = 1000, 10, 60
    sensor = one_sensor(tools, rate_hz, bandwidth_hz=bandwidth_hz)
    phase = 2 * math.pi * bandwidth_hz / rate_hz * np.arange(cycles * rate_hz // bandwidth_hz + 1)
    passed = outputs(sensor, np.diff(1e-3 * np.sin(phase)))
    settled = slice(len(passed) // 2, None)
    response = np.sum(passed[settled] * np.exp(-1j * phase[1:][settled]))
    response /= np.sum(np.diff(1e-3 * np.sin(phase))[settled] * np.exp(-1j * phase[1:][settled]))
    assert 20 * math.log10(abs(response)) == pytest.approx(-3.01, abs=0.03)
    assert math.degrees(np.angle(response)) == pytest.approx(-45, abs=0.3)


INPUTS = st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=60)


@settings(max_examples=40)
@given(INPUTS, st.floats(0.5, 500), st.floats(0, 24))
def test_neither_bandwidth_nor_latency_loses_an_increment(tools, inputs, bandwidth_hz, latency_ms):
    sensor = one_sensor(tools, 200, bandwidth_hz=bandwidth_hz, latency_ms=latency_ms)
    settling = int(200 * 25 / (2 * math.pi * bandwidth_hz)) + 10
    passed = outputs(sensor, [*inputs, *[0.0] * settling])
    assert passed.sum() == pytest.approx(sum(inputs), abs=1e-11)


@pytest.mark.parametrize(("epochs", "shares"), [(0.25, [0.75, 0.25]), (3.0, [0, 0, 0, 1]),
                                                (2.5, [0, 0, 0.5, 0.5])])  # fmt: skip
def test_latency_counts_in_parts_of_an_epoch(tools, epochs, shares):
    sensor = one_sensor(tools, 200, latency_ms=epochs * 5)
    passed = outputs(sensor, [1e-3, 0, 0, 0, 0, 0])
    assert passed[: len(shares)] == pytest.approx(np.array(shares) * 1e-3)
    assert passed[len(shares) :] == pytest.approx(0)


# Dead zone, resolution, range


@pytest.mark.parametrize("sign", [1, -1])
def test_a_dead_zone_swallows_what_is_smaller(tools, sign):
    sensor = one_sensor(tools, 200, dead_zone_dph=0.2 / DPH, bias_dph=0.02 / DPH)
    passed = outputs(sensor, [sign * 0.00099, sign * 0.00101, sign * 0.5])
    assert passed == pytest.approx([1e-4, 1e-4 + sign * 0.00101, 1e-4 + sign * 0.5])


@settings(max_examples=40)
@given(st.lists(st.floats(-1e-4, 1e-4), min_size=1, max_size=100))
def test_a_coarse_resolution_comes_in_steps_and_loses_nothing(tools, inputs):
    step = 3e-5
    sensor = one_sensor(tools, 200, resolution_arcsec=step / ARCSEC)
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
    sensor = one_sensor(
        tools, 200, angle_random_walk_deg_per_sqrt_h=3e-6 * math.sqrt(200) / DEG_PER_SQRT_H
    )
    sensor["fault_noise_increment"][0] = 4e-6
    passed = outputs(sensor, np.zeros(6000))
    assert passed.std() == pytest.approx(5e-6, rel=4 / math.sqrt(12000))
