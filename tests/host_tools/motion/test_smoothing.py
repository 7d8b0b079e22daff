"""A recorded path becomes a trajectory that lies on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.motion.build import follow, load_recording
from rrins.host_tools.scenario.motion import Motion

PERIOD_NS = 5_000_000


def smooth(path, **keys):
    motion = Motion(kind="file", path=str(path), **keys)
    return follow(load_recording(motion, path.parent), motion, PERIOD_NS)


def out_and_back():
    """Return a way north that stops and goes back the same way, 4 Hz."""
    t = np.arange(0, 80, 0.25)
    u = np.clip((t - 5) / 25, 0, 1)
    v = np.clip((t - 45) / 25, 0, 1)
    return 150 * u**3 * (10 + u * (6 * u - 15)) - 40 * v**3 * (10 + v * (6 * v - 15))


@pytest.mark.parametrize("ending", ["csv", "pos"])
@pytest.mark.parametrize("period_ns", [5_000_000, 20_000_000, 8_000_000])
def test_an_export_is_followed_to_the_millimetre(exported, write, drive, ending, period_ns):
    path = write(exported[ending], f"own.{ending}")
    motion = Motion(kind="file", path=str(path))
    recording = load_recording(motion, path.parent)
    smoothed = follow(recording, motion, period_ns)
    times = np.arange(0, 149, 0.1)
    begin = smoothed.residuals.time_s[0]
    found, expected = smoothed.trajectory.at(times + begin), drive.at(times)
    off = (found - expected)[:, 6:9] * [6.37e6, 4.9e6, 1]
    assert np.abs(off).max() < 0.005
    assert np.abs(found[:, 9:12] - expected[:, 9:12]).max() < 0.03
    turn = (found - expected)[:, 12:15]
    turn[:, 2] = (turn[:, 2] + math.pi) % (2 * math.pi) - math.pi
    limits = [0.05, 0.05, 0.2] if ending == "csv" else [2, 1, 2]  # a .pos has no attitude
    assert (np.degrees(np.abs(turn)).max(axis=0) < limits).all()


def test_noise_is_smoothed(record):
    t = np.arange(0, 100, 0.25)
    noise = np.random.default_rng(1).normal(scale=0.5, size=(2, len(t)))
    path = record(10 * t + noise[0], noise[1])
    smoothed = smooth(path, position_deviation_m=0.5, jerk_density_mps3_per_sqrt_hz=0.1)
    times = smoothed.residuals.time_s[40:-40]
    velocity = smoothed.trajectory.at(times)[:, 9:11]
    assert velocity == pytest.approx(np.tile([10.0, 0.0], (len(times), 1)), abs=0.7)
    rms = math.sqrt(np.mean(smoothed.residuals.position[:, 0] ** 2))
    assert rms == pytest.approx(0.5, rel=0.2)


def test_a_file_in_motion_gets_a_gentle_run_up_and_run_down(record):
    t = np.arange(0, 60, 0.25)
    smoothed = smooth(record(12 * t, 0 * t))
    trajectory = smoothed.trajectory
    assert "begins in motion, at 12.1 m/s: run-up of 12.1 s added" in trajectory.notes[0]
    assert smoothed.residuals.time_s[0] == pytest.approx(13.25)
    assert not trajectory.pieces[:4, 9:12].any()
    assert not trajectory.pieces[-4:, 9:12].any()
    state = trajectory.at(np.arange(0, trajectory.duration_s, 0.05))
    assert np.abs(state[:, 3:5]).max() < 2.5
    assert state[:, 9].min() > -0.05  # it does not take a run
    assert np.abs(smoothed.residuals.position).max() < 0.01


def test_heading_is_held_while_it_stands_and_reversing_is_seen(record):
    smoothed = smooth(record(np.zeros(320), out_and_back()))
    state = smoothed.trajectory.at(smoothed.residuals.time_s)
    heading = np.degrees(state[:, 14])
    assert (heading + 180) % 360 - 180 == pytest.approx(np.zeros(320), abs=1.0)
    assert state[-60, 10] > -5
    assert any("reversing" in note for note in smoothed.trajectory.notes)


def test_the_nose_is_up_going_uphill_and_in_reverse_as_well(record):
    north = out_and_back()
    state = smooth(record(np.zeros(320), north, up=0.1 * north)).trajectory.at(
        np.array([18.0, 60.0])
    )
    assert np.degrees(state[:, 13]) == pytest.approx([5.7, 5.7], abs=0.3)


def test_attitude_of_the_file_is_followed(record):
    t = np.arange(0, 60, 0.25)
    roll, pitch, heading = 5 * np.sin(t / 2), 3 * np.cos(t / 3) - 3, 90 + 2 * t
    path = record(0 * t, 0 * t, roll_deg=roll, pitch_deg=pitch, heading_deg=heading % 360)
    smoothed = smooth(path)
    found = np.degrees(smoothed.trajectory.at(smoothed.residuals.time_s)[8:-8, 12:15])
    assert found[:, 0] == pytest.approx(roll[8:-8], abs=0.05)
    assert found[:, 1] == pytest.approx(pitch[8:-8], abs=0.05)
    assert found[:, 2] - found[0, 2] == pytest.approx(2 * (t[8:-8] - t[8]), abs=0.05)


def test_late_velocities_are_found_out(record):
    t = np.arange(0, 120, 0.25)
    east = 40 * np.sin(t / 8)
    late = 5 * np.cos((t - 0.2) / 8)
    names = ("velocity_east_mps", "velocity_north_mps", "velocity_up_mps")
    zero = np.zeros_like(t)
    path = record(east, zero, **dict(zip(names, (late, zero, zero), strict=True)))
    smoothed = smooth(path)
    assert "the file's velocities are 0.20 s late" in " ".join(smoothed.trajectory.notes)
    assert np.abs(smoothed.residuals.velocity).max() < 0.1


def test_a_vehicle_that_never_moves(record):
    state = smooth(record(np.zeros(40), np.zeros(40))).trajectory.at(np.arange(0, 10, 0.5))
    assert np.abs(state[:, 9:12]).max() < 1e-6
    assert not state[:, 12:15].any()


def test_across_the_date_line(write):
    lines = ["time_s,latitude_deg,longitude_deg,height_m"]
    for k in range(100):
        longitude = 179.9995 + k * 1e-5
        lines.append(f"{k},-17,{longitude - 360 if longitude > 180 else longitude:.9f},5")
    smoothed = smooth(write(lines, "a.csv"))
    assert np.abs(smoothed.residuals.position).max() < 0.01


def test_one_outlier_below_a_jump_hardly_bends_the_path(record):
    t = np.arange(0, 60, 0.25)
    off = np.zeros_like(t)
    off[120] = 0.5
    smoothed = smooth(record(10 * t, off))
    assert np.abs(smoothed.trajectory.at(smoothed.residuals.time_s)[:, 10]).max() < 0.2
