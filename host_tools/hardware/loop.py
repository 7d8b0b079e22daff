"""The shells of the hardware: they own time and the bus, and run the step.

`run_lockstep` opens an epoch and waits until the firmware has closed it, as fast as possible or at
a multiple of real time; `run_realtime` keeps absolute deadlines.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol, cast

from rrins.dbc.contract import load_contract
from rrins.dbc.frame import FrameArray, frame_array
from rrins.dbc.record import Records
from rrins.host_tools.hardware.fault_server import REPORT_CAPACITY, HardwareFaultServer
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.hardware.settings import Settings, pieces_of, power_on
from rrins.host_tools.hardware.step import OUTBOX_CAPACITY, hardware_step

INBOX_CAPACITY = 4096
"""Most frames received within one epoch."""

_FAREWELL_NS = 3_000_000_000  # for late last epochs of the firmware
_START_DELAY_NS = 50_000_000  # so that all is settled when the first epoch is due


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


class FrameFilter(Protocol):
    """Filter on the frames between the two sides, such as the wire model."""

    def up(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the firmware gets, given what the hardware sends in an epoch."""

    def down(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the hardware gets next, given what the firmware sends in an epoch."""


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

    def step(self, inbox: FrameArray, count: int) -> int:
        """Run one epoch on the first `count` frames; return the number in `outbox`."""
        return hardware_step(self.plant, self.pieces, self.contract, inbox, count, self.outbox)

    def open_epoch(self, epoch: int, frames: FrameArray, count: int) -> tuple[FrameArray, int]:
        """Run an epoch on the frames of the previous one; return the frames for the firmware.

        Fault commands and reports bypass the wire, so an injected fault can always be removed.
        """
        self.fault_server.receive(frames, count)
        if self.wire is None:
            passed, sent = self.outbox, self.step(frames, count)
        else:
            if epoch > 0:
                frames, count = self.wire.down(frames, count, epoch - 1)
            passed, sent = self.wire.up(self.outbox, self.step(frames, count), epoch)
        sent = self.fault_server.report(epoch, passed, sent)
        self.frames_sent += sent
        return passed, sent


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
) -> None:
    """Run `epochs` epochs in lockstep, at most `speed` times as fast as real time.

    `on_epoch` is called with the epoch whenever that is a multiple of `every`. `wait_for` takes the
    place of `speed`: it is called with each epoch and returns when that is due.
    """
    start_ns = time.monotonic_ns()
    count = 0
    for epoch in range(epochs):
        if wait_for is not None:
            wait_for(epoch)
        elif speed is not None:
            _wait_until(start_ns + round(epoch * hardware.period_ns / speed))
        frames, sent = hardware.open_epoch(epoch, hardware.inbox, count)
        port.send(frames, sent, epoch, epoch * hardware.period_ns)
        if on_epoch is not None and epoch % every == 0:
            on_epoch(epoch)
        count = port.receive_epoch(hardware.inbox)
        hardware.frames_received += count


def run_realtime(
    hardware: Hardware,
    port: Port,
    lateness: Lateness,
    epochs: int,
    every: int = 0,
    on_epoch: Callable[[int], None] | None = None,
) -> None:
    """Run `epochs` epochs in real time, each at its absolute deadline.

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
