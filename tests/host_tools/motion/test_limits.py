"""Impossible motion is refused, in one line that names the place."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.motion.build import follow, load_recording
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.scenario.motion import Motion


def refusal(path, **keys):
    motion = Motion(kind="file", path=str(path), **keys)
    with pytest.raises(MotionError) as caught:
        follow(load_recording(motion, path.parent), motion, 5_000_000)
    assert caught.value.exit_status == 9
    message = str(caught.value)
    assert "\n" not in message
    return message


T = np.arange(0, 40, 0.25)
LEVEL = {"roll_deg": 0 * T, "pitch_deg": 0 * T, "heading_deg": 0 * T}


def test_an_angle_that_jumps(record):
    roll = np.where(T == 20, 120.0, 0.0)
    message = refusal(record(0 * T, 0 * T, **(LEVEL | {"roll_deg": roll})))
    assert "own.csv: near line 8" in message
    assert "turns at" in message
    assert "at most 400" in message


def test_a_force_of_more_than_20_g(record):
    path = record(250 * np.sin(T), 250 * np.cos(T), **LEVEL)
    message = refusal(path, speed_limit_mps=1000, jerk_density_mps3_per_sqrt_hz=1000)
    assert "feels" in message
    assert "m/s², at most 200" in message


def test_a_pitch_beyond_85_degrees(record):
    # Within 80° in the file, but the smooth curve through it is not.
    away = np.abs(T - 19.25)
    pitch = np.where(away < 1.25, np.nan, np.maximum(78 - 20 * (away - 1.25), 0))
    path = record(0 * T, 0 * T, **(LEVEL | {"pitch_deg": pitch}))
    path.write_text(path.read_text().replace("nan", ""))
    assert "pitches to" in refusal(path)


def test_a_run_up_from_below_the_ground(record):
    path = record(500 * T, 0 * T, up=100 + 90 * T)
    message = refusal(path, speed_limit_mps=1000)
    assert "run-up before line 2: the smoothed vehicle is" in message
    assert "must be -1,000 to 100,000" in message
