"""Transfers of a master as the firmware takes them: whole groups of this epoch, and their time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.core.records.troubles import Status

GROUP = (
    "MASTER_TIME",
    "MASTER_LEVEL",
    "MASTER_HEADING",
    "MASTER_LATITUDE",
    "MASTER_LONGITUDE",
    "MASTER_HEIGHT",
    "MASTER_VELOCITY",
    "MASTER_SIGMA",
)
ANGLE_STEPS = 2**26 / 360  # of roll and pitch, per degree
SAID = {
    "MASTER_TIME": {"valid": 1, "level_sigma": 180_00},
    "MASTER_LEVEL": {
        "master_roll_deg": round(-2 * ANGLE_STEPS),
        "master_pitch_deg": round(3 * ANGLE_STEPS),
    },
    "MASTER_HEADING": {
        "master_heading_deg": round(350 * 4 * ANGLE_STEPS),
        "heading_sigma": 1800_00,
    },
    "MASTER_LATITUDE": {"latitude_deg": 40_000_000_001},
    "MASTER_LONGITUDE": {"longitude_deg": -116_000_000_001},
    "MASTER_HEIGHT": {"height": 1_234_567, "velocity_up": -1_2345},
    "MASTER_VELOCITY": {"velocity_east": 12_34567, "velocity_north": -7_65432},
    "MASTER_SIGMA": {"velocity_sigma": 500, "position_sigma": 20_000},
}
ARCSEC = math.radians(1) / 3600


class Beside:
    """A bench with a master beside it, whose groups are made by hand."""

    def __init__(self, tools, first=0, **changes):
        self.tools = tools
        self.bench = tools.Bench(**{"initial_attitude": "transferred"} | changes)
        self.bench.epoch = first
        for _ in range(3):
            self.bench.step()

    @property
    def master(self):
        return self.bench.state["master"]

    def group(self, age_us=25_000, **changes):
        epoch = self.bench.epoch
        values = {name: SAID[name] | changes.get(name, {}) for name in GROUP}
        time_us = (epoch * 5000 - age_us) % 2**28
        values["MASTER_TIME"] = {"time_us": time_us} | values["MASTER_TIME"]
        return [self.tools.frame(name, epoch, **values[name]) for name in GROUP]

    def step(self, group=(), request=None):
        """Step on an epoch's frames and those of a group; return whether a transfer was taken."""
        before = int(self.master["transfers"])
        frames = self.bench.frames(self.bench.epoch, request)
        self.bench.step([*frames, *group])
        return self.master["transfers"] > before


@pytest.fixture
def beside(tools):
    return Beside(tools)


def test_a_whole_group_is_a_transfer_of_a_time_before(beside):
    epoch = beside.bench.epoch
    assert beside.step(beside.group(age_us=26_500))
    master = beside.master
    assert (master["epoch"], master["before_end_ns"]) == (epoch - 5, 1_500_000)
    assert np.degrees([master["roll"], master["pitch"]]) == pytest.approx([-2, 3], abs=3e-6)
    assert math.degrees(master["heading"]) == pytest.approx(350, abs=7e-7)
    assert math.degrees(master["latitude"]) == pytest.approx(40.000000001, abs=1e-12)
    assert math.degrees(master["longitude"]) == pytest.approx(-116.000000001, abs=1e-12)
    assert master["height"] == pytest.approx(1234.567)
    assert list(master["velocity_n"]) == pytest.approx([12.34567, -7.65432, -1.2345])
    sigmas = [master["level_sigma"] / ARCSEC, master["heading_sigma"] / ARCSEC]
    assert sigmas == pytest.approx([180, 1800])
    assert (master["velocity_sigma"], master["position_sigma"]) == pytest.approx((0.5, 20))
    assert not beside.step()


def test_what_is_old_or_not_valid_is_not_taken(beside):
    assert not beside.step(beside.group(age_us=2_100_000))
    assert not beside.step(beside.group(age_us=-10_000))
    assert beside.master["too_old"] == 2
    assert not beside.step(beside.group(MASTER_TIME={"valid": 0}))
    assert beside.step(beside.group(age_us=1_990_000))


def test_without_a_start_by_transfer_its_frames_mean_nothing(tools):
    beside = Beside(tools, initial_attitude="given")
    assert not beside.step(beside.group())
    beside.bench.run_to(Mode.NAVIGATION_STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)


RATE_DPS = 20.0


def turning(tools, **changes):
    """Return a bench whose vehicle turns to the left, about up, at a place without velocity."""
    beside = Beside(tools, **changes)
    bench = beside.bench
    scale = tools.scale_of("SENSOR_1", "gyro_dtheta")
    H = np.array(bench.state["gyros"]["H"])[:4]
    bench._gyro = bench._gyro + H @ [0, 0, math.radians(RATE_DPS) * 0.005] / scale
    return beside


def said_of_turn(beside, age_us, **changes):
    """Return a group that is right for a heading of 90° at the end of the bench's epoch 0."""
    heading_deg = 90 - RATE_DPS * (beside.bench.epoch * 0.005 - age_us * 1e-6)
    still = {
        "MASTER_LEVEL": {"master_roll_deg": 0, "master_pitch_deg": 0},
        "MASTER_HEADING": {"master_heading_deg": round(heading_deg % 360 * 4 * ANGLE_STEPS)},
        "MASTER_VELOCITY": {"velocity_east": 0, "velocity_north": 0},
        "MASTER_HEIGHT": {"height": 40_000, "velocity_up": 0},
    }
    return beside.group(age_us=age_us, **still | changes)


@pytest.mark.parametrize("age_us", [0, 500_000, 503_100, 1_999_900])
def test_the_attitude_is_carried_from_its_time_of_validity(tools, age_us):
    beside = turning(tools, alignment_s=0.1)
    for _ in range(420):
        beside.step()
    beside.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    while beside.bench.mode != Mode.ALIGNMENT:
        beside.step()
    assert beside.step(said_of_turn(beside, age_us))
    while beside.bench.mode == Mode.ALIGNMENT:
        beside.step()
    beside.step()
    found = math.degrees(beside.bench.state["navigation"]["heading"])
    expected = (90 - RATE_DPS * (beside.bench.epoch - 1) * 0.005) % 360
    assert (found - expected) * 3600 == pytest.approx(0.0, abs=0.1)  # ″, of 20 °/s


def test_an_alignment_waits_for_a_transfer_and_says_so(tools):
    beside = turning(tools, alignment_s=0.1)
    beside.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    for k in range(400):
        group = said_of_turn(beside, 100_000) if k % 50 == 0 else []
        beside.step(group[:7])
    assert beside.bench.mode == Mode.ALIGNMENT
    found = beside.bench.firmware.diagnostics.faults.by_mask(Status.TEST_FAILED)
    assert "alignment_not_converged" in {trouble.name for trouble, _ in found}
    beside.step(said_of_turn(beside, 100_000))
    beside.step()
    assert beside.bench.mode == Mode.NAVIGATION_STRAPDOWN


def test_a_transfer_that_has_become_old_is_not_used(tools):
    beside = turning(tools, alignment_s=0.1)
    beside.step(said_of_turn(beside, 0), request=ModeRequest.ALIGN)
    for _ in range(1900):
        beside.step()
    assert beside.bench.state["alignment"]["done"]
    for _ in range(200):
        beside.step()
    assert not beside.bench.state["alignment"]["done"]
    beside.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    beside.step()
    assert beside.bench.mode == Mode.ALIGNMENT


def test_the_filter_begins_with_the_sigmas_of_the_master(tools):
    beside = turning(tools, alignment_s=0.1)
    beside.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    while beside.bench.mode != Mode.ALIGNMENT:
        beside.step()
    for _ in range(30):
        beside.step(said_of_turn(beside, 0))
    estimator = beside.bench.state["estimator"]
    assert np.array(estimator["attitude_sigma"]) / ARCSEC == pytest.approx([180, 180, 1800])
    assert estimator["velocity_sigma"] == pytest.approx(0.5, rel=1e-3)
    assert estimator["start_sigma"] == pytest.approx(20, rel=1e-3)
