"""The emulated master: what it sends, when, and how far from the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware.master_settings import MasterSettings
from rrins.host_tools.hardware.settings import MotionPieces
from rrins.host_tools.motion.drive import synthetic_drive
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, VELOCITY_N

METRES_PER_DEG = 111_035  # of latitude at 40°, WGS-84
ARCSEC = math.radians(1) / 3600


def groups(bench, epochs):
    """Return what the master sends, by epoch, its signals in one dictionary."""
    found = {}
    for _ in range(epochs):
        epoch = bench.epoch
        sent = {k: v for k, v in bench.step().items() if k.startswith("MASTER")}
        if sent:
            assert len(sent) == 8
            assert {frame["alive_counter"] for frame in sent.values()} == {epoch % 15}
            found[epoch] = {k: v for frame in sent.values() for k, v in frame.items()}
    return found


def test_without_a_master_nothing_is_sent(tools):
    assert groups(tools.Bench(), 450) == {}


def test_a_transfer_is_the_truth_of_its_time_of_validity(tools):
    base = np.array([math.radians(40), math.radians(116), 40.0, 0.0, 0.0, 0.7])
    drive = synthetic_drive(60, 5, base, 5_000_000)
    motion = MotionPieces(drive.pieces, drive.knot_ns // 5_000_000, 0)
    master = MasterSettings(interval_epochs=200, latency_epochs=100)
    found = groups(tools.Bench(master=master, motion=motion), 6000)
    assert list(found) == list(range(100, 6000, 200))
    rows = drive.at((np.array(list(found)) - 100) * 0.005)
    for row, (epoch, said) in zip(rows, found.items(), strict=True):
        assert said["time_us"] == (epoch - 100) * 5000
        assert said["valid"] == 1
        attitude = [said["master_roll_deg"], said["master_pitch_deg"], said["master_heading_deg"]]
        off = (np.array(attitude) - np.degrees(row[ATTITUDE]) + 180) % 360 - 180
        assert np.abs(off).max() * 3600 < 0.01  # ″
        place = [said["latitude_deg"], said["longitude_deg"]]
        assert np.abs(place - np.degrees(row[PLACE][:2])).max() * METRES_PER_DEG < 1e-4
        assert said["height"] == pytest.approx(row[PLACE][2], abs=6e-4)
        velocity = [said["velocity_east"], said["velocity_north"], said["velocity_up"]]
        np.testing.assert_allclose(velocity, row[VELOCITY_N], atol=6e-5)
    assert np.hypot(*rows[:, VELOCITY_N][:, :2].T).max() > 5


def test_its_errors_last_and_its_sigmas_are_told(tools):
    master = MasterSettings(
        interval_epochs=20,
        attitude_error=(100 * ARCSEC, -200 * ARCSEC, -math.radians(3)),
        velocity_error=(0.1, -0.2, 0.3),
        position_error=(10, -20, 30),
        level_sigma=150 * ARCSEC,
        heading_sigma=1800 * ARCSEC,
        velocity_sigma=0.25,
        position_sigma=20,
    )
    found = groups(tools.Bench(master=master, heading_deg=1.0), 50)
    east_m = METRES_PER_DEG * math.cos(math.radians(40)) * 1.0034  # N / M, at 40°
    for said in found.values():
        assert said["master_roll_deg"] * 3600 == pytest.approx(100, abs=0.01)
        assert said["master_pitch_deg"] * 3600 == pytest.approx(-200, abs=0.01)
        assert said["master_heading_deg"] == pytest.approx(358)
        velocity = [said["velocity_east"], said["velocity_north"], said["velocity_up"]]
        assert velocity == pytest.approx([0.1, -0.2, 0.3])
        assert (said["longitude_deg"] - 116) * east_m == pytest.approx(10, abs=0.01)
        assert (said["latitude_deg"] - 40) * METRES_PER_DEG == pytest.approx(-20, abs=0.01)
        assert said["height"] == pytest.approx(70)
        assert (said["level_sigma"], said["heading_sigma"]) == pytest.approx((150, 1800))
        assert (said["velocity_sigma"], said["position_sigma"]) == pytest.approx((0.25, 20))


def test_an_error_may_lead_over_the_top(tools):
    master = MasterSettings(interval_epochs=20, attitude_error=(0.0, math.radians(2), 0.0))
    (said,) = groups(tools.Bench(master=master, pitch_deg=89.0, heading_deg=10.0), 5).values()
    attitude = [said["master_roll_deg"], said["master_pitch_deg"], said["master_heading_deg"]]
    assert np.mod(attitude, 360) == pytest.approx([180, 89, 190], abs=1e-5)


def test_in_an_outage_the_groups_go_on_and_are_not_valid(tools):
    master = MasterSettings(interval_epochs=10, outages=((50, 79),))
    for epoch, said in groups(tools.Bench(master=master), 200).items():
        assert said["valid"] == (not 50 <= epoch <= 79)
        assert said["time_us"] == epoch * 5000
