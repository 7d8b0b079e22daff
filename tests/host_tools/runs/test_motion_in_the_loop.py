"""A moving vehicle: the truth is the trajectory, and sensors without errors follow it."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, VELOCITY_N
from rrins.host_tools.runs.direct import run_without_frames
from rrins.host_tools.runs.results.samples import TRUTH_SAMPLES, read_samples
from rrins.host_tools.runs.set_up.settings import trajectory_of
from rrins.host_tools.scenario.scenario import Scenario

AIDED = {"altimeter": {}, "firmware": {"height_channel": "damped"}}
MOTIONS = {
    "drive": ({"kind": "drive"}, 1200),
    "sway": ({"kind": "sway"}, 600),
}


def moving(motion, duration_s, **tables):
    values = {"duration_s": duration_s, "motion": motion} | AIDED | tables
    return Scenario.model_validate(values)


@pytest.mark.parametrize("mode", ["strapdown", "rotating"])
@pytest.mark.parametrize("name", MOTIONS)
def test_ideal_sensors_follow_the_vehicle(fly, name, mode):
    motion, duration_s = MOTIONS[name]
    firmware, errors = fly(moving(motion, duration_s, mode=mode))
    assert firmware["epochs_navigated"] > duration_s * 200
    assert firmware["axes_not_following"] == [False, False]
    # Half a metre is asked for; what is left is counting, some millimetres.
    assert np.hypot(errors.position_east_m, errors.position_north_m).max() < 0.02
    assert np.abs(errors.height_m).max() < 2e-3
    assert np.hypot(errors.velocity_east_mps, errors.velocity_north_mps).max() < 1e-3
    for angle in (errors.roll_deg, errors.pitch_deg, errors.heading_deg):
        assert np.abs(angle).max() < 5e-5  # the encoders' steps are of 2e-5°


@pytest.mark.parametrize("rate_hz", [50, 400])
def test_ideal_sensors_follow_at_other_rates(fly, rate_hz):
    _, errors = fly(moving({"kind": "drive", "seed": 3}, 300, rate_hz=rate_hz))
    # At 50 Hz what coning and sculling leave out in curves counts.
    assert np.hypot(errors.position_east_m, errors.position_north_m).max() < 0.1


def truth_of(scenario, folder):
    run_without_frames(scenario, folder)
    return read_samples(folder / TRUTH_SAMPLES, Truth)


def angle(difference):
    return (difference + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize(("name", "seconds"), [("drive", 100), ("sway", 100)])
def test_the_truth_is_the_trajectory(name, seconds, tmp_path):
    scenario = moving(MOTIONS[name][0] | {"duration_s": 60}, seconds)
    truth = truth_of(scenario, tmp_path)
    trajectory = trajectory_of(scenario)
    time_s = (truth["epoch"] - scenario.navigation_epoch) / scenario.rate_hz
    expected = trajectory.at(time_s)
    for k, key in enumerate(("latitude", "longitude", "height")):
        tolerance = 1e-13 if k < 2 else 1e-9
        assert truth[key] == pytest.approx(expected[:, PLACE][:, k], abs=tolerance)
    assert truth["velocity_n"] == pytest.approx(expected[:, VELOCITY_N], abs=1e-10)
    for k, key in enumerate(("roll", "pitch", "heading")):
        off = angle(truth[key] - expected[:, ATTITUDE][:, k])
        assert np.abs(off).max() < 1e-10
    assert time_s[0] <= 0
    assert time_s[-1] > 90  # a drive has ended, a sea goes on
    assert np.abs(truth["velocity_n"][time_s > 65]).max() > 0.01 or name == "drive"


def test_the_vehicle_rests_before_its_motion_and_after_it(fly):
    scenario = moving({"kind": "drive", "duration_s": 60}, 120, navigate_at_s=5, rate_hz=100)
    _, errors = fly(scenario)
    trajectory = trajectory_of(scenario)
    first, last = trajectory.at(np.array([0.0, 60.0]))
    assert np.abs(last[VELOCITY_N]).max() < 1e-9
    assert not np.array_equal(first[PLACE], last[PLACE])
    after = errors.time_s > 62
    assert np.hypot(errors.velocity_east_mps, errors.velocity_north_mps)[after].max() < 1e-5
    assert np.hypot(errors.position_east_m, errors.position_north_m)[after].max() < 5e-3


def test_a_sea_repeats_itself_without_a_seam(fly):
    scenario = moving({"kind": "sway", "duration_s": 60}, 400)
    assert trajectory_of(scenario).loop_from is not None
    _, errors = fly(scenario)
    assert np.hypot(errors.position_east_m, errors.position_north_m).max() < 5e-3
    assert np.abs(errors.roll_deg).max() < 5e-5


def test_a_later_request_to_navigate_starts_the_motion_later(fly):
    operator = [{"at_s": 1, "request": "ALIGN"}, {"at_s": 9, "request": "NAVIGATE_STRAPDOWN"}]
    scenario = moving({"kind": "drive", "duration_s": 60}, 60, operator=operator)
    assert scenario.navigation_epoch == 11 * 200
    _, errors = fly(scenario)
    assert np.hypot(errors.position_east_m, errors.position_north_m).max() < 5e-3


# Height

HILLS = {"kind": "drive", "seed": 2}


def test_the_height_of_the_hills_is_kept_by_the_altimeter(fly):
    sensors = {"accelerometers": {"bias_ug": [-50, 0, 0, 0]}}
    heights = {}
    for channel, altimeter in (("damped", {}), ("free", None)):
        scenario = moving(
            HILLS, 1500, rate_hz=50, mode="strapdown", altimeter=altimeter,
            firmware={"height_channel": channel}, **sensors,
        )  # fmt: skip
        _, errors = fly(scenario)
        heights[channel] = np.abs(errors.height_m).max()
    # 50 µg on the damped loop passes by after its time constants of 100 s; free it grows.
    assert heights["damped"] < 3
    assert heights["free"] > 300


def test_without_an_altimeter_a_damped_height_stays_that_of_the_start(fly):
    scenario = moving(HILLS, 600, rate_hz=50, altimeter=None)
    _, errors = fly(scenario)
    hills = trajectory_of(scenario).at(np.arange(600.0))[:, PLACE][:, 2]
    assert np.ptp(hills) > 10
    assert np.abs(errors.height_m).max() > 0.3 * np.ptp(hills)


def test_an_altimeters_bias_is_the_heights_and_its_noise_is_smoothed(fly):
    scenario = moving({"kind": "stationary"}, 3000, rate_hz=50, altimeter={"bias_m": -4})
    _, errors = fly(scenario)
    assert errors.height_m[-1] == pytest.approx(-4, abs=1e-3)
    noisy = scenario.varied(altimeter={"noise_m": 2}, duration_s=6000)
    _, errors = fly(noisy)
    settled = errors.height_m[errors.time_s > 600]
    # Ten readings a second through three poles at 1/(100 s): noise bandwidth of some 1/60 Hz.
    assert 0.02 < settled.std() < 0.2
    assert abs(settled.mean()) < 0.1


def test_an_altimeter_that_was_silent_is_believed_gently_again(fly, tmp_path):
    from rrins.host_tools.runs.direct import run_direct
    from rrins.host_tools.runs.results.results import read_errors

    silent = {"kind": "drop", "message": "ALTIMETER", "at_s": 100, "for_s": 300}
    scenario = moving(
        {"kind": "stationary"}, 700, rate_hz=50, mode="strapdown", faults=[silent],
        accelerometers={"bias_ug": [-100, 0, 0, 0]},
    )  # fmt: skip
    run_direct(scenario, tmp_path)
    errors = read_errors(tmp_path, 50)
    back = errors.time_s > 398
    drifted = np.abs(errors.height_m[~back]).max()
    assert drifted > 5
    # From what it had drifted to it comes back without overshooting as far to the other side.
    assert np.abs(errors.height_m[back]).max() < 1.6 * drifted
    assert abs(np.diff(errors.height_m[back])).max() < 0.2 * drifted
