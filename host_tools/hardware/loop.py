"""The shells of the hardware: they own time and the bus, and run the step.

`run_lockstep` opens an epoch and waits until the firmware has closed it, as fast as that goes or
at a multiple of real time; `run_realtime` keeps absolute deadlines.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from dbc.contract import load_contract
from dbc.frame import FrameArray, frame_array
from host_tools.hardware.fault_desk import REPORT_CAPACITY, FaultDesk
from host_tools.hardware.settings import Settings, pieces_of, power_on
from host_tools.hardware.step import OUTBOX_CAPACITY, hardware_step

INBOX_CAPACITY = 4096
"""Frames that may come within one epoch."""

_FAREWELL_NS = 3_000_000_000  # for a firmware that is late with its last epochs
_START_DELAY_NS = 50_000_000  # to be settled when the first epoch is due


class Port(Protocol):
    """A place on the bus, as the shells need it."""

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames and close the epoch."""

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the other side has closed its epoch; return how many frames came."""

    def receive(self, into: FrameArray, timeout_ns: int) -> int:
        """Wait for frames, `timeout_ns` at most; return how many came, 0 for none."""

    def dismiss(self) -> None:
        """Let the other side leave without that being a fault."""

    def has_other(self) -> bool:
        """Return whether the other side is known to be there still."""


class Wire(Protocol):
    """What lies between the two sides besides the transport."""

    def up(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the firmware gets, given what the hardware sends in an epoch."""

    def down(self, frames: FrameArray, count: int, epoch: int) -> tuple[FrameArray, int]:
        """Return what the hardware gets next, given what the firmware sends in an epoch."""


class Lateness(Protocol):
    """Takes how late each epoch began."""

    def take(self, late_ns: int, overrun: bool) -> None:
        """Take one epoch's lateness."""


class Hardware:
    """The hardware in its memory, with the buffers around it.

    Attributes
    ----------
    plant : array of one record of dtype `host_tools.hardware.memory.PLANT`
    pieces : array, shape (n, 15, 8)
        The vehicle's motion.
    inbox, outbox : arrays of dtype `dbc.frame.FRAME`
    desk : FaultDesk
        Puts in faults of the hardware, as HARDWARE_FAULT_COMMANDs ask for.
    """

    def __init__(self, settings: Settings, wire: Wire | None = None) -> None:
        self.wire = wire
        self.contract = load_contract()
        self.plant = power_on(settings)
        self.pieces = pieces_of(settings)
        self.inbox = frame_array(INBOX_CAPACITY)
        self.outbox = frame_array(OUTBOX_CAPACITY + REPORT_CAPACITY)
        self.desk = FaultDesk(self.plant[0])
        self.period_ns = int(self.plant[0]["period_ns"])
        self.frames_received = 0
        self.frames_sent = 0

    def step(self, inbox: FrameArray, count: int) -> int:
        """Run one epoch on the first `count` frames; return those put into `outbox`."""
        sent: int = hardware_step(self.plant, self.pieces, self.contract, inbox, count, self.outbox)
        return sent

    def open_epoch(self, epoch: int, frames: FrameArray, count: int) -> tuple[FrameArray, int]:
        """Run an epoch on the frames of the one before; return what goes to the firmware.

        Commands and reports of faults do not pass the wire: what is put in can be taken out.
        """
        self.desk.take(frames, count)
        if self.wire is None:
            passed, sent = self.outbox, self.step(frames, count)
        else:
            if epoch > 0:
                frames, count = self.wire.down(frames, count, epoch - 1)
            passed, sent = self.wire.up(self.outbox, self.step(frames, count), epoch)
        sent = self.desk.report(epoch, passed, sent)
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
) -> None:
    """Run `epochs` epochs in lockstep, `speed` times as fast as real time at most.

    `on_epoch` is called with the epoch whenever that is a multiple of `every`.
    """
    start_ns = time.monotonic_ns()
    count = 0
    for epoch in range(epochs):
        if speed is not None:
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
    it. After the last one the bus is kept until the firmware has left it.
    """
    start_ns = time.monotonic_ns() + _START_DELAY_NS
    for epoch in range(epochs):
        deadline_ns = start_ns + epoch * hardware.period_ns
        count, now_ns = _gather_until(hardware, port, deadline_ns)
        late_ns = now_ns - deadline_ns
        lateness.take(late_ns, late_ns > hardware.period_ns)
        hardware.plant[0]["counters"]["overruns"] += late_ns > hardware.period_ns
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
    """Take frames until the deadline, and what is there by then.

    Returns how many there are, and the time when the deadline's wait was over.
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
