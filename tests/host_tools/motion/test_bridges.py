"""Before the file, after it and in its gaps: nothing that nobody drove."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.motion.build import follow, load_recording
from rrins.host_tools.scenario.motion import Motion

PERIOD_NS = 5_000_000


def smooth(path, **keys):
    motion = Motion(kind="file", path=str(path), **keys)
    return follow(load_recording(motion, path.parent), motion, PERIOD_NS)


def sampled(smoothed):
    """Return times, velocity (m/s) and angles (°), 20 times a second."""
    trajectory = smoothed.trajectory
    times = np.arange(0, trajectory.duration_s, 0.05)
    state = trajectory.at(times)
    return times, state[:, 9:12], np.degrees(state[:, 12:15])


def swaying(t):
    """Return roll, pitch and heading in °, in full swing at any time."""
    return 5 * np.sin(t / 2), 3 * np.cos(t / 3), 90 + 40 * np.sin(t / 5)


@pytest.fixture
def swaying_file(record):
    """Write a vehicle that goes north at 10 m/s and sways; `kept` picks its lines."""

    def writer(end_s, kept=slice(None)):
        t = np.arange(0, end_s, 0.25)
        roll, pitch, heading = swaying(t)
        path = record(0 * t, 10 * t, roll_deg=roll, pitch_deg=pitch, heading_deg=heading)
        lines = path.read_text().splitlines()
        path.write_text("\n".join([lines[0], *np.array(lines[1:])[kept]]) + "\n")
        return path

    return writer


@pytest.mark.parametrize("end_s", [25.0, 29.0, 33.0, 38.0])
def test_the_attitude_of_the_file_is_held_before_and_after_it(swaying_file, end_s):
    smoothed = smooth(swaying_file(end_s))
    times, _, angles = sampled(smoothed)
    first, last = smoothed.residuals.time_s[[0, -1]]
    for outside, at_s in (
        (times < first - 2, 0.0),
        (times > last + 2, end_s - 0.25),
    ):
        assert np.abs(angles[outside] - swaying(at_s)).max() < 1.0
    assert np.abs(angles[:, 0]).max() < 7
    assert np.abs(angles[:, 1]).max() < 5


def test_the_attitude_of_the_file_passes_through_a_gap_without_overshoot(swaying_file):
    kept = np.r_[0:100, 220:400]  # 30 s are missing
    smoothed = smooth(swaying_file(100.0, kept))
    times, _, angles = sampled(smoothed)
    begin, end = smoothed.residuals.time_s[[99, 100]]
    inside = (times > begin) & (times < end)
    ends = np.array([swaying(24.75), swaying(55.0)])
    over = np.maximum(angles - ends.max(axis=0), ends.min(axis=0) - angles)[inside]
    assert over[:, :2].max() < 1.5
    assert over[:, 2].max() < 6  # it turns at 8 °/s where the gap begins
    assert np.degrees(np.abs(smoothed.residuals.attitude)).max() < 0.05


def test_lines_without_attitude_are_a_gap_of_it(swaying_file):
    path = swaying_file(60.0)
    lines = path.read_text().splitlines()
    lines[81:161] = [",".join([*line.split(",")[:4], "", "", ""]) for line in lines[81:161]]
    path.write_text("\n".join(lines) + "\n")
    smoothed = smooth(path)
    assert not smoothed.trajectory.notes[0].startswith("mended in own.csv: gap")
    _, _, angles = sampled(smoothed)
    assert np.abs(angles[:, 0]).max() < 7


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 170.0])
def test_the_heading_along_the_track_does_not_follow_the_path_made_up_in_a_gap(record, turn_deg):
    t = np.arange(0, 90, 0.25)
    turn = np.radians(turn_deg)
    later = np.maximum(t - 60, 0)
    # North for 30 s; 30 s later it is where it was, and leaves in another direction.
    north = np.where(t < 30, 10 * t, 300 + 10 * later * np.cos(turn))
    path = record(10 * later * np.sin(turn), north)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:120], *lines[241:]]) + "\n")
    smoothed = smooth(path)
    _, _, angles = sampled(smoothed)
    heading = angles[:, 2] - angles[0, 2]
    assert heading.min() > -1
    assert heading.max() < turn_deg + 1
    assert heading[-1] == pytest.approx(turn_deg, abs=1)
    assert np.abs(angles[:, :2]).max() < 0.1
    assert not any("reversing" in note for note in smoothed.trajectory.notes)


@pytest.mark.parametrize("interval_s", [1.0, 4.1, 7.7])
def test_a_file_of_few_samples_is_no_row_of_gaps(record, interval_s):
    t = np.arange(0, 400, interval_s)
    angle = t / 100  # a bend of 1 km
    path = record(1000 * (1 - np.cos(angle)), 1000 * np.sin(angle), step_s=interval_s)
    smoothed = smooth(path)
    times, _, angles = sampled(smoothed)
    inside = (times > smoothed.residuals.time_s[1]) & (times < smoothed.residuals.time_s[-2])
    expected = np.degrees(times - smoothed.residuals.time_s[0]) / 100
    off = (angles[:, 2] - expected + 180) % 360 - 180
    assert np.abs(off[inside]).max() < 2


@pytest.mark.parametrize("speed", [20, 400, 600, 2500])
def test_a_run_neither_reverses_nor_overshoots_at_any_speed(record, speed):
    t = np.arange(0, 30, 0.25)
    smoothed = smooth(record(speed * t, 0 * t), speed_limit_mps=3000)
    _, velocity, angles = sampled(smoothed)
    assert velocity[:, 0].min() > -0.05
    assert velocity[:, 0].max() < 1.006 * speed
    assert np.abs(velocity[:, 1]).max() < 0.01 * speed  # the parallel bends off
    assert np.ptp(angles[:, 2]) < 1
    assert smoothed.trajectory.duration_s == pytest.approx(30 + 2 * speed, rel=0.05)


def test_a_fast_climb_does_not_begin_far_below_the_ground(record):
    t = np.arange(0, 60, 0.25)
    path = record(300 * t, 0 * t, up=2000 + 50 * t)
    state = smooth(path, speed_limit_mps=1000).trajectory
    height = state.at(np.arange(0, state.duration_s, 0.5))[:, 8]
    assert height[0] == pytest.approx(2000 - 50 * 50 / 2, abs=30)
    assert (np.diff(height) > -0.1).all()
