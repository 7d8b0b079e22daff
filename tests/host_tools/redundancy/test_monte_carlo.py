"""Whole runs agree with the theory."""

from __future__ import annotations

import math
import threading

import pytest

from rrins.host_tools.redundancy.candidates import candidates_of
from rrins.host_tools.redundancy.monte_carlo import Delays, Fault, run_trials
from rrins.host_tools.redundancy.sensor_kinds import KINDS
from rrins.host_tools.redundancy.theory import HALF, LEARNED_S, Finder

GYROS, ACCELEROMETERS = KINDS
FOUR = (0, 1, 2, 3)


def test_a_quantile_of_delays_counts_those_that_never_ended():
    delays = Delays(alarm=[1.0, 2.0, math.inf])
    assert delays.quantile("alarm", 0.5) == 2.0
    assert delays.quantile("alarm", 0.95) == math.inf


def test_each_fault_is_found_and_the_right_sensor_named():
    (candidate,) = candidates_of(None, ["tetrahedron"])
    tried = [Fault(GYROS, FOUR, 50.0), Fault(ACCELEROMETERS, FOUR, 5000.0)]
    done = []
    trials = run_trials(candidate.scenario, tried, 2, on_done=lambda: done.append(1))
    assert (len(done), trials.alarms) == (2, 0)
    assert trials.sound_h == pytest.approx(2 * LEARNED_S / 3600)
    for fault in tried:
        delays = trials.delays[fault]
        assert (delays.right, delays.wrong) == (2, 0)  # at rest; in motion nobody is named
        assert max(delays.alarm) < 0.1
        assert max(delays.standing) < 2.5
        assert min(delays.parity) == math.inf


@pytest.mark.slow
def test_six_sensors_name_it_by_the_parity_alone():
    (candidate,) = candidates_of(None, ["dodecahedron"])
    fault = Fault(GYROS, (1, 2, 3, 4, 5), 20.0)  # the first looks like all alike
    delays = run_trials(candidate.scenario, [fault], 2).delays[fault]
    assert (delays.right, delays.wrong) == (4, 0)
    assert max(delays.parity) < 2.5


@pytest.mark.slow
@pytest.mark.parametrize("runs", [5, pytest.param(16, marks=pytest.mark.soak)])
def test_the_median_is_that_of_the_theory(runs):
    (candidate,) = candidates_of(None, ["tetrahedron"])
    tried = [Fault(GYROS, FOUR, size) for size in (2.0, 10.0)]
    found = run_trials(candidate.scenario, tried, runs).delays
    finder = Finder(candidate.scenario, GYROS)
    for fault, delays in found.items():
        chances = finder.chances(0, fault.size)
        for way in ("alarm", "standing"):
            expected = chances.delay_s(way, HALF)
            assert 0.5 * expected - 0.1 < delays.quantile(way, HALF) < 1.6 * expected + 0.1
        assert delays.wrong == 0


def test_it_ends_when_told():
    (candidate,) = candidates_of(None, ["tetrahedron"])
    stop = threading.Event()
    stop.set()
    trials = run_trials(candidate.scenario, [Fault(GYROS, FOUR, 1.0)], 3, stop=stop)
    assert not trials.delays[Fault(GYROS, FOUR, 1.0)].alarm
