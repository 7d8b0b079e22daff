"""The way in real time: both sides as processes by their own clocks, the bench on their bus."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Any

import can

from dbc.frame import FrameArray, frame_array
from host_tools.bus.interface import RrinsBus
from host_tools.scenario import Scenario
from host_tools.testing.errors import BenchError
from host_tools.testing.processes import SideProcess, fresh_channel
from host_tools.testing.recording import FrameRing, Sender, messages_of
from host_tools.testing.worlds import START_S, World

_POLL_S = 0.5
_ENDING_S = 2.0
_OBSERVER = "bench"


class RealtimeWorld(World):
    """Both sides as processes that keep real time; this one observes their bus.

    Parameters
    ----------
    scenario : Scenario
    ring : FrameRing
    scenario_file : Path
        For the processes to load.
    patience_s : float
        Longest silence of the bus; 0 waits for ever.
    """

    def __init__(
        self, scenario: Scenario, ring: FrameRing, scenario_file: Path, patience_s: float
    ) -> None:
        super().__init__(scenario, ring)
        self._patience_s = patience_s
        self.channel = fresh_channel()
        self._frames = frame_array(4096)
        self._ends = contextlib.ExitStack()
        self._last_ns = time.monotonic_ns()
        try:
            self.hardware_side = self._start("hardware", scenario_file, "--await-peer", _OBSERVER)
            # The firmware prepares itself meanwhile, and waits for the bus.
            wait = ("--attach-wait", str(START_S))
            self.side = self._start("firmware", scenario_file, *wait)
            self.hardware_side.wait_until_ready(START_S)
            self.side.wait_until_ready(START_S)
            self._bus = self._open(_OBSERVER)
            self._last_ns = time.monotonic_ns()
        except BaseException:
            self.close()
            raise

    def _start(self, side: Any, scenario_file: Path, *options: str) -> SideProcess:
        process = SideProcess(side, scenario_file, self.channel, "1", *options)
        self._ends.callback(self._stop, process)
        return process

    def _stop(self, side: SideProcess) -> None:
        """Stop a side; the firmware comes first, and the hardware may miss it before it is told."""
        if side is self.hardware_side:
            side.stop()
        else:
            self.died = side.stop()

    def _open(self, name: str) -> RrinsBus:
        try:
            bus = RrinsBus(self.channel, host="never", role="observer", name=name)
        except can.CanError as error:
            raise BenchError(self._how_it_ended(error)) from error
        self._ends.callback(bus.shutdown)
        return bus

    def attach(self) -> RrinsBus:
        """Return another end on the bus, for the test itself."""
        return self._open("test")

    def put(self, frames: FrameArray, count: int) -> None:
        """Send the test's frames at once."""
        self.catch_up()
        try:
            for message in messages_of(frames[:count], self.channel):
                self._bus.send(message, timeout=_POLL_S)
        except can.CanError as error:
            raise self.fail(self._how_it_ended(error)) from error
        self.ring.append(frames, count, self.now_ns, Sender.TEST)

    def pump(self, until_ns: int) -> bool:
        """Take the next batch of frames."""
        if self.now_ns >= until_ns:
            return False
        if not self._take(_POLL_S):
            self.side.poll()
            self.hardware_side.poll()
            silent_s = (time.monotonic_ns() - self._last_ns) / 1e9
            if self._patience_s and silent_s > self._patience_s:
                raise self.fail(f"the bus {self.channel} is silent for {silent_s:.0f} s")
        return True

    def catch_up(self) -> None:
        """Take the frames that have come; an end of the bus shows in the next `pump`."""
        with contextlib.suppress(BenchError):
            while self._take(0.0):
                pass

    def _take(self, timeout_s: float) -> bool:
        """Take a batch; return whether one came in time."""
        if self.failure:
            raise BenchError(self.failure)
        try:
            batch = self._bus.recv_batch(self._frames, timeout_s)
        except can.CanError as error:
            raise self.fail(self._how_it_ended(error)) from error
        if batch is None:
            return False
        self._last_ns = time.monotonic_ns()
        if batch.sender == 0:  # the host: the hardware
            sender = Sender.HARDWARE
            self.now_ns = max(self.now_ns, batch.time_ns)
        else:
            sender = Sender.FIRMWARE if batch.closes_epoch else Sender.OTHER
        self.ring.append(self._frames, batch.count, batch.time_ns, sender)
        return True

    def _how_it_ended(self, error: can.CanError) -> str:
        """Return why the bus has ended: the side that was killed before the one that noticed."""
        if self.now_ns >= (self.scenario.epochs - 1) * self.scenario.period_ns:
            return f"the scenario is over after {self.now_ns / 1e9:.3f} s"
        sides = (self.side, self.hardware_side)
        with contextlib.suppress(TimeoutExpired):  # still there: only this observer was cut off
            for side in reversed(sides):
                side.process.wait(_ENDING_S)
        for side in sides:
            if (side.poll() or 0) < 0:
                return side.failure()
        for side in sides:
            if side.poll() is not None:
                return side.failure()
        return f"{error}"

    def close(self) -> None:
        """End both processes and leave the bus."""
        self._ends.close()
