"""The lockstep shell and the firmware around its memory, without a bus."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import Frame
from rrins.firmware_py import loop
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.modes.modes import Mode, ModeRequest
from rrins.firmware_py.loop import Firmware, run_lockstep, run_realtime
from rrins.host_tools.runs.sides.realtime import LatenessHistogram


class ScriptedPort:
    """A port whose other side sends what a bench would, some epochs together, then a shutdown."""

    def __init__(self, bench, batches):
        self.bench, self.batches, self.sent = bench, list(batches), []
        self.epoch = 0

    def receive_epoch(self, into):
        size = self.batches.pop(0)
        frames = []
        for _ in range(size):
            request = ModeRequest.NAVIGATE_STRAPDOWN if self.batches else ModeRequest.SHUTDOWN
            frames += self.bench.frames(self.epoch, request)
            self.epoch += 1
        into[: len(frames)] = np.array(frames, dtype=Frame.dtype)
        return len(frames)

    def lend(self, direct):
        return False

    def send(self, frames, count, epoch, time_ns):
        self.sent.append((epoch, time_ns, frames[:count].tobytes()))


class TimedPort:
    """A port in virtual time, on a machine that stands still at times; the bench has a core of it.

    The bench sends an epoch each period; what a stall kept it from, it sends when it goes on.
    """

    PERIOD_NS, WORK_NS = 5_000_000, 300_000

    def __init__(self, bench, epochs, stalls, behind_ns):
        """Let both stand still for each `(begin_ns, length_ns)`, the bench `behind_ns` longer."""
        self.now_ns = 0
        self.stalls = [(begin, begin + length) for begin, length in stalls]
        self.arrivals = []
        sent_ns = 0
        for epoch in range(epochs):
            sent_ns = self._awake(max(sent_ns, (epoch + 1) * self.PERIOD_NS))
            sent_ns = self._after(sent_ns, sent_ns + self.WORK_NS, behind_ns)
            last = epoch >= epochs - 10
            request = ModeRequest.SHUTDOWN if last else ModeRequest.NAVIGATE_STRAPDOWN
            self.arrivals.append((sent_ns, np.array(bench.frames(epoch, request), Frame.dtype)))

    def _after(self, begin_ns, end_ns, behind_ns=0):
        """Return when what works from begin to end has ended, on this machine."""
        for stall_ns, on_ns in self.stalls:
            if begin_ns <= stall_ns < end_ns:
                end_ns += on_ns - stall_ns + behind_ns
        return end_ns

    def _awake(self, due_ns):
        """Return when what is due then is noticed."""
        return max([due_ns, *(on for stall, on in self.stalls if stall <= due_ns < on)])

    def receive(self, into, timeout_ns):
        end_ns = self.now_ns + timeout_ns
        if self.arrivals and self.arrivals[0][0] <= end_ns:
            due_ns, frames = self.arrivals.pop(0)
            self.now_ns = self._awake(max(self.now_ns, due_ns))
            into[: len(frames)] = frames
            return len(frames)
        self.now_ns = self._awake(end_ns)
        return 0

    def send(self, frames, count, epoch, time_ns):
        self.now_ns = self._after(self.now_ns, self.now_ns + 10_000)  # a step takes its time, too


def run_with_stalls(tools, stalls, behind_ns=0, epochs=400):
    """Run in real time on a machine that stands still; return the firmware and its lateness."""
    with pytest.MonkeyPatch.context() as patch:
        port = TimedPort(tools.Bench(), epochs, stalls, behind_ns)
        patch.setattr(loop.time, "monotonic_ns", lambda: port.now_ns)
        firmware = Firmware(tools.settings())
        lateness = LatenessHistogram(port.PERIOD_NS)
        run_realtime(firmware, port, lateness)
    assert firmware.mode == Mode.SHUTDOWN
    return firmware, lateness


@pytest.mark.parametrize("behind_ns", [0, 4_000_000])
def test_a_stall_of_both_sides_costs_no_frame(tools, behind_ns):
    firmware, lateness = run_with_stalls(tools, [(1_000_000_000, 40_000_000)], behind_ns)
    faults = firmware.ram[0]["faults"]
    assert 35 < max(stall["late_ms"] for stall in lateness.summary()["stalls"]) < 45
    assert faults["overruns"] > 3
    assert faults["missing_frames"] == faults["bridged_epochs"] == 0


STALL = st.tuples(st.integers(0, 8_000_000), st.integers(500_000, 12_000_000))
"""How long after the last one it begins, and how long it lasts, in ns."""


@pytest.mark.slow
@given(stalls=st.lists(STALL, min_size=1, max_size=12))
@settings(max_examples=25)
def test_whatever_the_stalls_of_both_sides_no_frame_is_lost(tools, stalls):
    begins_ns, times_ns = 650_000_000, []  # soon after the navigation begins
    for pause_ns, length_ns in stalls:
        begins_ns += pause_ns
        times_ns.append((begins_ns, length_ns))
        begins_ns += length_ns
    firmware, _ = run_with_stalls(tools, times_ns, epochs=200)
    faults = firmware.ram[0]["faults"]
    assert faults["missing_frames"] == faults["bridged_epochs"] == 0


def run(tools, batches, **arguments):
    port = ScriptedPort(tools.Bench(), batches)
    firmware = Firmware(tools.settings())
    run_lockstep(firmware, port, **arguments)
    return firmware, port


def test_lockstep_answers_every_epoch_until_shut_down(tools):
    firmware, port = run(tools, [1] * 150)
    assert [epoch for epoch, _, _ in port.sent] == list(range(150))
    assert [time for _, time, _ in port.sent] == [k * 5_000_000 for k in range(150)]
    assert firmware.is_shut_down
    assert firmware.mode == Mode.SHUTDOWN
    assert firmware.frames_received == 150 * 8
    assert firmware.frames_sent == sum(len(data) for *_, data in port.sent) // Frame.dtype.itemsize
    # power-on, self-test and standby take 102 epochs, alignment 19 before the one that navigates
    assert firmware.trace.epochs == 150 - 102 - 19 - 1


def test_a_batch_is_one_epoch_and_what_claims_a_later_one_is_not_used(tools):
    together, port = run(tools, [1] * 120 + [2])
    assert [epoch for epoch, _, _ in port.sent] == list(range(121))
    assert together.ram[0]["faults"]["counter_errors"] == 7  # SYNC, sensors and axes
    assert together.ram[0]["faults"]["missing_frames"] == 0
    assert together.frames_received == 122 * 8


def test_progress_is_told_at_its_epochs(tools):
    told = []
    run(tools, [1] * 100, every=25, on_epoch=told.append)
    assert told == [0, 25, 50, 75]


@pytest.mark.parametrize("ppm", [-1000.0, -0.5, 0.0, 250.0])
def test_the_own_clock_is_fast_by_its_error(ppm):
    for nominal_ns in (0, 1, 5_000_000, 3_600_000_000_000, 365 * 86_400 * 10**9 + 7):
        assert own_clock_ns(nominal_ns, ppm) == nominal_ns + nominal_ns * round(ppm * 1000) // 10**9


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [-500.0, 500.0])
def test_a_clock_error_is_estimated_and_does_not_touch_navigation(tools, ppm):
    right, _ = run(tools, [1] * 1500)
    wrong, _ = run(tools, [1] * 1500, clock_error_ppm=ppm)
    assert right.trace.sha256() == wrong.trace.sha256()
    own = wrong.ram[0]["clock"]
    assert (own["period_q16"] / 65536 / 5_000_000 - 1) * 1e6 == pytest.approx(ppm, abs=0.1)
