"""Execution of both sides of a bench: the interface, and the ways in virtual time.

All ways share one interface. `Execution.pump` advances by the smallest step, an epoch in virtual
time or a batch of frames in real time, and passes the frames to the bench's recording.
"""

from __future__ import annotations

import contextlib
import os
import time
from abc import ABC, abstractmethod
from functools import partial
from pathlib import Path
from typing import Any

import can
import numpy as np

from rrins.compiled.record import Records
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.diagnostics.store import Stores
from rrins.firmware_py.loop import Firmware, open_memories
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.hardware.fault_server import HardwareFaultServer
from rrins.host_tools.hardware.loop import INBOX_CAPACITY, Hardware
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.runs.exchange import DirectExchange, answer_epoch
from rrins.host_tools.runs.programs.program import ProgramProcess
from rrins.host_tools.runs.results.samples import SampleBuffer, SampleFile
from rrins.host_tools.runs.set_up.settings import (
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.sides.job import prepare_hardware
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.errors import BenchError
from rrins.host_tools.testing.processes import (
    OwnProgram,
    SideProcess,
    attach_to_own,
    fresh_channel,
    shared_core,
)
from rrins.host_tools.testing.recording import FrameRing, Sender
from rrins.host_tools.wire.wire import Wire

START_S = 120.0
"""Longest startup of a side; the first one compiles."""
_PROGRAM_S = 30.0  # of the user's program, of which nothing is compiled
_POLL_S = 0.1
_TRUTHS = 256  # epochs whose truth is kept
_DRAIN_EVERY = 2000  # epochs
_KEPT = 16384  # frames of epochs that nobody looks at one by one
_SIDES = (Sender.HARDWARE, Sender.FIRMWARE)


class Execution(ABC):
    """Both sides, and the bus between them.

    Parameters
    ----------
    scenario : Scenario
    ring : FrameRing
        Recording of the bus.

    Attributes
    ----------
    now_ns : int
        Simulated time since power-on; in virtual time the beginning of the next epoch.
    wire : Wire or None
        The wire, if it is in this process.
    fault_server : HardwareFaultServer or None
        Injects faults into the hardware, if it is in this process.
    is_on : bool
        Whether the firmware has power.
    failure : str
        Why it ended prematurely; empty while all is well.
    died : str
        Once closed: which process had died, in words; empty if none.
    """

    wire: Wire | None = None
    fault_server: HardwareFaultServer | None = None

    def __init__(self, scenario: Scenario, ring: FrameRing) -> None:
        self.scenario = scenario
        self.ring = ring
        self.now_ns = 0
        self.is_on = True
        self.failure = ""
        self.died = ""

    @property
    def epoch(self) -> int:
        """The next epoch."""
        return self.now_ns // self.scenario.period_ns

    @abstractmethod
    def pump(self, until_ns: int) -> bool:
        """Advance by the smallest step; do nothing and return False once `until_ns` is reached.

        Raises
        ------
        BenchError
            If a process has died or the scenario is over.
        """

    def advance(self, until_ns: int) -> bool:
        """Advance by one step or more, of which nobody looks at the first ones; else as `pump`."""
        return self.pump(until_ns)

    @abstractmethod
    def send(self, frames: FrameArray, count: int) -> None:
        """Send frames of the test."""

    @abstractmethod
    def power_off(self) -> None:
        """Cut the firmware's power, at once; the hardware goes on."""

    @abstractmethod
    def power_on(self) -> None:
        """Switch the firmware on again: it begins anew, with its non-volatile memory."""

    def catch_up(self) -> None:  # noqa: B027 - nothing to do in virtual time
        """Receive pending frames without waiting."""

    def truth_at(self, time_ns: int) -> Truth:
        """Return the truth of the epoch at a time."""
        raise BenchError("in real time only the hardware process knows the truth")

    def truth(self) -> Truth:
        """Return the truth of the last epoch."""
        return self.truth_at(self.now_ns - self.scenario.period_ns)

    @abstractmethod
    def close(self) -> None:
        """Stop everything. Idempotent."""

    def fail(self, why: str) -> BenchError:
        """Record why the execution has ended; return an error to raise."""
        self.failure = why
        return BenchError(why)


class _Virtual(Execution):
    """An execution with the hardware in this process; its time is the epoch counter."""

    def __init__(self, scenario: Scenario, ring: FrameRing) -> None:
        super().__init__(scenario, ring)
        wire = scenario_wire(scenario, is_live=True)
        assert wire is not None
        self.wire = wire
        self.hardware = Hardware(hardware_settings(scenario), wire)
        self.fault_server = self.hardware.fault_server
        self._truth = self.hardware.plant["truth"]
        self._truths = Truth.zeros(_TRUTHS)
        self._next = 0
        self._inbox = self.hardware.inbox  # frames for the hardware in the next epoch
        self._count = 0
        self._outbox = frame_array(INBOX_CAPACITY)
        self._own = frame_array(INBOX_CAPACITY)
        self._own_count = 0
        self._is_cut = False  # whether a fault has taken the firmware's power

    def send(self, frames: FrameArray, count: int) -> None:
        end = self._own_count + count
        if end > len(self._own) // 2:
            raise BenchError(f"more than {len(self._own) // 2} frames sent in one epoch")
        self._own[self._own_count : end] = frames[:count]
        self._own_count = end

    def _epochs_until(self, until_ns: int) -> int:
        """Return how many epochs are left until a time, rounded."""
        period_ns = self.scenario.period_ns
        return max(0, (until_ns - self.now_ns - period_ns // 2 - 1) // period_ns + 1)

    def pump(self, until_ns: int) -> bool:
        if self._epochs_until(until_ns) == 0:
            return False
        epoch = self._next
        if self.failure:
            raise BenchError(self.failure)
        if epoch > self.scenario.epochs:
            raise BenchError(
                f"the scenario is over after {self.now_ns / 1e9:.3f} s; increase its duration_s "
                f"(now {self.scenario.duration_s:g})"
            )
        self._follow_power(epoch)
        frames, sent = self.hardware.open_epoch(epoch, self._inbox, self._count)
        self._truths[epoch % _TRUTHS] = self._truth[0]
        own, self._own_count = self._own_count, 0
        if own:  # before the hardware's, as if they had been sent just before the epoch
            self.ring.append(self._own, own, self.now_ns, Sender.TEST)
            self._outbox[:own] = self._own[:own]
            self._inbox[:own] = self._own[:own]
            sent = min(sent, len(self._outbox) - own)
            self._outbox[own : own + sent] = frames[:sent]
            frames = self._outbox
        self.ring.append(frames[own:], sent, self.now_ns, Sender.HARDWARE)
        self._count = own
        if self.is_on:
            self._exchange(frames, own + sent, epoch)
        else:
            self._pass_unheard(frames, own + sent, epoch)
        self._end_epoch(epoch)
        return True

    def _end_epoch(self, epoch: int) -> None:
        self._next = epoch + 1
        self.now_ns = self._next * self.scenario.period_ns

    def _follow_power(self, epoch: int) -> None:
        """Cut the firmware's power, or switch it on again, as a fault says."""
        has_power = self.hardware.has_power(epoch)
        if self._is_cut and has_power:
            self._is_cut = False
            self.power_on()
        elif self.is_on and not has_power:
            self._is_cut = True
            self.power_off()

    @abstractmethod
    def _exchange(self, frames: FrameArray, count: int, epoch: int) -> None:
        """Pass frames to the firmware; append its frames to `_inbox` and to the ring."""

    def _pass_unheard(self, frames: FrameArray, count: int, epoch: int) -> None:
        """Pass frames to whoever is on the bus but the firmware, which has no power."""

    def truth_at(self, time_ns: int) -> Truth:
        epoch = time_ns // self.scenario.period_ns
        truth = self._truths[epoch % _TRUTHS]
        if not self._next or truth["epoch"] != epoch:
            raise BenchError(f"the truth at {time_ns / 1e9:g} s is no longer kept")
        return truth


class _LastTruths(SampleFile):
    """Keeps the last samples of the truth, each in its epoch's place."""

    def __init__(self, kept: Records[Truth]) -> None:
        super().__init__(None)
        self._kept = kept

    def append(self, samples: Records[Any]) -> None:
        """Keep samples."""
        self._kept[samples["epoch"] % len(self._kept)] = samples


class DirectExecution(_Virtual):
    """Both sides in this process, without a bus."""

    def __init__(self, scenario: Scenario, ring: FrameRing, memory: Path | None = None) -> None:
        super().__init__(scenario, ring)
        self._memory = memory
        self._error_ppm = scenario.firmware.clock_error_ppm
        self._buffer = SampleBuffer(Truth, _LastTruths(self._truths))
        self._kept = frame_array(_KEPT)
        self._is_plain = False  # whether the hardware gets the firmware's frames alone
        self.power_on()

    def advance(self, until_ns: int) -> bool:
        """Run epochs in compiled code, as long as nobody but the two sides is on the bus."""
        epochs = self._epochs_until(until_ns)
        if epochs < 2 or not self._is_undisturbed():
            return self.pump(until_ns)
        until = min(
            self._next + epochs,
            self.scenario.epochs + 1,
            self.hardware.fault_server.report_epoch,
            self.hardware.undisturbed_until(self._next),
        )
        if until < self._next + 2:
            return self.pump(until_ns)
        self._exchange_until(until)
        return True

    def _is_undisturbed(self) -> bool:
        """Return whether only the two sides have something to do in the next epoch."""
        firmware = self.firmware
        is_asked = firmware.is_awake or firmware.diagnostics.reset_due or self._own_count
        return self.is_on and self._is_plain and not (is_asked or self.failure)

    def _exchange_until(self, until: int) -> None:
        first, exchange, firmware = self._next, self._direct, self.firmware
        exchange.count, self._count = self._count, 0
        last = exchange.run(until, 0)
        self._buffer.flush()
        marks = exchange.marks
        epochs = np.stack((np.arange(first, last + 1), marks["firmware_epoch"]), 1)
        counts = np.stack((marks["up"], marks["down"]), 1)
        counts[-1, 1] = 0
        senders = np.broadcast_to(np.array(_SIDES, np.uint8), counts.shape)
        self.ring.append(
            self._kept,
            int(counts.sum()),
            np.repeat(epochs.ravel() * firmware.period_ns, counts.ravel()),
            np.repeat(senders.ravel(), counts.ravel()),
        )
        self._pass_on(exchange.count)
        self._end_epoch(last)

    def _exchange(self, frames: FrameArray, count: int, epoch: int) -> None:
        self._is_plain = self._count == 0
        self._pass_on(answer_epoch(self.firmware, frames, count, epoch, self._error_ppm))

    def _pass_on(self, sent: int) -> None:
        """Record what the firmware has sent, and have it for the hardware."""
        firmware = self.firmware
        time_ns = firmware.epoch * firmware.period_ns
        self.ring.append(firmware.outbox, sent, time_ns, Sender.FIRMWARE)
        end = min(len(self._inbox), self._count + sent)
        self._inbox[self._count : end] = firmware.outbox[: end - self._count]
        self._count = end

    def power_off(self) -> None:
        """Cut the firmware's power."""
        self.is_on = False
        for store in (self._stores.parameters, self._stores.faults):
            if store is not None:
                store.close()

    def power_on(self) -> None:
        """Switch the firmware on again."""
        self._stores = Stores() if self._memory is None else open_memories(self._memory)
        self.firmware = Firmware(firmware_settings(self.scenario), stores=self._stores)
        self._direct = DirectExchange(
            *(self.hardware, self.firmware, self._buffer, 1, self._error_ppm, self.wire),
            kept=self._kept,
        )
        self._is_plain = False
        self.is_on = True

    def close(self) -> None:
        """End the run."""
        if self.is_on and self._memory is not None:
            self.power_off()
        self._next = self.scenario.epochs + 1


def _start_firmware(
    scenario_file: Path, own: OwnProgram | None, memory: Path | None, channel: str, core: int
) -> SideProcess:
    options = ["--core", str(core), "--attach-wait", str(START_S)]
    if memory is not None:
        options += ["--parameters", str(memory)]
    side = SideProcess("firmware", scenario_file, channel, "max", *options, own=own)
    if isinstance(side.process, ProgramProcess):
        with contextlib.suppress(ProcessLookupError):
            os.sched_setaffinity(side.process.program_pid, {core})
    return side


class LockstepExecution(_Virtual):
    """The firmware as a process; the hardware in this process hosts the bus and opens the epochs.

    Parameters
    ----------
    scenario : Scenario
    ring : FrameRing
    scenario_file : Path
        The scenario as a file, for the process.
    patience_s : float
        Longest silence of the firmware; 0 waits forever.
    foreign_senders : bool
        Whether clients of the bus may send what the contract gives to a side.
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
        self._is_own = own is not None
        self._start = partial(_start_firmware, scenario_file, own, memory)
        self.channel = fresh_channel()
        self._cores = os.sched_getaffinity(0)
        self._ends = contextlib.ExitStack()
        try:
            self.host = RrinsBus(
                self.channel,
                host="here",
                name="hardware",
                exclusive=True,
                foreign_senders=foreign_senders,
            )
            self._ends.callback(self.host.shutdown)
            core = shared_core()
            self.side = self._start(self.channel, core)
            self._ends.callback(self._stop)
            prepare_hardware(scenario)  # while the firmware initializes
            self._await_firmware(_PROGRAM_S if self._is_own else START_S)
            os.sched_setaffinity(0, {core})
            self._ends.callback(os.sched_setaffinity, 0, self._cores)
        except BaseException:
            self.close()
            raise

    def _await_firmware(self, patience_s: float) -> None:
        """Serve the bus until the firmware is on it."""
        deadline = time.monotonic() + patience_s
        while True:
            try:
                self.host.wait_for("firmware", _POLL_S)
            except can.CanTimeoutError:
                if self.side.poll() is not None:
                    raise BenchError(self.side.failure()) from None
                if time.monotonic() > deadline:
                    raise BenchError(f"no firmware attached within {patience_s:g} s") from None
            else:
                self.host.require(["firmware"])
                return

    def power_off(self) -> None:
        """Cut the firmware's power."""
        self.host.require([])
        self.side.kill()
        self.is_on = False

    def power_on(self) -> None:
        """Switch the firmware on again."""
        self.side = self._start(self.channel, shared_core())
        self._await_firmware(_PROGRAM_S if self._is_own else START_S)
        self.is_on = True

    def _pass_unheard(self, frames: FrameArray, count: int, epoch: int) -> None:
        self.host.send_batch(frames, count, epoch=epoch, time_ns=self.now_ns, closes_epoch=True)

    def attach(self) -> RrinsBus:
        """Return another client on the bus, for the test itself."""
        bus = attach_to_own(self.host, "test")
        self._ends.callback(bus.shutdown)
        return bus

    def _exchange(self, frames: FrameArray, count: int, epoch: int) -> None:
        if epoch % _DRAIN_EVERY == 0:
            self.side.poll()
        try:
            if epoch == self.scenario.epochs:
                self.host.require([])
            self.host.send_batch(frames, count, epoch=epoch, time_ns=self.now_ns, closes_epoch=True)
            closed = False
            while not closed:
                closed = self._receive()
        except can.CanError as error:
            raise self.fail(self.side.failure()) from error

    def _receive(self) -> bool:
        """Receive a batch; return whether it closes the epoch."""
        room = self._inbox[self._count :] if self._count else self._inbox
        batch = self.host.recv_batch(room, self._patience_s or None)
        if batch is None:
            pid = self.side.process.pid
            raise self.fail(
                f"the firmware process {pid} has been silent for {self._patience_s:g} s"
            )
        is_firmware = batch.closes_epoch
        sender = Sender.FIRMWARE if is_firmware else Sender.OTHER
        self.ring.append(room, batch.count, batch.time_ns, sender)
        self._count += batch.count
        return is_firmware

    def _stop(self) -> None:
        self.died = self.side.stop() if self.is_on else ""

    def close(self) -> None:
        """Stop the process and close the bus."""
        self._next = self.scenario.epochs + 1
        self._ends.close()
