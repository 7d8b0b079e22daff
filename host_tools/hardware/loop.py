"""The shells of the hardware: they own time and the bus, and run the step.

`run_lockstep` opens an epoch and waits until the firmware has closed it, as fast as possible or at
a multiple of real time; `run_realtime` keeps absolute deadlines.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol, cast

import numpy as np

from rrins.compiled.record import Records, Words
from rrins.dbc.contract import load_contract
from rrins.dbc.direct import NOTHING, WORDS, Direct
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.hardware.exchange import Exchange, run_epochs
from rrins.host_tools.hardware.fault_server import REPORT_CAPACITY, HardwareFaultServer
from rrins.host_tools.hardware.faults import NEVER
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.hardware.settings import Settings, pieces_of, power_on
from rrins.host_tools.hardware.step import OUTBOX_CAPACITY

INBOX_CAPACITY = 4096
"""Most frames received within one epoch."""

_FAREWELL_NS = 3_000_000_000  # for late last epochs of the firmware
_START_DELAY_NS = 50_000_000  # so that all is settled when the first epoch is due
_NO_SOCKET = Direct.zeros()
_NO_WORDS: Words = np.zeros(0, dtype=np.uint64)


class Port(Protocol):
    """A connection to the bus, as the shells need it."""

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames and close the epoch."""

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the other side has closed its epoch; return the number of frames."""

    def receive(self, into: FrameArray, timeout_ns: int) -> int:
        """Wait for frames for at most `timeout_ns`; return their number."""

    def dismiss(self) -> None:
        """Allow the other side to leave without a fault."""

    def has_other(self) -> bool:
        """Return whether the other side is known to be still connected."""

    def lend(self, direct: Records[Direct]) -> bool:
        """Tell compiled code of the other side's socket; return False if it is not to use it."""

    def take_back(self, direct: Records[Direct], words: Words) -> None:
        """Go on where compiled code has left off."""


class FrameFilter(Protocol):
    """Filter on the frames between the two sides, such as the wire model."""

    def clear_until(self, epoch: int) -> int:
        """Return the epoch up to which all frames pass, if the other side asks for nothing else."""

    def up(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the firmware gets, given what the hardware sends in an epoch."""

    def down(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the hardware gets next, given what the firmware sends in an epoch."""

    def has_power(self, epoch: int) -> bool:
        """Return whether the firmware has power in an epoch."""


class Lateness(Protocol):
    """Collects the lateness of each epoch."""

    def add(self, late_ns: int, overrun: bool) -> None:
        """Add one epoch's lateness."""


class Hardware:
    """The hardware in its memory, with the buffers around it.

    Attributes
    ----------
    plant : Records[Plant]
        One record.
    truth : Records[Truth]
        Field of the plant, one record.
    pieces : array, shape (n, 15, 8)
        The vehicle's motion.
    inbox, outbox : FrameArray
    fault_server : HardwareFaultServer
        Injects hardware faults on HARDWARE_FAULT_COMMAND.
    """

    def __init__(self, settings: Settings, wire: FrameFilter | None = None) -> None:
        self.wire = wire
        self.contract = load_contract()
        self.plant = power_on(settings)
        self.truth = cast("Records[Truth]", self.plant["truth"])
        self.pieces = pieces_of(settings)
        self.inbox = frame_array(INBOX_CAPACITY)
        self.outbox = frame_array(OUTBOX_CAPACITY + REPORT_CAPACITY)
        self.fault_server = HardwareFaultServer(self.plant[0])
        self.period_ns = int(self.plant[0].period_ns)
        self.frames_received = 0
        self.frames_sent = 0
        self._one_epoch = Exchange.zeros()
        # Views: reading one costs less than finding its field each time.
        self._count, self._to_send = self._one_epoch["count"], self._one_epoch["to_send"]
        self._epoch = self.plant["epoch"]

    def step(self, inbox: FrameArray, count: int) -> int:
        """Run one epoch on the first `count` frames; return the number in `outbox`."""
        self._count[0] = count
        self.exchange(inbox, self._one_epoch, _NO_SOCKET, _NO_WORDS)
        return int(self._to_send.item())

    def exchange(
        self,
        inbox: FrameArray,
        exchange: Records[Exchange],
        direct: Records[Direct],
        words: Words,
    ) -> None:
        """Run epochs as `run_epochs` does."""
        run_epochs(
            self.plant, self.pieces, self.contract, inbox, self.outbox, exchange, direct, words
        )
        self.frames_received += exchange["received"].item()
        self.frames_sent += exchange["sent"].item()

    def open_epoch(self, epoch: int, frames: FrameArray, count: int) -> tuple[FrameArray, int]:
        """Run an epoch on the frames of the previous one; return the frames for the firmware.

        Fault commands and reports bypass the wire, so an injected fault can always be removed.
        """
        self.fault_server.receive(frames, count)
        if self.wire is None:
            return self.outbox, self._report(epoch, self.outbox, self.step(frames, count))
        if epoch > 0:
            frames, count = self.wire.down(frames, count, epoch - 1)
        passed, sent = self.wire.up(self.outbox, self.step(frames, count), epoch)
        return passed, self._report(epoch, passed, sent)

    def _report(self, epoch: int, frames: FrameArray, count: int) -> int:
        """Append a report of faults if one is due; return the frames that are to be sent."""
        count = self.fault_server.report(epoch, frames, count)
        self.frames_sent += count
        return count

    @property
    def epoch(self) -> int:
        """The next epoch."""
        return int(self._epoch.item())

    def has_power(self, epoch: int) -> bool:
        """Return whether the firmware has power in the epoch to be opened, or had in the last."""
        return self.wire is None or self.wire.has_power(epoch)

    def undisturbed_until(self, epoch: int) -> int:
        """Return the epoch up to which all frames pass as they are; `epoch` if not even in that."""
        return NEVER if self.wire is None else self.wire.clear_until(epoch)

    def open_alone(
        self,
        exchange: Records[Exchange],
        direct: Records[Direct],
        words: Words,
        count: int,
        awaits: bool,
    ) -> int:
        """Run epochs with the firmware as long as nothing asks for Python.

        Begins with `count` frames in the inbox, or awaits them. Returns the number of frames of
        `outbox` that are to be sent; `NOTHING` if there are none.
        """
        state = exchange[0]
        state.goes_on = True
        state.count = count
        state.awaits = awaits
        state.report_epoch = self.fault_server.report_epoch
        self.exchange(self.inbox, exchange, direct, words)
        sent = int(state.to_send)
        if sent == NOTHING:
            return sent
        return self._report(self.epoch - 1, self.outbox, sent)


def _wait_until(deadline_ns: int) -> None:
    left_ns = deadline_ns - time.monotonic_ns()
    if left_ns > 0:
        time.sleep(left_ns * 1e-9)


def run_lockstep(
    hardware: Hardware,
    port: Port,
    epochs: int,
    speed: float | None = None,
    every: int = 0,
    on_epoch: Callable[[int], None] | None = None,
    wait_for: Callable[[int], None] | None = None,
    power: Callable[[int], bool] = lambda epoch: True,
) -> None:
    """Run `epochs` epochs in lockstep, at most `speed` times as fast as real time.

    `on_epoch` is called with the epoch whenever that is a multiple of `every`. `wait_for` takes the
    place of `speed`: it is called with each epoch and returns when that is due. `power` is asked in
    each epoch that may have a fault on the wire whether the firmware is there to answer.
    """
    start_ns = time.monotonic_ns()
    exchange, direct, words = Exchange.zeros(), Direct.zeros(), np.zeros(WORDS, dtype=np.uint64)
    exchange[0].every = every
    is_free = speed is None and wait_for is None
    epoch, count, awaits = 0, 0, False
    while epoch < epochs or awaits:
        until = hardware.undisturbed_until(epoch) if is_free else epoch
        if until > epoch and port.lend(direct):
            before = epoch, awaits
            exchange[0].epochs = min(epochs, until)
            sent = hardware.open_alone(exchange, direct, words, count, awaits)
            port.take_back(direct, words)
            epoch, count, awaits = hardware.epoch, int(exchange[0].count), bool(exchange[0].awaits)
            if before != (epoch, awaits):
                if sent != NOTHING:
                    port.send(hardware.outbox, sent, epoch - 1, (epoch - 1) * hardware.period_ns)
                    awaits = True
                if on_epoch is not None and awaits and (epoch - 1) % every == 0:
                    on_epoch(epoch - 1)
                continue
        if not awaits:
            if wait_for is not None:
                wait_for(epoch)
            elif speed is not None:
                _wait_until(start_ns + round(epoch * hardware.period_ns / speed))
            is_on = power(epoch)
            frames, sent = hardware.open_epoch(epoch, hardware.inbox, count)
            port.send(frames, sent, epoch, epoch * hardware.period_ns)
            if on_epoch is not None and epoch % every == 0:
                on_epoch(epoch)
            epoch += 1
            if not is_on:
                count = 0
                continue
        count = port.receive_epoch(hardware.inbox)
        hardware.frames_received += count
        awaits = False


def run_realtime(
    hardware: Hardware,
    port: Port,
    lateness: Lateness,
    epochs: int,
    every: int = 0,
    on_epoch: Callable[[int], None] | None = None,
    power: Callable[[int], bool] = lambda epoch: True,
) -> None:
    """Run `epochs` epochs in real time, each at its absolute deadline.

    `power` is called with each epoch.

    An epoch that begins more than a period late is an overrun: the firmware may have run without
    it. After the last epoch the bus stays open until the firmware has left it.
    """
    overruns = hardware.plant["counters"]["overruns"]
    start_ns = time.monotonic_ns() + _START_DELAY_NS
    for epoch in range(epochs):
        deadline_ns = start_ns + epoch * hardware.period_ns
        count, now_ns = _gather_until(hardware, port, deadline_ns)
        late_ns = now_ns - deadline_ns
        lateness.add(late_ns, late_ns > hardware.period_ns)
        overruns[0] += late_ns > hardware.period_ns
        hardware.frames_received += count
        power(epoch)
        frames, sent = hardware.open_epoch(epoch, hardware.inbox, count)
        if epoch == epochs - 1:
            port.dismiss()
        port.send(frames, sent, epoch, epoch * hardware.period_ns)
        if on_epoch is not None and epoch % every == 0:
            on_epoch(epoch)
    end_ns = start_ns + epochs * hardware.period_ns
    count, now_ns = _gather_until(hardware, port, end_ns)
    hardware.frames_received += count
    while port.has_other() and now_ns < end_ns + _FAREWELL_NS:
        count, now_ns = _gather_until(hardware, port, now_ns + hardware.period_ns)
        hardware.frames_received += count


def _gather_until(hardware: Hardware, port: Port, deadline_ns: int) -> tuple[int, int]:
    """Gather frames until the deadline, and any pending then.

    Returns their number, and the time when the wait for the deadline ended.
    """
    count = 0
    late_ns = 0
    while count < len(hardware.inbox):
        now_ns = time.monotonic_ns()
        if now_ns >= deadline_ns and not late_ns:
            late_ns = now_ns
        came = port.receive(hardware.inbox[count:], max(0, deadline_ns - now_ns))
        count += came
        if late_ns and not came:
            break
    return count, late_ns or time.monotonic_ns()
