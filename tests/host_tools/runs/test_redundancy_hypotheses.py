"""Beyond one faulty sensor: two, all alike, a crooked table. No sound sensor is left out."""

from __future__ import annotations

import math
import os

import pytest

import rrins

SEEDS = range(int(os.environ.get("RRINS_SEEDS", "1")))
NOISE = {
    "gyros": {"angle_random_walk_deg_per_sqrt_h": 0.005, "bias_dph": 0.0},
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 10, "bias_ug": 0.0},
}
UNCALIBRATED = {"gyros": {"bias_dph": [3, -4, 2, 5]}, "accelerometers": {"bias_ug": 500}}
AIDED = {"scenario": "drive_rotating", "gnss": {}, "estimator": {"enabled": True}}
SIX = {"rimu": {"geometry": "dodecahedron"}}


def off(sensors, *sizes, kind="gyro", at_s=203):
    """Return faults of some sensors at once."""
    unit = {"gyro": "bias_dph", "accelerometer": "bias_ug"}[kind]
    return [
        {"kind": f"{kind}_bias", "sensor": sensor, unit: size, "at_s": at_s}
        for sensor, size in zip(sensors, sizes, strict=True)
    ]


def simulate(faults=(), scenario="rimu_rotating", **changes):
    noise = {kind: keys | changes.pop(kind, {}) for kind, keys in NOISE.items()}
    changes = {"duration_s": 400, "redundancy": {"enabled": True}} | noise | changes
    return rrins.simulate(scenario, faults=list(faults), **changes).summary


def left_out(summary, kind="gyros"):
    return summary["redundancy"][kind]["excluded"] or []


def worst_m(summary):
    error = summary["max_abs_position_error_m"]
    return math.hypot(error["east"], error["north"])


@pytest.mark.parametrize(
    "scenario",
    [pytest.param("rimu_rotating", marks=pytest.mark.soak), "rimu_rotating_aligned"],
)
def test_a_crooked_table_makes_no_sound_gyro_fail(scenario):
    axis = {"encoder_bits": 16}
    table = {"non_orthogonality_arcsec": 25, "wobble_arcsec": 10, "inner": axis, "outer": axis}
    for seed in SEEDS:
        run = {"scenario": scenario, "turntable": table, "seed": seed, "duration_s": 2500}
        for kind in simulate(**run)["redundancy"].values():
            assert (kind["excluded"], kind["alarm_s"]) == (None, None)
        sensor = seed % 4 + 1
        found = simulate(off([sensor], 1.0, at_s=1903), **run)
        assert left_out(found) == [sensor]


def test_that_it_stands_is_known_of_a_unit_whose_biases_have_made_it_fast():
    for seed in SEEDS:
        run = UNCALIBRATED | {"seed": seed, "duration_s": 2100}
        healthy = simulate(**run)
        assert max(healthy["max_abs_velocity_error_mps"].values()) > 3
        assert all(kind["alarm_s"] is None for kind in healthy["redundancy"].values())
        sensor = (seed + 1) % 4 + 1
        found = simulate(off([sensor], 50, at_s=1803), **run)
        assert left_out(found) == [sensor]
        assert worst_m(found) < 1.5 * worst_m(healthy)


@pytest.mark.parametrize("dph", [(20, 12), (10, 10)])
def test_of_two_gyros_at_once_no_third_is_blamed_by_a_reference(dph):
    for seed in SEEDS:
        gyros = simulate(off([2, 3], *dph), seed=seed, **AIDED)["redundancy"]["gyros"]
        assert gyros["excluded"] in (None, [2], [3])
        assert gyros["alarm_s"] < 202


@pytest.mark.parametrize("dph", [(20, -20), (20, 20)])
def test_two_gyros_at_once_are_an_alarm_at_standstill(dph):
    """The first two cancel in the parity; they look like a motion that the table turns with."""
    for seed in SEEDS:
        gyros = simulate(off([2, 3], *dph), seed=seed)["redundancy"]["gyros"]
        assert gyros["excluded"] is None
        assert 199 < gyros["unresolved_s"] < 225


@pytest.mark.parametrize(("kind", "size"), [("gyro", 50), ("accelerometer", 2000)])
def test_where_all_sensors_are_off_alike_none_is_left_out(kind, size):
    """Of a tetrahedron, they cancel each other in what is navigated."""
    for seed in SEEDS:
        healthy = simulate(seed=seed, **AIDED)
        found = simulate(off((1, 2, 3, 4), *[size] * 4, kind=kind), seed=seed, **AIDED)
        assert left_out(found, kind + "s") == []
        assert found["redundancy"][kind + "s"]["unresolved_s"] is not None
        assert worst_m(found) < 1.5 * worst_m(healthy)


def test_a_fault_of_all_that_passes_leaves_none_out():
    """The filter has taken it for biases; when it ends, these are off as if one had failed."""
    faults = [fault | {"for_s": 32} for fault in off((1, 2, 3, 4), *[16.4] * 4)]
    rimu, gnss = {"geometry": "orthogonal-plus-one"}, {"position_noise_m": 1.5}
    for seed in SEEDS:
        found = simulate(faults, seed=seed, rimu=rimu, gnss=gnss, estimator={"enabled": True})
        assert left_out(found) == []
        assert found["redundancy"]["gyros"]["unresolved_s"] is not None


@pytest.mark.parametrize(
    ("scenario", "dph", "how"),
    [
        ("rimu_rotating", (20, -20), "standing"),
        ("drive_rotating", (100, 60), "parity"),
        ("drive_rotating", (30, -12), "parity"),
    ],
)
def test_of_six_gyros_two_at_once_are_both_left_out(scenario, dph, how):
    for seed in SEEDS:
        run = {"scenario": scenario, "seed": seed} | SIX
        found = simulate(off([2, 5], *dph), **run)
        gyros = found["redundancy"]["gyros"]
        assert (gyros["excluded"], gyros["how"], gyros["redundancy_left"]) == ([2, 5], how, True)
        assert worst_m(found) < 3 * worst_m(simulate(**run))  # four have more noise than six


def test_of_six_gyros_the_smaller_of_two_is_found_after_the_larger():
    """What was learned of all six is known of the five that are left."""
    found = simulate(off([2, 5], 100, 1), scenario="drive_rotating", **SIX)
    assert left_out(found) == [2, 5]
