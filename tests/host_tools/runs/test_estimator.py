"""The estimator over whole runs: how well it aligns and bridges, and whether it knows how well.

`RRINS_SEEDS=40 pytest -s tests/host_tools/runs/test_estimator.py` asks more runs, prints figures;
`RRINS_MOTION=FILE` drives a recorded motion, `RRINS_FINE_S=1600` aligns for as long.
"""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from scipy.stats import chi2

import rrins
from rrins.firmware_py.core.maths.earth import RATE, SEMI_MAJOR_AXIS
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    LATITUDE,
    LONGITUDE,
    NO_TRUST,
    Aid,
)
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from tests.host_tools.runs.noisy_runs import attitude_error, fast_run

SEEDS = int(os.environ.get("RRINS_SEEDS", "5"))
FINE_S = float(os.environ.get("RRINS_FINE_S", "400"))
LONGEST_OUTAGE_S = 300 if SEEDS >= 20 else 120 if "RRINS_SEEDS" in os.environ else 60
ARCSEC = math.radians(1 / 3600)
WALK_DEG_PER_SQRT_H = 0.005
PROTOTYPE = {
    "gyros": {
        "bias_dph": [0.1, 0.11, 0.12, 0.13],
        "angle_random_walk_deg_per_sqrt_h": WALK_DEG_PER_SQRT_H,
    },
    "accelerometers": {"bias_ug": [50, 55, 60, 65], "white_noise_ug_per_sqrt_hz": 10},
}
TACTICAL = {
    "gyros": {"bias_dph": [3, -2, 1, -3], "angle_random_walk_deg_per_sqrt_h": 0.1},
    "accelerometers": {"bias_ug": [900, -700, 500, -900], "white_noise_ug_per_sqrt_hz": 50},
}


def test_without_noise_the_unit_finds_its_attitude_and_biases_itself():
    summary = rrins.simulate("rimu_rotating_aligned").summary
    worst = summary["max_abs_position_error_m"]
    assert math.hypot(worst["east"], worst["north"]) < 2.0
    assert [kind["sensor"] for kind in summary["redundancy"].values()] == [None, None]


@pytest.mark.parametrize(("sensor", "at_s"), [(2, 150), (3, 197), (4, 201), (3, 250)])
def test_a_gyro_that_fails_in_the_fine_alignment_is_left_out_and_does_no_harm(sensor, at_s):
    fault = {"kind": "gyro_bias", "sensor": sensor, "bias_dph": 10, "at_s": at_s}
    summary = rrins.simulate("rimu_rotating_aligned", duration_s=200, faults=(fault,)).summary
    assert summary["redundancy"]["gyros"]["sensor"] == sensor
    # At 200 s the table has turned about an axis for the first time.
    worst = summary["max_abs_position_error_m"]
    assert math.hypot(worst["east"], worst["north"]) < 2.0


def test_a_gyro_that_fails_just_after_the_fine_alignment_is_named():
    fault = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 10, "at_s": 465}
    summary = rrins.simulate("rimu_rotating_aligned", duration_s=120, faults=(fault,)).summary
    assert summary["redundancy"]["gyros"]["alarm_s"] == pytest.approx(4.0, abs=0.5)
    assert summary["redundancy"]["gyros"]["sensor"] == 2


def aligned(seed, seconds):
    """Return the attitude's error after a fine alignment, and the filter's sigma, rad."""
    built_in = rrins.load_scenario("rimu_rotating_aligned").estimator
    estimator = built_in.model_dump(exclude_unset=True) | {"fine_alignment_s": seconds}
    random = np.random.default_rng(seed)  # any heading, and tilts of up to 5°
    roll, pitch = random.uniform(-5, 5, 2)
    body = {"roll_deg": roll, "pitch_deg": pitch, "heading_deg": random.uniform(-180, 180)}
    scenario = rrins.load_scenario(
        "rimu_rotating_aligned",
        seed=seed,
        duration_s=1,
        body=body,
        estimator=estimator,
        **PROTOTYPE,
    )
    run = fast_run(scenario)
    track = run.run(scenario.epochs)
    sigma = np.array(run.ram[0].estimator.sigma[ATTITUDE : ATTITUDE + 3])
    return attitude_error(track.navigation[0], track.truth[0]), sigma


def test_the_heading_is_as_good_as_the_gyros_noise_allows():
    seconds = FINE_S
    runs = [aligned(seed, seconds) for seed in range(SEEDS)]
    errors, sigmas = (np.array(column) for column in zip(*runs, strict=True))
    rms = np.sqrt(np.mean(errors**2, axis=0)) / ARCSEC
    fused = math.radians(WALK_DEG_PER_SQRT_H) / 60 * math.sqrt(3) / 2  # four on a tetrahedron
    horizontal = RATE * math.cos(math.radians(40.3554))
    limit = fused / (horizontal * math.sqrt(seconds)) / ARCSEC
    nees = np.sum((errors / sigmas) ** 2, axis=0)
    print(
        f"\nheading {rms[2]:.0f}″, limit {limit:.0f}″; tilt {rms[:2].max():.2f}″; NEES",
        nees / SEEDS,
    )
    by_chance = math.sqrt(chi2.ppf(0.99, SEEDS) / SEEDS)
    assert rms[2] < 1.15 * limit * by_chance
    assert rms[:2].max() < 1.5 * by_chance
    low, high = chi2.ppf([0.005, 0.995], SEEDS)
    assert low < nees[2] < high


def least_heading_sigma(attitudes, bias_sigma, white_noise):
    """Return the least sigma of the heading at the end that any estimator could have, rad.

    With a level that is known without noise. Each second's turn about east is the Earth's by the
    heading's error, the bias and noise; about north the last two; about up the heading goes with
    the bias. Cramér and Rao's bound, of the heading at the end and the fused bias.
    """
    horizontal = RATE * math.cos(math.radians(40.3554))
    information = np.diag([0.0, *3 * (bias_sigma**-2,)])
    since = np.zeros(3)  # what a bias has turned the heading by, from then to the end
    for C_s_n in attitudes[::-1]:
        east = np.array([horizontal, *(C_s_n[0] - horizontal * since)])
        north = np.array([0.0, *C_s_n[1]])
        information += (np.outer(east, east) + np.outer(north, north)) / white_noise**2
        since = since + C_s_n[2]
    return math.sqrt(np.linalg.inv(information)[0, 0])


@pytest.mark.parametrize("heading_deg", [0, 60])
def test_no_estimator_could_know_the_heading_much_better(heading_deg):
    scenario = rrins.load_scenario(
        "rimu_rotating_aligned",
        duration_s=1,
        body={"heading_deg": heading_deg},
        estimator={"enabled": True, "fine_alignment_s": FINE_S},
        **PROTOTYPE,
    )
    run = fast_run(scenario)
    estimator, ins, attitudes = run.ram[0].estimator, run.ram[0].ins, []
    while not len(run.run(run.every).navigation):
        if estimator.running:
            attitudes.append(np.array(ins.C_s_n))
            biases = float(estimator.bias_sigma[0]) * math.sqrt(3) / 2
    sigma = float(estimator.sigma[ATTITUDE + 2])
    least = least_heading_sigma(
        np.array(attitudes), biases, math.radians(WALK_DEG_PER_SQRT_H) / 60 * math.sqrt(3) / 2
    )
    print(f"\nsigma {sigma / ARCSEC:.0f}″, {sigma / least:.3f} of the least")
    assert 0.99 < sigma / least < 1.1


OUTAGES = {  # seconds: median of the largest error, m, with GNSS alone and with an odometer
    "prototype": (PROTOTYPE, {60: (1.8, 0.6), 120: (6.0, 1.5), 300: (45.0, 2.0)}),
    "tactical": (TACTICAL, {60: (9.0, 0.7), 120: (32.0, 1.6), 300: (280.0, 2.0)}),
}
OUTAGE_AT_S = 200


def drive(seed, outage_s, sensors, odometer):
    """Return the largest level error in an outage, m, errors over sigma, and the run's filter."""
    motion = os.environ.get("RRINS_MOTION")
    changes = {} if motion is None else {"motion": {"kind": "file", "path": motion}}
    scenario = rrins.load_scenario(
        "drive_rotating",
        seed=seed,
        duration_s=OUTAGE_AT_S + outage_s + 30,
        gnss={"outages": [{"at_s": OUTAGE_AT_S, "for_s": outage_s}]},
        altimeter=None,
        firmware={"height_channel": "free"},
        estimator={"enabled": True},
        **({"odometer": {}} if odometer else {}),
        **sensors,
        **changes,
    )
    run = fast_run(scenario)
    filter_state = run.ram[0].estimator
    level, over_sigma = [], []
    for second in range(scenario.epochs // scenario.rate_hz):
        track = run.run(scenario.rate_hz)
        for navigation, truth in zip(track.navigation, track.truth, strict=True):
            east = (navigation["longitude"] - truth["longitude"]) * math.cos(truth["latitude"])
            north = navigation["latitude"] - truth["latitude"]
            if OUTAGE_AT_S <= second < OUTAGE_AT_S + outage_s:
                level.append(math.hypot(east, north) * SEMI_MAJOR_AXIS)
            sigma = filter_state.sigma[LONGITUDE], filter_state.sigma[LATITUDE]
            if min(sigma) > 0:
                over_sigma += [east / math.cos(truth["latitude"]) / sigma[0], north / sigma[1]]
    return max(level), over_sigma, filter_state


@pytest.mark.parametrize("grade", OUTAGES)
def test_an_outage_of_gnss_is_bridged_and_the_filter_knows_how_well(grade):
    sensors, limits = OUTAGES[grade]
    over_sigma = []
    for outage_s, bounds in limits.items():
        if outage_s > LONGEST_OUTAGE_S:
            continue
        for odometer, bound in zip((False, True), bounds, strict=True):
            worst = []
            for seed in range(SEEDS):
                largest, ratios, filter_state = drive(seed, outage_s, sensors, odometer)
                worst.append(largest)
                over_sigma += ratios
                for aid in (Aid.GNSS_POSITION, Aid.GNSS_VELOCITY):
                    source = filter_state.sources[int(aid)]
                    assert 0.75 < source.squares / source.used < 1.3, aid
            median = float(np.median(worst))
            inside = np.mean(np.abs(over_sigma) < 3)
            print(f"\n{grade}, {outage_s} s, odometer {odometer}: median {median:.2f} m of {bound}")
            print(f"so far {inside:.2%} inside 3 sigma")
            assert median < bound
    assert np.mean(np.abs(over_sigma) < 3) > 0.99


def test_a_fault_in_an_aided_drive_is_found_and_costs_metres():
    fault = {"kind": "gyro_bias", "sensor": 3, "bias_dph": 100, "at_s": 100}
    scenario = {"gnss": {}, "odometer": {}, "estimator": {"enabled": True}} | PROTOTYPE
    run = rrins.simulate("drive_rotating", duration_s=200, faults=(fault,), **scenario)
    assert run.summary["redundancy"]["gyros"]["sensor"] == 3
    worst = run.summary["max_abs_position_error_m"]
    assert math.hypot(worst["east"], worst["north"]) < 5.0


LIES = {
    "gnss_jump": {"jump_m": 100, "direction": "east"},
    "gnss_pull": {"pull_mps": 1, "direction": "north"},
    "odometer_slip": {},
    "odometer_lock": {},
}


@pytest.mark.parametrize("kind", LIES)
def test_a_source_that_lies_is_not_believed_and_told(kind):
    fault = {"kind": kind, "at_s": 150, "for_s": 60, **LIES[kind]}
    run = fast_run(rrins.load_scenario("drive_aided", duration_s=240, faults=(fault,)))
    worst_m, told = 0.0, set()
    for second in range(240):
        track = run.run(run.every)
        for navigation, truth in zip(track.navigation, track.truth, strict=True):
            east = (navigation["longitude"] - truth["longitude"]) * math.cos(truth["latitude"])
            north = navigation["latitude"] - truth["latitude"]
            worst_m = max(worst_m, math.hypot(east, north) * SEMI_MAJOR_AXIS)
        distrust = [int(source.distrust) for source in run.ram[0].estimator.sources]
        gnss = max(distrust[Aid.GNSS_POSITION], distrust[Aid.GNSS_VELOCITY]) >= NO_TRUST
        if gnss or distrust[Aid.ODOMETER] >= NO_TRUST:
            told.add(("gnss" if gnss else "odometer", 150 <= second <= 225))
    print(f"\n{kind}: {worst_m:.2f} m")
    assert worst_m < 2.0
    assert told == {(kind.split("_")[0], True)}


def test_a_filter_that_trusts_a_wrong_heading_finds_back_to_its_fixes():
    wrong = {"heading_error_arcsec": 18_000}  # and sigma says 10″
    run = fast_run(
        rrins.load_scenario(
            "drive_rotating",
            duration_s=360,
            altimeter=None,
            firmware={"height_channel": "free"} | wrong,
            gnss={},
            estimator={"enabled": True, "heading_sigma_arcsec": 10},
            **PROTOTYPE,
        )
    )
    openings, level_m = [], []
    for _ in range(360):
        track = run.run(run.every)
        if len(track.navigation):
            navigation, truth = track.navigation[-1], track.truth[-1]
            east = (navigation["longitude"] - truth["longitude"]) * math.cos(truth["latitude"])
            north = navigation["latitude"] - truth["latitude"]
            level_m.append(math.hypot(east, north) * SEMI_MAJOR_AXIS)
            openings.append(int(run.ram[0].estimator.reopenings))
    heading = abs(attitude_error(track.navigation[-1], track.truth[-1])[2])
    print(f"\nbefore {max(level_m):.0f} m, {math.degrees(heading):.3f}° and {level_m[-1]:.2f} m")
    assert openings[-1] == 1
    assert 120 < openings.index(1) < 300
    assert max(level_m[-30:]) < 5.0 < max(level_m)
    assert math.degrees(heading) < 0.5


def test_the_sensors_find_themselves_that_the_car_stands():
    run = fast_run(
        rrins.load_scenario(
            "drive_rotating",
            duration_s=250,
            altimeter=None,
            firmware={"height_channel": "free"},
            gnss={},
            estimator={"enabled": True, "detects_standing": True},
            **TACTICAL,
        )
    )
    stands, found = [], []
    for _ in range(250):
        track = run.run(run.every)
        for truth in track.truth[-1:]:
            stands.append(math.hypot(*truth["velocity_n"]) < 0.1)
            found.append(bool(run.ram[0].estimator.standing))
    print(f"\nstands {sum(stands)} s, found {sum(found)} s")
    assert not any(one and not other for one, other in zip(found, stands, strict=True))
    assert sum(found) > 0.5 * sum(stands)


def test_a_wheel_that_stands_keeps_the_navigation_where_it_is():
    def worst_m(**changes):
        run = rrins.simulate("rimu_rotating", duration_s=900, **PROTOTYPE, **changes)
        return math.hypot(*run.summary["max_abs_position_error_m"].values())

    aided = worst_m(odometer={}, estimator={"enabled": True})
    assert aided < 1.0 < worst_m()


def worst_of_drive(knows_arm=True, **changes):
    """Return the largest level and height errors, m, of an aided drive, after its beginning."""
    scenario = rrins.load_scenario(
        "drive_rotating", duration_s=150, estimator={"enabled": True}, **TACTICAL | changes
    )
    settings = firmware_settings(scenario)
    if not knows_arm:
        settings = settings.model_copy(update={"gnss_lever_arm_m": (0.0, 0.0, 0.0)})
    run = FastRun.of(settings, hardware_settings(scenario), scenario.rate_hz)
    track = run.run(150 * scenario.rate_hz)
    east = (track.navigation["longitude"] - track.truth["longitude"]) * np.cos(
        track.truth["latitude"]
    )
    north = track.navigation["latitude"] - track.truth["latitude"]
    level = np.hypot(east, north).max() * SEMI_MAJOR_AXIS
    height = np.abs(track.navigation["height"] - track.truth["height"]).max()
    return level, height


def test_a_lever_arm_of_the_antenna_costs_nothing_where_it_is_known():
    free = {"altimeter": None, "firmware": {"height_channel": "free"}}
    centre = worst_of_drive(**free, gnss={})
    arm = {"lever_arm_m": (0.5, -2.5, 1.5)}
    known = worst_of_drive(**free, gnss=arm)
    unknown = worst_of_drive(knows_arm=False, **free, gnss=arm)
    print(f"\nat the centre {centre}, known {known}, unknown {unknown} m")
    assert known == pytest.approx(centre, abs=0.05)
    assert unknown[0] > 2.0


def test_the_altimeter_holds_the_height_in_spite_of_biases_of_a_milli_g():
    altimeter = {"bias_m": 5, "noise_m": 0.5}
    level, height = worst_of_drive(altimeter=altimeter, odometer={})
    print(f"\nlevel {level:.2f} m, height {height:.2f} m")
    assert height < 0.5
    assert level < 5.0
