"""The synthetic drive: a car on a road, the same from the same seed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.scenario.tables import Body

TIMES = np.arange(0, 2500, 0.05)


@pytest.fixture(scope="module")
def state(drive):
    return drive.at(TIMES)


def test_it_starts_turns_climbs_and_stops(drive, state):
    assert drive.duration_s == 2500
    speed = np.linalg.norm(state[:, 9:12], axis=1)
    assert 15 < speed.max() < 20.5
    standing = speed < 1e-6
    stops = np.flatnonzero(np.diff(standing.astype(int)) == 1)
    assert len(stops) > 5
    heading = np.degrees(state[:, 14])
    turned = heading[200:] - heading[:-200]  # within 10 s
    assert turned.max() > 60
    assert turned.min() < -60
    assert np.ptp(state[:, 8]) > 20
    assert np.degrees(np.abs(state[:, 12:14]).max()) < 10


def test_accelerations_are_those_of_a_car(state):
    velocity = state[:, 9:12]
    acceleration = np.linalg.norm(np.diff(velocity, axis=0) / 0.05, axis=1)
    assert 1.5 < acceleration.max() < 3
    assert np.abs(state[:, 3]).max() < 3
    assert np.abs(state[:, 5] - 9.8).max() < 0.5


def test_the_car_goes_where_it_looks(state):
    east, north, up = state[:, 9:12].T
    speed = np.hypot(east, north)
    moving = speed > 2
    course = np.arctan2(east, north)
    slip = (course - state[:, 14] + math.pi) % (2 * math.pi) - math.pi
    assert np.degrees(np.abs(slip[moving]).max()) < 0.05
    climb = np.arctan2(up, speed) - state[:, 13]
    assert np.degrees(np.abs(climb[moving]).max()) < 1  # it nods


def test_it_begins_at_the_place_and_attitude_it_is_given(make):
    drive = make(kind="drive", duration_s=60, body=Body(roll_deg=1, pitch_deg=-2, heading_deg=200))
    begin = drive.at(np.array([0.0]))[0]
    assert np.degrees(begin[6:8]) == pytest.approx([40.3554, 116.668], abs=1e-12)
    assert begin[8] == 40
    assert np.degrees(begin[12:15]) == pytest.approx([1, -2, 200])
    east, north = drive.at(np.array([20.0]))[0, 9:11]
    assert math.degrees(math.atan2(east, north)) % 360 == pytest.approx(200, abs=0.1)


def test_the_seed_makes_the_route(make):
    first, same, other = (
        make(kind="drive", duration_s=200, seed=seed).pieces for seed in (5, 5, 6)
    )
    assert (first == same).all()
    assert not np.allclose(first, other)


@pytest.mark.parametrize("duration_s", [30, 47.3, 100, 600])
@pytest.mark.parametrize("period_ns", [20_000_000, 1_000_000])
def test_any_length_and_rate(make, duration_s, period_ns):
    drive = make(kind="drive", duration_s=duration_s, period_ns=period_ns)
    assert drive.duration_s == pytest.approx(duration_s, abs=0.15)
    assert not drive.pieces[-4:, :, 1:].any()
    assert np.linalg.norm(drive.at(np.arange(0, duration_s, 0.5))[:, 9:12], axis=1).max() > 3


def test_no_car_begins_with_its_nose_in_the_sky(make):
    with pytest.raises(MotionError, match="60°"):
        make(kind="drive", body=Body(pitch_deg=80))
