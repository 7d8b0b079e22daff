"""Distances as the firmware takes them: from one count of the odometer to the next."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.settings import OdometerSettings

INTERVAL = 20  # epochs of 5 ms
SET_UP = OdometerSettings(interval_s=INTERVAL * 0.005, metres_per_pulse=0.01)


class Wheel:
    """A bench with an odometer whose frames are made by hand."""

    def __init__(self, tools, odometer=SET_UP):
        self.tools = tools
        self.bench = tools.Bench(odometer=odometer)
        for _ in range(3):
            self.bench.step()

    @property
    def odometer(self):
        return self.bench.state["odometer"]

    def frame(self, pulses, valid=1, age_us=0):
        pulses %= 2**32
        return self.tools.frame(
            "ODOMETER", self.bench.epoch, valid=valid, age_us=age_us, pulses=pulses
        )

    def step(self, *frames):
        """Step on an epoch's frames and those of the odometer; return the distance, if one came."""
        self.bench.step([*self.bench.frames(self.bench.epoch), *frames])
        return float(self.odometer["distance"]) if self.odometer["fresh"] else None

    def go(self, epochs):
        for _ in range(epochs):
            assert self.step() is None

    def count(self, pulses, **values):
        """Step an interval, and on a count at its end; return the distance, if one came."""
        self.go(INTERVAL - 1)
        return self.step(self.frame(pulses, **values))


@pytest.fixture
def wheel(tools):
    return Wheel(tools)


def test_a_distance_is_from_count_to_count(wheel):
    assert wheel.count(1000) is None
    first = wheel.bench.epoch - 1
    assert wheel.count(1234) == pytest.approx(2.34)
    odometer = wheel.odometer
    assert (odometer["epoch_before"], odometer["epoch"]) == (first, first + INTERVAL)
    assert wheel.count(1200) == pytest.approx(-0.34)  # backwards
    assert odometer["travelled"] == pytest.approx(2.0)
    assert (odometer["available"], odometer["measurements"], odometer["gaps"]) == (True, 2, 0)


@pytest.mark.parametrize(("before", "after", "metres"), [(-5, 7, 0.12), (3, -4, -0.07)])
def test_the_count_wraps(wheel, before, after, metres):
    wheel.count(before)
    assert wheel.count(after) == pytest.approx(metres)


def test_it_held_an_age_before(wheel):
    wheel.count(0, age_us=15_000)
    epoch = wheel.bench.epoch - 1
    assert wheel.odometer["epoch"] == epoch - 3
    wheel.go(1)
    assert wheel.odometer["age_epochs"] == 4


def test_what_a_lost_frame_said_comes_with_the_next(wheel):
    wheel.count(0)
    wheel.go(INTERVAL)
    assert wheel.count(500) == pytest.approx(5.0)
    assert wheel.odometer["epoch"] - wheel.odometer["epoch_before"] == 2 * INTERVAL
    assert wheel.odometer["gaps"] == 0


def test_of_harmed_and_disagreeing_frames_nothing_is_taken(wheel):
    wheel.count(0)
    harmed = wheel.frame(10)
    harmed["data"] ^= np.uint64(1 << 40)
    assert wheel.step(harmed) is None
    assert wheel.bench.state["faults"]["crc_errors"] == 1
    stale = wheel.frame(10)
    wheel.go(1)
    assert wheel.step(stale) is None
    assert wheel.bench.state["faults"]["counter_errors"] == 1
    assert wheel.step(wheel.frame(10), wheel.frame(11)) is None
    frame = wheel.frame(20)
    assert wheel.step(frame, frame) == pytest.approx(0.2)


def test_after_a_time_without_counting_it_begins_anew(wheel):
    wheel.count(0)
    wheel.count(100)
    assert wheel.count(100, valid=0) is None
    assert not wheel.odometer["valid"]
    assert wheel.count(100, valid=0) is None
    assert wheel.count(150) is None
    assert wheel.count(170) == pytest.approx(0.2)
    assert (wheel.odometer["gaps"], wheel.odometer["travelled"]) == (1, pytest.approx(1.2))


def test_a_leap_is_not_used(wheel):
    wheel.count(0)
    assert wheel.count(2001) is None  # 200.1 m/s
    assert wheel.count(2101) == pytest.approx(1.0)
    assert (wheel.odometer["implausible"], wheel.odometer["gaps"]) == (1, 1)


def test_distances_are_lost_and_come_back(wheel):
    wheel.count(0)
    wheel.count(1)
    assert wheel.odometer["available"]
    wheel.go(5 * INTERVAL)
    assert wheel.odometer["available"]
    wheel.go(1)
    assert (wheel.odometer["available"], wheel.odometer["lost"]) == (False, True)
    wheel.step(wheel.frame(2))
    assert (wheel.odometer["available"], wheel.odometer["losses"]) == (True, 1)


def test_without_one_its_frames_mean_nothing(tools):
    wheel = Wheel(tools, odometer=None)
    wheel.step(wheel.frame(0))
    assert wheel.step(wheel.frame(10)) is None
    assert wheel.odometer["measurements"] == 0
