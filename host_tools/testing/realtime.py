"""The real-time way: both sides as processes with their own clocks, the bench on their bus."""

from __future__ import annotations

import contextlib
import time
from functools import partial
from pathlib import Path
from subprocess import TimeoutExpired

import can

from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.bus.address import Side
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.processes import OwnProgram, SideProcess, fresh_channel
from rrins.host_tools.testing.recording import FrameRing, Sender, messages_of
from rrins.host_tools.testing.virtual_time import START_S, Execution

_POLL_S = 0.5
_ENDING_S = 2.0
_OBSERVER = "bench"
_LOOK_EVERY = 64  # batches, at the firmware's process


class RealtimeExecution(Execution):
    """Both sides as processes in real time; this process observes their bus.

    Parameters
    ----------
    scenario : Scenario
    ring : FrameRing
    scenario_file : Path
        The scenario as a file, for the processes.
    patience_s : float
        Longest silence of the bus; 0 waits forever.
    foreign_senders : bool
        Whether this process may send what the contract gives to a side.
    own : OwnProgram, optional
        The user's program as the firmware.
    memory : Path, optional
        File of the firmware's parameter memory.
    """

    def __init__(
        self,
        scenario: Scenario,
        ring: FrameRing,
        scenario_file: Path,
        patience_s: float,
        foreign_senders: bool = True,
        own: OwnProgram | None = None,
        memory: Path | None = None,
    ) -> None:
        super().__init__(scenario, ring)
        self._patience_s = patience_s
        self.channel = fresh_channel()
        self._frames = frame_array(4096)
        self._ends = contextlib.ExitStack()
        self._last_ns = time.monotonic_ns()
        self._pumped = 0
        try:
            options = ["--await-peer", _OBSERVER, "--keep"]
            options += ["--foreign-senders"] if foreign_senders else []
            self.hardware_side = self._start("hardware", scenario_file, *options)
            # The firmware initializes in the meantime, and waits for the bus.
            wait = ["--attach-wait", str(START_S)]
            wait += [] if memory is None else ["--parameters", str(memory)]
            self._start_firmware = partial(self._start, "firmware", scenario_file, *wait, own=own)
            self._is_own = own is not None
            self.side = self._start_firmware()
            self.hardware_side.wait_until_ready(START_S)
            self._await_firmware()
            self._bus = self._open(_OBSERVER)
            self._last_ns = time.monotonic_ns()
        except BaseException:
            self.close()
            raise

    def _start(
        self, side: Side, scenario_file: Path, *options: str, own: OwnProgram | None = None
    ) -> SideProcess:
        process = SideProcess(side, scenario_file, self.channel, "1", *options, own=own)
        self._ends.callback(self._stop, process)
        return process

    def _await_firmware(self) -> None:
        if not self._is_own:  # another program comes when it comes: the hardware waits for it
            self.side.wait_until_ready(START_S)

    def power_off(self) -> None:
        """Cut the firmware's power."""
        self.catch_up()
        self.side.kill()
        self.is_on = False

    def power_on(self) -> None:
        """Switch the firmware on again."""
        self.side = self._start_firmware()
        self._await_firmware()
        self.is_on = True

    def _stop(self, side: SideProcess) -> None:
        """Stop a side; the firmware goes first, so ignore that the hardware may then fail."""
        if side is self.hardware_side or side is not self.side or not self.is_on:
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
        """Return another client on the bus, for the test itself."""
        return self._open("test")

    def send(self, frames: FrameArray, count: int) -> None:
        """Send frames of the test at once."""
        self.catch_up()
        try:
            for message in messages_of(frames[:count], self.channel):
                self._bus.send(message, timeout=_POLL_S)
        except can.CanError as error:
            raise self.fail(self._how_it_ended(error)) from error
        self.ring.append(frames, count, self.now_ns, Sender.TEST)

    def pump(self, until_ns: int) -> bool:
        """Receive the next batch of frames."""
        if self.now_ns >= until_ns:
            return False
        self._pumped += 1
        if self._pumped % _LOOK_EVERY == 0:
            self._check_firmware()
        if not self._receive(_POLL_S):
            self.side.poll()
            self.hardware_side.poll()
            silent_s = (time.monotonic_ns() - self._last_ns) / 1e9
            if self._patience_s and silent_s > self._patience_s:
                raise self.fail(f"the bus {self.channel} is silent for {silent_s:.0f} s")
        return True

    def _check_firmware(self) -> None:
        """Notice a firmware that has died: the hardware goes on without it."""
        is_over = self.now_ns >= (self.scenario.epochs - 1) * self.scenario.period_ns
        if self.is_on and not is_over and self.side.poll() is not None:
            raise self.fail(self.side.failure())

    def catch_up(self) -> None:
        """Receive the pending frames; if the bus has ended, the next `pump` reports it."""
        with contextlib.suppress(BenchError):
            while self._receive(0.0):
                pass

    def _receive(self, timeout_s: float) -> bool:
        """Receive a batch; return whether one arrived in time."""
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
        """Return why the bus has ended, preferring a side that was killed to one that noticed."""
        if self.now_ns >= (self.scenario.epochs - 1) * self.scenario.period_ns:
            return f"the scenario is over after {self.now_ns / 1e9:.3f} s"
        sides = (self.side, self.hardware_side)
        with contextlib.suppress(
            TimeoutExpired
        ):  # still running: only this observer was disconnected
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
        """Stop both processes and leave the bus."""
        self._ends.close()
