"""Sensors that fail while GNSS or odometer aid, or in an outage: error and sigma go together.

`RRINS_FAULT_RUNS=60 pytest -s -m soak tests/host_tools/runs/test_estimator_faults.py` draws faults.
"""

from __future__ import annotations

import math
import os

import numpy as np
import pytest

import rrins
from rrins.firmware_py.core.maths.earth import SEMI_MAJOR_AXIS
from rrins.firmware_py.core.records.estimator_records import LATITUDE, LONGITUDE, Aid
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings

RUNS = int(os.environ.get("RRINS_FAULT_RUNS", "24"))
SENSORS = {
    "gyros": {"bias_dph": [0.1, 0.11, 0.12, 0.13], "angle_random_walk_deg_per_sqrt_h": 0.005},
    "accelerometers": {"bias_ug": [50, 55, 60, 65], "white_noise_ug_per_sqrt_hz": 10},
}
DRIVE = {"motion": {"kind": "drive", "duration_s": 900}, "firmware": {"height_channel": "free"}}
SWAY = {"motion": {"kind": "sway"}, "firmware": {"height_channel": "held"}}
AIDED = {"gnss": {}, "estimator": {"enabled": True}, "altimeter": None, **SENSORS}
VEHICLES = {
    "car": ("drive_rotating", AIDED | DRIVE),
    "car with odometer": ("drive_rotating", AIDED | DRIVE | {"odometer": {}}),
    "car in an outage": ("drive_rotating", AIDED | DRIVE),
    "ship": ("rimu_rotating", AIDED | SWAY),
}


def run_of(name, seed, **changes):
    """Return each second's level error (m), the larger component over its sigma; the estimator."""
    scenario = rrins.load_scenario(name, seed=seed, **changes)
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario), scenario.rate_hz)
    estimator, errors, over_sigma, sigma = run.ram[0].estimator, [], [], np.full(2, np.inf)
    for _ in range(scenario.epochs // scenario.rate_hz):
        track = run.run(run.every)
        for navigation, truth in zip(track.navigation, track.truth, strict=True):
            wrong = np.array([navigation[key] - truth[key] for key in ("longitude", "latitude")])
            metres = wrong * SEMI_MAJOR_AXIS * [math.cos(truth["latitude"]), 1.0]
            errors.append(math.hypot(*metres))
            over_sigma.append(np.max(np.abs(wrong) / sigma))
        if len(track.navigation):  # a row is of the first of `every` epochs
            sigma = np.array([estimator.sigma[LONGITUDE], estimator.sigma[LATITUDE]])
    return np.array(errors), np.array(over_sigma), run.ram[0]


def level_errors(vehicle, fault, at_s, seed, duration_s):
    """Return level errors (m), the larger one over its sigma, and when a sensor was left out."""
    name, changes = VEHICLES[vehicle]
    if vehicle == "car in an outage":
        changes = changes | {"gnss": {"outages": [{"at_s": at_s - 20, "for_s": 80}]}}
    faults = [fault] if fault else []
    errors, over_sigma, ram = run_of(name, seed, duration_s=duration_s, faults=faults, **changes)
    kinds = ram.redundancy.gyros, ram.redundancy.accelerometers
    excluded = [kind.isolated_epoch for kind in kinds if kind.excluded]
    out_s = max(excluded) / 200 - 6.0 if excluded else None
    assert ram.estimator.reopenings < 4  # it opens for a measurement, and is not locked out
    return errors, over_sigma, out_s


def check(vehicle, fault, at_s, seed=1, duration_s=360):
    errors, over_sigma, out_s = level_errors(vehicle, fault, at_s, seed, duration_s)
    healthy, _, _ = level_errors(vehicle, None, at_s, seed, duration_s)
    print(
        f"\n{vehicle} {fault}: {errors.max():.2f} m, {over_sigma.max():.1f} sigma, left out {out_s}"
    )
    assert over_sigma.max() < 6.0
    if out_s is not None and out_s + 30 < duration_s:
        after = slice(int(max(out_s, at_s + 60) + 30), None)
        rms, usual = (math.sqrt(np.mean(run[after] ** 2)) for run in (errors, healthy))
        print(f"30 s after {rms:.2f} m, healthy {usual:.2f} m")
        return rms, usual
    return 0.0, 1.0


@pytest.mark.parametrize(
    ("vehicle", "fault"),
    [
        ("car in an outage", {"kind": "gyro_bias", "sensor": 3, "bias_dph": -86.0}),
        ("car in an outage", {"kind": "accelerometer_bias", "sensor": 1, "bias_ug": 3400}),
        ("car with odometer", {"kind": "accelerometer_bias", "sensor": 4, "bias_ug": -27_500}),
        ("car", {"kind": "gyro_bias", "sensor": 2, "bias_dph": 20.0}),
        ("ship", {"kind": "accelerometer_bias", "sensor": 1, "bias_ug": 10_000}),
    ],
)
def test_a_sensor_that_fails_is_in_sigma_until_its_effect_is_undone(vehicle, fault):
    rms, usual = check(vehicle, fault | {"at_s": 110}, 110, duration_s=300)
    assert rms < 1.5 * usual


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "gyro_bias", "sensor": 3, "bias_dph": 200.0},
        {"kind": "accelerometer_bias", "sensor": 4, "bias_ug": 30_000},
        {"kind": "accelerometer_bias", "sensor": 2, "bias_ug": -6000},  # never told from the others
    ],
)
def test_heights_that_aid_alone_leave_sigma_and_the_vertical_channel_right(fault):
    aid = {"gnss": None, "altimeter": {"noise_m": 0.5}, "estimator": {"enabled": True}}
    _, over_sigma, ram = run_of(
        "drive_rotating", 1, duration_s=300, faults=[fault | {"at_s": 60}], **aid | SENSORS | DRIVE
    )
    estimator = ram.estimator
    assert over_sigma.max() < 3.0
    assert np.linalg.eigvalsh(estimator.P[: estimator.states, : estimator.states])[0] >= 0.0
    assert estimator.sources[Aid.ALTIMETER].rejected <= 1
    assert estimator.reopenings == 0


@pytest.mark.soak
def test_faults_at_random_are_in_sigma_until_their_effect_is_undone():
    random, squares = np.random.default_rng(1), []
    for seed in range(1, RUNS + 1):
        vehicle = list(VEHICLES)[seed % len(VEHICLES)]
        at_s, sign = int(random.integers(100, 200)), float(random.choice([-1, 1]))
        fault = {"sensor": int(random.integers(1, 5)), "at_s": at_s}
        if random.integers(2):
            fault |= {"kind": "gyro_bias", "bias_dph": sign * 0.5 * 200 ** random.uniform()}
        else:
            fault |= {"kind": "accelerometer_bias", "bias_ug": sign * 100 * 500 ** random.uniform()}
        squares.append(np.square(check(vehicle, fault, at_s, seed, 420)))
    after, healthy = np.sqrt(np.mean(squares, axis=0))
    print(f"\nrms 30 s after: {after:.2f} m, healthy {healthy:.2f} m")
    assert after < 1.5 * healthy


def test_a_wheel_that_slips_in_an_outage_of_gnss_is_noticed_and_sigma_grows():
    at_s = 150
    slips = {"kind": "odometer_slip", "slip_percent": 2.0, "at_s": at_s}
    aids = {"gnss": {"outages": [{"at_s": at_s, "for_s": 300}]}}
    healthy = run_of("drive_aided", 1, duration_s=420, **aids)
    errors, over_sigma, ram = run_of("drive_aided", 1, duration_s=420, faults=[slips], **aids)
    print(f"\n{errors.max():.2f} m, {over_sigma.max():.1f} sigma; healthy {healthy[0].max():.2f} m")
    assert over_sigma.max() < 5.0
    assert errors.max() < 3.0
    rejected = [int(one.estimator.sources[Aid.ODOMETER].rejected) for one in (healthy[2], ram)]
    assert rejected[0] == 0 < rejected[1]


def test_errors_of_gnss_that_last_are_in_sigma():
    """Of 1.5 m, for a minute: as noise alone they gave 3 to 6 sigma rms."""
    lasting = {"position_noise_m": 0.3, "position_correlated_noise_m": 1.5}
    name, changes = VEHICLES["car"]
    runs = [
        run_of(name, seed, **changes | {"gnss": lasting, "duration_s": 600}) for seed in (1, 2, 3)
    ]
    squares = np.concatenate([over_sigma[30:] ** 2 for _, over_sigma, _ in runs])
    print(f"\nrms of the larger component {math.sqrt(np.mean(squares)):.2f} sigma")
    assert 0.6 < math.sqrt(np.mean(squares)) < 2.0  # ten minutes have ten errors of a minute


def test_a_receiver_that_is_led_away_slowly_stands_alone_against_odometer_and_sensors():
    """By 0.1 m/s: followed for 28 m, when only the gate looked at each fix."""
    pull = {"kind": "gnss_pull", "pull_mps": 0.1, "direction": "east", "at_s": 150, "for_s": 200}
    name, changes = VEHICLES["car with odometer"]
    errors, over_sigma, ram = run_of(name, 1, duration_s=360, faults=[pull], **changes)
    refused = int(ram.estimator.sources[Aid.GNSS_VELOCITY].rejected)
    print(f"\n{errors.max():.2f} m, {over_sigma.max():.1f} sigma, {refused} refused")
    assert errors.max() < 2.0
    assert over_sigma.max() < 5.0
    assert refused > 500
    assert ram.estimator.sources[Aid.ODOMETER].rejected == 0
