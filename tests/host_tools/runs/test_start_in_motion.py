"""The start of the navigation on a vehicle that sways or drives, with no attitude given.

`RRINS_SEEDS=20 pytest -s tests/host_tools/runs/test_start_in_motion.py` asks more runs.
"""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from pydantic import ValidationError

import rrins
from rrins.firmware_py.core.maths.earth import RATE, SEMI_MAJOR_AXIS
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.estimator_records import ATTITUDE
from tests.host_tools.runs.noisy_runs import attitude_error, fast_run

SEEDS = int(os.environ.get("RRINS_SEEDS", "3"))
ARCSEC = math.radians(1 / 3600)
WALK_DEG_PER_SQRT_H = 0.005
PROTOTYPE = {
    "sensors": None,
    "gyros": {
        "bias_dph": [0.1, 0.11, 0.12, 0.13],
        "angle_random_walk_deg_per_sqrt_h": WALK_DEG_PER_SQRT_H,
    },
    "accelerometers": {"bias_ug": [50, 55, 60, 65], "white_noise_ug_per_sqrt_hz": 10},
}
FINE_S = 400


def first_seconds(run, seconds, limit_s=1500):
    """Return navigation and truth of the first seconds that it navigates."""
    rows = []
    for _ in range(limit_s):
        track = run.run(run.every)
        rows += zip(track.navigation, track.truth, strict=True)
        if len(rows) >= seconds:
            return rows
    raise AssertionError(f"still {Mode(int(run.ram[0].modes.mode)).name}")


def body_of(seed):
    """Return any heading, and a tilt up to 5°."""
    random = np.random.default_rng(seed)
    roll, pitch = random.uniform(-5, 5, 2)
    return {"roll_deg": roll, "pitch_deg": pitch, "heading_deg": random.uniform(-180, 180)}


def test_a_ship_that_sways_finds_its_heading_as_well_as_one_that_stands():
    errors, sigmas = [], []
    for seed in range(SEEDS):
        scenario = rrins.load_scenario(
            "ship_moored",
            seed=seed,
            duration_s=1,
            body=body_of(seed),
            motion={"kind": "sway", "begins_s": -200, "seed": seed}
            | {"wave_height_m": 1.0, "wave_period_s": 8, "roll_period_s": 9},
            estimator={"enabled": True, "fine_alignment_s": FINE_S},
            zero_velocity=(),
            **PROTOTYPE,
        )
        run = fast_run(scenario)
        errors.append(attitude_error(*first_seconds(run, 1)[0]))
        sigmas.append(np.array(run.ram[0].estimator.sigma[ATTITUDE : ATTITUDE + 3]))
    rms = np.sqrt(np.mean(np.square(errors), axis=0)) / ARCSEC
    fused = math.radians(WALK_DEG_PER_SQRT_H) / 60 * math.sqrt(3) / 2  # four on a tetrahedron
    limit = fused / (RATE * math.cos(math.radians(40.0)) * math.sqrt(FINE_S)) / ARCSEC
    nees = np.mean(np.square(errors) / np.square(sigmas), axis=0)
    print(f"\nheading {rms[2]:.0f}″, limit {limit:.0f}″; tilt {rms[:2].max():.2f}″; NEES", nees)
    assert rms[2] < 1.15 * 1.5 * limit * (1.0 if SEEDS >= 20 else 1.6)
    assert np.all(np.abs(errors) < 4 * np.array(sigmas))


def test_a_unit_that_is_switched_on_in_a_moving_car_finds_heading_and_place():
    worst_m, headings = [], []
    for seed in range(SEEDS):
        motion = {"kind": "drive", "duration_s": 900, "begins_s": -60 * (seed + 1), "seed": seed}
        scenario = rrins.load_scenario(
            "drive_begun", seed=seed, duration_s=180, motion=motion, body=body_of(seed), **PROTOTYPE
        )
        rows = first_seconds(fast_run(scenario), 180)
        navigation, truth = (np.array([row[k] for row in rows]) for k in (0, 1))
        north = (navigation["latitude"] - truth["latitude"]) * SEMI_MAJOR_AXIS
        east = (navigation["longitude"] - truth["longitude"]) * SEMI_MAJOR_AXIS
        level = np.hypot(north, east * np.cos(truth["latitude"]))
        worst_m.append(level.max())
        first, last = (abs(attitude_error(*rows[k])[2]) / ARCSEC for k in (0, -1))
        headings.append((first, last))
        assert level[60:].max() < 2.0
    coarse, fine = np.median(headings, axis=0)
    print(f"\nheading {coarse:.0f}″, then {fine:.0f}″; position {np.median(worst_m):.1f} m at most")
    assert coarse < 1500
    assert fine < 200
    assert max(worst_m) < 10.0


def transferred(errors, seed=0, **changes):
    """Return navigation and truth of a drive under way whose beginning another unit has told."""
    firmware = {
        "initial_attitude": "transferred",
        "alignment_s": 2,
        "height_channel": "free",
        "scheme": "16-position",
        **errors,
    }
    motion = {"kind": "drive", "duration_s": 900, "begins_s": -60, "seed": 4}
    scenario = rrins.load_scenario(
        "drive_begun",
        seed=seed,
        duration_s=60,
        motion=motion,
        firmware=firmware,
        **{"gnss": None, "odometer": None} | changes,
    )
    rows = first_seconds(fast_run(scenario), 60)
    return (np.array([row[k] for row in rows]) for k in (0, 1))


def test_a_start_by_transfer_is_the_truth_of_its_epoch():
    navigation, truth = transferred({}, sensors="ideal", estimator={"enabled": False})
    assert math.hypot(*truth["velocity_n"][0]) > 5.0
    off = np.abs(navigation["velocity_n"] - truth["velocity_n"])
    north = np.abs(navigation["latitude"] - truth["latitude"]) * SEMI_MAJOR_AXIS
    print(f"\nvelocity {off[0].max():.1e} m/s, north {north[0]:.1e} m at first, {north[-1]:.1e} m")
    assert off[0].max() < 1e-3
    assert north.max() < 0.01


def test_a_start_by_transfer_is_as_good_as_the_other_unit_and_fixes_mend_it():
    errors = {
        "heading_error_sigma_arcsec": 1800,
        "level_error_sigma_arcsec": 180,
        "velocity_error_sigma_mps": 0.5,
        "position_error_sigma_m": 20,
    }
    found = []
    for seed in range(SEEDS):
        navigation, truth = transferred(errors, seed, gnss={}, **PROTOTYPE)
        north = (navigation["latitude"] - truth["latitude"]) * SEMI_MAJOR_AXIS
        speed = (navigation["velocity_n"] - truth["velocity_n"])[:, 1]
        headings = [attitude_error(navigation[k], truth[k])[2] / ARCSEC for k in (0, -1)]
        found.append((north[0], north[-1], speed[0], speed[-1], *headings))
    first_m, last_m, first_mps, last_mps, _, heading = np.abs(found).T
    print(f"\n{found}")
    assert 1.0 < first_m.mean() < 60
    assert 0.05 < first_mps.mean() < 1.5
    assert last_m.max() < 3.0
    assert last_mps.max() < 0.1
    assert heading.max() < 900


def test_errors_of_a_transferred_motion_are_for_a_transfer():
    with pytest.raises((ValidationError, rrins.ScenarioError), match="transferred"):
        rrins.load_scenario("drive_begun", firmware={"velocity_error_sigma_mps": 0.5})


def test_fixes_are_needed_to_align_in_motion():
    with pytest.raises(rrins.ScenarioError, match=r'"self-aligned-moving" needs a \[gnss\]'):
        rrins.load_scenario("drive_begun", gnss=None)


def test_a_vehicle_at_rest_has_no_beginning_of_its_motion():
    with pytest.raises((ValidationError, rrins.ScenarioError), match="begins_s is for kind"):
        rrins.load_scenario("ideal", motion={"kind": "stationary", "begins_s": 1.0})
