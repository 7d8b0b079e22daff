"""The emulated GNSS receiver: what it sends, when, and how far from the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault
from rrins.host_tools.hardware.settings import (
    GnssSettings,
    MotionPieces,
    PlannedFault,
    body_to_navigation,
)
from rrins.host_tools.motion.drive import synthetic_drive
from rrins.host_tools.motion.trajectory import ATTITUDE

GROUP = ("GNSS_TIME", "GNSS_LATITUDE", "GNSS_LONGITUDE", "GNSS_HEIGHT", "GNSS_VELOCITY")
METRES_PER_DEG = 111_035  # of latitude at 40°, WGS-84


def groups(bench, epochs):
    """Return what is sent by GNSS, by epoch."""
    found = {}
    for _ in range(epochs):
        epoch = bench.epoch
        sent = {k: v for k, v in bench.step().items() if k.startswith("GNSS")}
        if sent:
            found[epoch] = sent
    return found


def test_without_a_receiver_nothing_is_sent(tools):
    assert groups(tools.Bench(), 450) == {}


def test_a_fix_is_one_group_some_epochs_after_it_was_valid(tools):
    bench = tools.Bench(gnss=GnssSettings(interval_epochs=200, latency_epochs=20))
    found = groups(bench, 650)
    assert list(found) == [20, 220, 420, 620]
    for epoch, group in found.items():
        assert tuple(group) == GROUP
        assert {frame["alive_counter"] for frame in group.values()} == {epoch % 15}
        assert group["GNSS_TIME"]["time_us"] == (epoch - 20) * 5000
        assert group["GNSS_TIME"]["quality"] == 2
        assert group["GNSS_LATITUDE"]["latitude_deg"] == pytest.approx(40, abs=1e-9)
        assert group["GNSS_LONGITUDE"]["longitude_deg"] == pytest.approx(116, abs=1e-9)
        assert group["GNSS_HEIGHT"]["height"] == pytest.approx(40, abs=1e-3)
        assert group["GNSS_VELOCITY"]["velocity_north"] == 0


def test_its_noise_is_as_set_and_told(tools):
    receiver = GnssSettings(interval_epochs=1, position_noise=1.5, velocity_noise=0.05)
    found = groups(tools.Bench(gnss=receiver), 2000).values()
    assert {frame["GNSS_TIME"]["position_sigma"] for frame in found} == {1.5}
    assert {frame["GNSS_TIME"]["velocity_sigma"] for frame in found} == {0.05}
    east_m = METRES_PER_DEG * math.cos(math.radians(40))
    for message, signal, unit, sigma in (
        ("GNSS_LATITUDE", "latitude_deg", METRES_PER_DEG, 1.5),
        ("GNSS_LONGITUDE", "longitude_deg", east_m, 1.5),
        ("GNSS_HEIGHT", "height", 1, 1.5),
        ("GNSS_HEIGHT", "velocity_up", 1, 0.05),
        ("GNSS_VELOCITY", "velocity_east", 1, 0.05),
        ("GNSS_VELOCITY", "velocity_north", 1, 0.05),
    ):
        values = np.array([frame[message][signal] for frame in found]) * unit
        assert np.std(values) == pytest.approx(sigma, rel=0.06)  # 3 sigma are 5 %
        after = np.corrcoef(values[1:], values[:-1])[0, 1]
        assert abs(after) < 0.08  # 3 sigma are 0.067


def test_in_an_outage_the_groups_go_on_without_a_fix(tools):
    settings = {"interval_epochs": 10, "velocity_noise": 0.05}
    whole = groups(tools.Bench(gnss=GnssSettings(**settings)), 200)
    broken = groups(tools.Bench(gnss=GnssSettings(**settings, outages=((50, 79),))), 200)
    assert list(whole) == list(broken)
    for epoch, group in broken.items():
        if 50 <= epoch <= 79:
            assert group["GNSS_TIME"]["quality"] == 0
            assert group["GNSS_VELOCITY"]["velocity_east"] == 0
        else:
            assert group == whole[epoch]


def east_north_up(frames):
    """Return how far positions and velocities are off, m and m/s, shape (n, 6)."""
    east_m = METRES_PER_DEG * math.cos(math.radians(40)) * 1.0034  # N / M, at 40°
    return np.array(
        [
            [
                (group["GNSS_LONGITUDE"]["longitude_deg"] - 116) * east_m,
                (group["GNSS_LATITUDE"]["latitude_deg"] - 40) * METRES_PER_DEG,
                group["GNSS_HEIGHT"]["height"] - 40,
                group["GNSS_VELOCITY"]["velocity_east"],
                group["GNSS_VELOCITY"]["velocity_north"],
                group["GNSS_HEIGHT"]["velocity_up"],
            ]
            for group in frames
        ]
    )


def test_errors_that_last_are_of_first_order(tools):
    receiver = GnssSettings(interval_epochs=1, correlated_noise=3.0, correlation_epochs=4.0)
    found = groups(tools.Bench(gnss=receiver), 6000).values()
    assert {frame["GNSS_TIME"]["position_sigma"] for frame in found} == {3.0}
    off = east_north_up(found)
    assert not off[:, 3:].any()
    for values in off[:, :3].T:  # of 6000 values 750 are independent: 3 sigma are 8 %
        assert np.std(values) == pytest.approx(3.0, rel=0.1)
        for lag in (1, 4, 8):
            together = np.corrcoef(values[lag:], values[:-lag])[0, 1]
            assert together == pytest.approx(math.exp(-lag / 4), abs=0.1)
    assert abs(np.corrcoef(off[:, 0], off[:, 1])[0, 1]) < 0.12


def test_what_it_tells_is_the_sum_of_both(tools):
    settings = {"interval_epochs": 1, "position_noise": 3.0, "correlated_noise": 4.0}
    found = groups(tools.Bench(gnss=GnssSettings(**settings)), 3).values()
    assert {frame["GNSS_TIME"]["position_sigma"] for frame in found} == {5.0}


def faulty(tools, *planned):
    bench = tools.Bench(gnss=GnssSettings(interval_epochs=20), faults=planned)
    return groups(bench, 200)


def test_a_jump_moves_the_position_alone(tools):
    jump = PlannedFault(HardwareFault.GNSS_JUMP, 1, 50, 130, -100.0)
    off = east_north_up(faulty(tools, jump).values())
    expected = np.zeros((10, 6))
    expected[3:7, 1] = -100.0
    np.testing.assert_allclose(off, expected, atol=0.1)


def test_a_pull_leads_away_position_and_velocity(tools):
    pulls = (
        PlannedFault(HardwareFault.GNSS_PULL, 0, 60, 169, 2.0),
        PlannedFault(HardwareFault.GNSS_PULL, 2, 60, 169, -1.0),
    )
    found = faulty(tools, *pulls)
    off = east_north_up(found.values())
    for epoch, row in zip(found, off, strict=True):
        active = 60 <= epoch <= 169
        age_s = (epoch - 59) * 0.005 if active else 0.0
        expected = [2 * age_s, 0, -age_s, 2 * active, 0, -active]
        np.testing.assert_allclose(row, expected, atol=0.01)


def test_a_receiver_that_is_lost_has_no_fix(tools):
    found = faulty(tools, PlannedFault(HardwareFault.GNSS_LOST, EVERY, 50, 130))
    qualities = [group["GNSS_TIME"]["quality"] for group in found.values()]
    assert qualities == [2, 2, 2, 0, 0, 0, 0, 2, 2, 2]


def test_it_measures_where_its_antenna_is(tools):
    """Beside numpy: the arm turned by the attitude, and how that changes."""
    base = np.array([math.radians(40), math.radians(116), 40.0, 0.0, 0.0, 0.7])
    drive, arm = synthetic_drive(60, 5, base, 5_000_000), np.array([0.8, -2.5, 1.4])
    motion = MotionPieces(drive.pieces, drive.knot_ns // 5_000_000, 0)
    receivers = [GnssSettings(interval_epochs=20, lever_arm_b=b) for b in ((0, 0, 0), tuple(arm))]
    centre, antenna = (groups(tools.Bench(gnss=r, motion=motion), 12_000) for r in receivers)
    found = east_north_up(antenna.values()) - east_north_up(centre.values())
    rows = drive.at(np.array([(k + np.array([-1, 0, 1])) for k in antenna]).ravel() * 0.005)
    placed = np.array([body_to_navigation(*angles) @ arm for angles in rows[:, ATTITUDE]])
    placed = placed.reshape(-1, 3, 3)
    moving = (placed[:, 2] - placed[:, 0]) / 0.01
    assert np.abs(moving).max() > 0.5
    np.testing.assert_allclose(found[:, :3], placed[:, 1], atol=3e-3)  # the frames' millimetre
    np.testing.assert_allclose(found[1:, 3:], moving[1:], atol=1e-3)
