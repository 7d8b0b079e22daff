"""The emulated GNSS receiver: what it sends, when, and how far from the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault
from rrins.host_tools.hardware.settings import (
    MotionPieces,
    PlannedFault,
    body_to_navigation,
)
from rrins.host_tools.hardware.tables import GnssReceiver
from rrins.host_tools.motion.drive import synthetic_drive
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE

GROUP = ("GNSS_TIME", "GNSS_LATITUDE", "GNSS_LONGITUDE", "GNSS_HEIGHT", "GNSS_VELOCITY")
IDEAL = {"rate_hz": 1, "position_noise_m": 0, "velocity_noise_mps": 0}
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


def every_epoch(**keys):
    """Return a receiver far faster than a scenario may have."""
    values = IDEAL | {"rate_hz": 200, "latency_s": 0.0} | keys
    return GnssReceiver.model_construct(**values)


def test_without_a_receiver_nothing_is_sent(tools):
    assert groups(tools.Bench(), 450) == {}


def test_a_fix_is_one_group_some_epochs_after_it_was_valid(tools):
    bench = tools.Bench(gnss=GnssReceiver(**IDEAL, latency_s=0.1))
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
    receiver = every_epoch(position_noise_m=1.5, velocity_noise_mps=0.05)
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
    receiver = GnssReceiver(rate_hz=10, position_noise_m=0, latency_s=0)
    broken = groups(tools.Bench(gnss=receiver, gnss_outages=((60, 99),)), 240)
    whole = groups(tools.Bench(gnss=receiver), 240)
    assert list(whole) == list(broken)
    for epoch, group in broken.items():
        if 60 <= epoch <= 99:
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
    receiver = every_epoch(position_correlated_noise_m=3.0, position_correlation_s=0.02)
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
    receiver = every_epoch(position_noise_m=3.0, position_correlated_noise_m=4.0)
    found = groups(tools.Bench(gnss=receiver), 3).values()
    assert {frame["GNSS_TIME"]["position_sigma"] for frame in found} == {5.0}


def faulty(tools, *planned):
    bench = tools.Bench(gnss=GnssReceiver(**IDEAL | {"rate_hz": 10}, latency_s=0), faults=planned)
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


def in_space(latitude_deg, longitude_deg, height):
    """Return the place in the Earth-fixed frame, and its local frame (rows east, north, up)."""
    a, e2 = 6378137.0, 6.69437999014e-3
    phi, lam = np.radians(latitude_deg), np.radians(longitude_deg)
    sp, cp, sl, cl = np.sin(phi), np.cos(phi), np.sin(lam), np.cos(lam)
    n = a / np.sqrt(1 - e2 * sp**2)
    place = np.stack([(n + height) * cp * cl, (n + height) * cp * sl, (n * (1 - e2) + height) * sp])
    zero = np.zeros_like(sp)
    axes = [[-sl, cl, zero], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]]
    return place.T, np.moveaxis(np.array(axes), 2, 0)


def antenna_in_space(drive, times_s, arm):
    """Return where the antenna is in the Earth-fixed frame, m, by pose and arm."""
    rows = drive.at(times_s)
    lat, lon, height = rows[:, PLACE].T
    place, local = in_space(np.degrees(lat), np.degrees(lon), height)
    arms_n = np.array([body_to_navigation(*angles) @ arm for angles in rows[:, ATTITUDE]])
    return place + np.einsum("kin,ki->kn", local, arms_n)


@pytest.mark.parametrize("latitude_deg", [40.0, 83.0])
def test_it_measures_where_its_antenna_is(tools, latitude_deg):
    """Beside the Earth-fixed frame, in which there is no latitude; the way covered counts, too."""
    base = np.array([math.radians(latitude_deg), math.radians(116), 40.0, 0.0, 0.0, 0.7])
    drive, arm = synthetic_drive(60, 5, base, 5_000_000), np.array([3.0, -9.0, 2.0])
    motion = MotionPieces(drive.pieces, drive.knot_ns // 5_000_000, 0)
    receiver = GnssReceiver(**IDEAL | {"rate_hz": 10}, latency_s=0, lever_arm_m=tuple(arm))
    found = groups(tools.Bench(gnss=receiver, motion=motion), 12_000)
    frames, times_s = list(found.values())[1:], np.array(list(found)[1:]) * 0.005
    latitudes, longitudes, heights = (
        np.array([frame[message][signal] for frame in frames])
        for message, signal in (
            ("GNSS_LATITUDE", "latitude_deg"),
            ("GNSS_LONGITUDE", "longitude_deg"),
            ("GNSS_HEIGHT", "height"),
        )
    )
    place, local = in_space(latitudes, longitudes, heights)
    np.testing.assert_allclose(place, antenna_in_space(drive, times_s, arm), atol=2e-3)
    way = antenna_in_space(drive, times_s + 5e-3, arm) - antenna_in_space(
        drive, times_s - 5e-3, arm
    )
    velocity_n = np.einsum("kni,ki->kn", local, way / 0.01)
    told = [
        (*(frame["GNSS_VELOCITY"][f"velocity_{axis}"] for axis in ("east", "north")),
         frame["GNSS_HEIGHT"]["velocity_up"])
        for frame in frames
    ]  # fmt: skip
    np.testing.assert_allclose(told, velocity_n, atol=1.5e-4)
