"""The clock that SYNC disciplines: locks, holds its rate, notices loss and jumps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.firmware_py.core.frames_in import clock
from rrins.firmware_py.core.records.memory import Clock

PERIOD = 5_000_000


class Disciplined:
    """A clock with a SYNC that arrives by a clock off by some ppm, with jitter."""

    def __init__(self, ppm=0.0, jitter_ns=0, start_ns=123_456_789):
        self.clock = np.zeros(1, dtype=Clock.dtype)[0]
        clock.power_on(self.clock, PERIOD)
        self.period = PERIOD * (1 + ppm * 1e-6)
        self.start, self.jitter = start_ns, jitter_ns
        self.random = np.random.default_rng(1)
        self.epoch = 0

    def arrival(self, epoch):
        return self.start + round(epoch * self.period)

    def run(self, epochs, sync=True, late_ns=0):
        """Run epochs; return how far off each predicted arrival was."""
        errors = []
        for _ in range(epochs):
            self.clock["sync_seen"] = sync
            if sync:
                jitter = int(self.random.uniform(-self.jitter, self.jitter))
                self.clock["sync_arrival_ns"] = self.arrival(self.epoch) + late_ns + jitter
                clock.synchronise(self.clock, 0)
            clock.advance(self.clock)
            self.epoch += 1
            errors.append(int(self.clock["next_sync_ns"]) - self.arrival(self.epoch))
        return np.array(errors)

    @property
    def ppm(self):
        return clock.error_ppm(self.clock, PERIOD)


def test_the_first_sync_is_taken_as_it_is():
    bench = Disciplined()
    assert bench.run(1)[0] == 0
    assert bench.clock["synchronised"]
    assert bench.clock["jumps"] == 0


@settings(max_examples=8)
@given(st.floats(-1000, 1000), st.integers(-(10**15), 10**15))
def test_it_learns_the_rate_of_sync(ppm, start_ns):
    bench = Disciplined(ppm, start_ns=start_ns)
    errors = bench.run(2000)
    assert bench.ppm == pytest.approx(ppm, abs=0.05)
    assert np.abs(errors[-100:]).max() <= 30
    assert np.abs(errors).max() < 100_000  # a hundredth of the allowed half period and less
    assert bench.clock["jumps"] == 0


@pytest.mark.parametrize("ppm", [-1000, 300, 1000])
def test_it_holds_the_rate_without_sync(ppm):
    bench = Disciplined(ppm)
    bench.run(2000)
    error = bench.run(1000, sync=False)[-1]
    assert abs(error) < 0.05e-6 * 1000 * PERIOD + 30
    assert bench.run(1)[0] == pytest.approx(error, abs=abs(error) / 2 + 5)
    assert bench.clock["jumps"] == 0


def test_sync_is_lost_after_ten_epochs_without_it():
    bench = Disciplined()
    bench.run(5)
    lost = []
    for _ in range(12):
        bench.run(1, sync=False)
        lost.append(bool(bench.clock["sync_lost"]))
    assert lost == [False] * 9 + [True] * 3
    bench.run(1)
    assert not bench.clock["sync_lost"]
    assert bench.clock["sync_missed"] == 0


@pytest.mark.parametrize("jump_ns", [2_600_000, -2_600_000, 10**9])
def test_a_phase_that_has_jumped_is_taken_over_and_counted_once(jump_ns):
    bench = Disciplined()
    bench.run(100)
    errors = bench.run(20, late_ns=jump_ns)
    assert errors[-1] == pytest.approx(jump_ns, abs=2)
    assert bench.clock["jumps"] == 1
    assert abs(bench.ppm) < 0.01


@pytest.mark.parametrize("late_ns", [2_400_000, 2_600_000, 10**9])
def test_a_single_late_arrival_hardly_moves_the_clock(late_ns):
    bench = Disciplined()
    bench.run(100)
    errors = bench.run(1, late_ns=late_ns)
    assert 0 <= errors[0] < PERIOD / 200
    assert abs(bench.ppm) < 100
    assert np.abs(bench.run(400)[-1]) < 100
    assert bench.clock["jumps"] == 0


def test_a_sync_of_an_epoch_before_is_compared_with_its_own_time():
    bench = Disciplined()
    bench.run(100)
    bench.clock["sync_arrival_ns"] = bench.arrival(98)
    before = int(bench.clock["next_sync_ns"])
    clock.synchronise(bench.clock, 2)
    assert bench.clock["next_sync_ns"] == pytest.approx(before, abs=2)
    assert bench.clock["jumps"] == 0


def test_fractions_of_a_nanosecond_are_not_lost():
    bench = Disciplined()
    bench.run(1)
    bench.clock["period_q16"] += 1 << 14  # a quarter of a nanosecond
    assert bench.run(4000, sync=False)[-1] == pytest.approx(1000, abs=1)
