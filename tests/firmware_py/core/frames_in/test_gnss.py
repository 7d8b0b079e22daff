"""GNSS fixes as the firmware takes them: whole groups of this epoch, mapped to their epoch."""

from __future__ import annotations

import math

import numpy as np
import pytest

INTERVAL = 20  # epochs of 5 ms
GROUP = ("GNSS_TIME", "GNSS_LATITUDE", "GNSS_LONGITUDE", "GNSS_HEIGHT", "GNSS_VELOCITY")
FIX = {
    "GNSS_TIME": {"quality": 2, "position_sigma": 150, "velocity_sigma": 5},
    "GNSS_LATITUDE": {"latitude_deg": 40_000_000_001},
    "GNSS_LONGITUDE": {"longitude_deg": -116_000_000_001},
    "GNSS_HEIGHT": {"height": 1_234_567, "velocity_up": -1_2345},
    "GNSS_VELOCITY": {"velocity_east": 12_34567, "velocity_north": -7_65432},
}


class Receiver:
    """A bench with a receiver whose groups are made by hand."""

    def __init__(self, tools, first=0, **changes):
        self.tools = tools
        self.bench = tools.Bench(**{"gnss_interval_s": INTERVAL * 0.005} | changes)
        self.bench.epoch = first
        for _ in range(3):
            self.bench.step()

    @property
    def gnss(self):
        return self.bench.state["gnss"]

    def group(self, age_us=25_000, **changes):
        epoch = self.bench.epoch
        time_us = (epoch * 5000 - age_us) % 2**28
        values = {name: FIX[name] | changes.get(name, {}) for name in GROUP}
        values["GNSS_TIME"] = {"time_us": time_us} | values["GNSS_TIME"]
        return [self.tools.frame(name, epoch, **values[name]) for name in GROUP]

    def step(self, group=()):
        """Step on an epoch's frames and those of a group; return whether a fix was taken."""
        frames = self.bench.frames(self.bench.epoch)
        self.bench.step([*frames, *group])
        return bool(self.gnss["fresh"])


@pytest.fixture
def receiver(tools):
    return Receiver(tools)


def test_a_whole_group_is_a_fix_of_an_epoch_before(receiver):
    epoch = receiver.bench.epoch
    assert receiver.step(receiver.group())
    gnss = receiver.gnss
    assert (gnss["epoch"], gnss["age_epochs"], gnss["fixes"]) == (epoch - 5, 5, 1)
    assert gnss["available"]
    assert math.degrees(gnss["latitude"]) == pytest.approx(40.000000001, abs=1e-12)
    assert math.degrees(gnss["longitude"]) == pytest.approx(-116.000000001, abs=1e-12)
    assert gnss["height"] == pytest.approx(1234.567)
    assert list(gnss["velocity_n"]) == pytest.approx([12.34567, -7.65432, -1.2345])
    assert (gnss["position_sigma"], gnss["velocity_sigma"]) == pytest.approx((1.5, 0.05))
    assert not receiver.step()


@pytest.mark.parametrize("part", range(5))
def test_of_an_incomplete_or_harmed_group_nothing_is_taken(receiver, part):
    group = receiver.group()
    assert not receiver.step([*group[:part], *group[part + 1 :]])
    harmed = receiver.group()
    harmed[part]["data"] ^= np.uint64(1 << 40)
    assert not receiver.step(harmed)
    assert receiver.bench.state["faults"]["crc_errors"] == 1
    mixed = receiver.group()
    mixed[part] = group[part]  # of an epoch before
    assert not receiver.step(mixed)
    assert receiver.bench.state["faults"]["counter_errors"] == 1
    assert receiver.step(receiver.group())


def test_of_two_groups_that_disagree_none_is_taken(receiver):
    other = receiver.group(GNSS_VELOCITY={"velocity_east": 0})
    assert not receiver.step([*receiver.group(), *other])
    group = receiver.group()
    assert receiver.step([*group, *group])


def test_validity_is_found_across_the_wrap_of_its_clock(tools):
    wrap = -(-(2**28) // 5000)  # first epoch after it
    receiver = Receiver(tools, first=wrap - 3)
    assert receiver.step(receiver.group(age_us=500_000))
    assert receiver.gnss["epoch"] == wrap - 100


def test_an_old_fix_is_not_used(receiver):
    assert not receiver.step(receiver.group(age_us=2_100_000))
    assert not receiver.step(receiver.group(age_us=-10_000))
    assert receiver.gnss["too_old"] == 2
    assert receiver.step(receiver.group(age_us=1_990_000))


def test_fixes_are_lost_and_come_back(receiver):
    receiver.step(receiver.group(age_us=0))
    steps = 0
    while receiver.gnss["available"]:
        receiver.step(receiver.group(GNSS_TIME={"quality": 0}))
        steps += 1
    assert steps == 3 * INTERVAL + 1
    assert receiver.gnss["losses"] == 1
    assert receiver.gnss["silent_epochs"] == 0
    receiver.step(receiver.group())
    assert receiver.gnss["available"]
    assert receiver.gnss["losses"] == 1


def test_without_a_receiver_its_frames_mean_nothing(tools):
    receiver = Receiver(tools, gnss_interval_s=0.0)
    assert not receiver.step(receiver.group())
    assert receiver.gnss["fixes"] == 0
