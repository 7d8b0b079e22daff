"""The shells of the firmware: they own time and the bus, and run the step.

`run_lockstep` waits for each epoch that the hardware opens and closes it; `run_realtime` keeps
absolute deadlines by its own clock. Both send the same frames.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from rrins.compiled.record import Floats, Records, Words
from rrins.dbc.contract import load_contract
from rrins.dbc.direct import NOTHING, WORDS, Direct
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.frames_out.transmit import OUTBOX_CAPACITY
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.core.settings import Settings, power_on
from rrins.firmware_py.diagnostics.fault_memory import CAPACITY as FAULT_CAPACITY
from rrins.firmware_py.diagnostics.node import Diagnostics
from rrins.firmware_py.diagnostics.parameter_memory import ParameterMemory
from rrins.firmware_py.diagnostics.regions import CALIBRATION_CAPACITY
from rrins.firmware_py.diagnostics.server import Reset
from rrins.firmware_py.diagnostics.store import Stores, open_stores
from rrins.firmware_py.diagnostics.writer import ThreadWriter
from rrins.firmware_py.exchange import Exchange, exchange_record, run_epochs
from rrins.firmware_py.xcp.a2l import a2l_text
from rrins.firmware_py.xcp.node import Xcp

INBOX_CAPACITY = 4096
"""Frames by which the loop can fall behind without losing any."""

_GRACE_SLICES = 4
"""Of the wait for a late epoch: a slice that ends late by half its length shows a stall."""
_GRACES_AT_MOST = 4
"""Otherwise a machine that is always late would wait forever for a bus that is gone."""

_SHUTDOWN = int(Mode.SHUTDOWN)
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

    def lend(self, direct: Records[Direct]) -> bool:
        """Tell compiled code of the other side's socket; return False if it is not to use it."""

    def take_back(self, direct: Records[Direct], words: Words) -> None:
        """Go on where compiled code has left off."""


class Lateness(Protocol):
    """Collects the lateness of each epoch."""

    def add(self, late_ns: int, overrun: bool) -> None:
        """Add one epoch's lateness."""


class Firmware:
    """The firmware in its memory, with the buffers around it.

    Attributes
    ----------
    ram : Records[Ram]
        One record.
    inbox, outbox : FrameArray
    trace : NavigationTrace
        The navigation output of every epoch with navigation.
    diagnostics : Diagnostics
    xcp : Xcp or None
    """

    def __init__(
        self,
        settings: Settings,
        trace: NavigationTrace | None = None,
        stores: Stores | None = None,
    ) -> None:
        self.contract = load_contract()
        stores = stores or Stores()
        parameters = ParameterMemory(settings, stores.parameters)
        self.settings = parameters.settings()
        self.ram = power_on(self.settings, self.contract)
        self.diagnostics = Diagnostics(self.ram, self.contract, parameters, stores.faults)
        self.trace = trace or NavigationTrace()
        self.compares: bool | None = True if self.settings.redundancy is not None else None
        """Whether redundant sensors are compared, as `firmware_step` takes it."""
        self.estimates: bool | None = True if self.settings.estimator is not None else None
        """Whether the estimator runs, as `firmware_step` takes it."""
        self.period_ns = int(self.ram[0].parameters.period_ns)
        self.inbox = frame_array(INBOX_CAPACITY)
        self.xcp = self._make_xcp()
        room = Diagnostics.capacity(self.period_ns) + Xcp.capacity(settings.xcp, self.period_ns)
        self.outbox = frame_array(OUTBOX_CAPACITY + room)
        self.frames_received = 0
        self.frames_sent = 0
        self.sync_id = int(self.contract[0].sync.message.can_id)
        self._one_epoch = exchange_record()
        # Views into the RAM image: reading one costs less than finding its field each time.
        self._mode = self.ram["modes"]["mode"]
        self._epoch = self.ram["epoch"]
        self._consumed = self.ram["consumed"]
        self._sync_arrival_ns = self.ram["clock"]["sync_arrival_ns"]
        self._is_whole = self.ram["clock"]["is_whole"]
        self._attention = self.ram["diagnostics"]["attention"]

    def _make_xcp(self) -> Xcp | None:
        if self.settings.xcp is None:
            return None
        settings, period_ns = self.settings.xcp, self.period_ns
        return Xcp(self.ram, self.contract, settings, lambda: a2l_text(period_ns))

    @property
    def is_awake(self) -> bool:
        """Whether each epoch needs Python, for diagnostics or XCP."""
        return self.diagnostics.is_awake or (self.xcp is not None and self.xcp.is_awake)

    @property
    def mode(self) -> Mode:
        """The mode after the last step."""
        return Mode(int(self._mode[0]))

    @property
    def epoch(self) -> int:
        """The epoch of the last step."""
        return int(self._epoch.item())

    @property
    def is_shut_down(self) -> bool:
        """Whether the operator has shut the computer down."""
        return bool(self._mode.item() == _SHUTDOWN)

    def step(
        self, inbox: FrameArray, start: int, count: int, sync_arrival_ns: int
    ) -> tuple[int, int]:
        """Run one epoch on ``inbox[start:count]``.

        Returns the number of frames in `outbox`, and the index of the first frame of the inbox that
        belongs to a later epoch.
        """
        self.restart_if_due()
        self._sync_arrival_ns[0] = sync_arrival_ns
        if self.xcp is not None and self.xcp.stimulates:
            self.xcp.stimulate(inbox, start, count)
        sent = self.exchange(inbox, start, count, self._one_epoch, _NO_SOCKET, _NO_WORDS)
        return sent, self._consumed.item()

    def exchange(
        self,
        inbox: FrameArray,
        start: int,
        count: int,
        exchange: Records[Exchange],
        direct: Records[Direct],
        words: Words,
    ) -> int:
        """Run epochs as `run_epochs` does; return how many frames of `outbox` are to be sent.

        `NOTHING` if there are none.
        """
        self.restart_if_due()
        run_epochs(
            self.ram,
            self.contract,
            inbox,
            start,
            count,
            self.outbox,
            self.compares,
            self.estimates,
            self.trace.room,
            exchange,
            direct,
            words,
        )
        return self.settle(exchange, inbox, start)

    def settle(self, exchange: Records[Exchange], inbox: FrameArray, start: int) -> int:
        """Account for what `run_epochs` did, and run the diagnostics of its last epoch, if any.

        Parameters
        ----------
        exchange : Records[Exchange]
            What it has done.
        inbox : FrameArray
            Of the last epoch.
        start : int
            The first frame of `inbox` that belongs to it.

        Returns
        -------
        int
            How many frames of `outbox` are to be sent; `NOTHING` if there are none.
        """
        self.trace.add(exchange["rows"].item())
        self.frames_received += exchange["received"].item()
        self.frames_sent += exchange["sent"].item()
        sent: int = exchange["to_send"].item()
        if sent == NOTHING:
            return sent
        if self._attention.item() or self.is_awake:
            consumed = self._consumed.item()
            sent = self.diagnostics.run(inbox, start, consumed, self.outbox, sent)
            if self.xcp is not None:
                sent = self.xcp.run(inbox, start, consumed, self.outbox, sent)
        self.frames_sent += sent
        return sent

    def restart_if_due(self) -> None:
        """Restart the computer if diagnostics have asked for a reset."""
        if self.diagnostics.reset_due:
            self._restart()

    def power_on(self) -> None:
        """Begin anew after a loss of power, with what the non-volatile memories hold."""
        self.diagnostics.server.reset_wanted = Reset.HARD
        self._restart()

    def _restart(self) -> None:
        self.diagnostics.restart()
        if self.xcp is not None:
            self.xcp.power_on()

    def close(self) -> None:
        """Switch off, after storing the non-volatile memories."""
        self.diagnostics.close()

    def step_whole(self, inbox: FrameArray, count: int, sync_arrival_ns: int) -> int:
        """Run one epoch on all of ``inbox[:count]``, as when the other side waits for this one.

        A SYNC of a later epoch is then false, and is counted. Returns the number of frames in
        `outbox`.
        """
        self._is_whole[0] = True
        sent, _ = self.step(inbox, 0, count, sync_arrival_ns)
        return sent


def open_memories(path: Path) -> Stores:
    """Open the non-volatile memories: the parameter file, and the trouble code file next to it.

    Raises
    ------
    StoreError
        When a file cannot be opened.
    """
    return open_stores(path, CALIBRATION_CAPACITY, FAULT_CAPACITY)


def run_lockstep(
    firmware: Firmware,
    port: Port,
    clock_error_ppm: float = 0.0,
    every: int = 0,
    on_epoch: Callable[[int], None] | None = None,
) -> None:
    """Run in lockstep until shut down.

    `on_epoch` is called with the epoch whenever that is a multiple of `every`.
    """
    exchange = exchange_record(clock_error_ppm, every)
    arrivals, goes_on = exchange["arrivals"], exchange["goes_on"]  # views, as in `Firmware`
    direct, words = Direct.zeros(), np.zeros(WORDS, dtype=np.uint64)
    while not firmware.is_shut_down:
        arrived = arrivals.item()
        sent = NOTHING
        is_lent = not firmware.is_awake and port.lend(direct)
        goes_on[0] = is_lent
        if is_lent:
            sent = firmware.exchange(firmware.inbox, 0, NOTHING, exchange, direct, words)
            port.take_back(direct, words)
        if arrivals.item() == arrived:
            count = port.receive_epoch(firmware.inbox)
            nominal_ns = arrived * firmware.period_ns
            arrival_ns = own_clock_ns(nominal_ns, clock_error_ppm)
            arrivals[0] = arrived + 1
            sent = firmware.step_whole(firmware.inbox, count, arrival_ns)
        epoch = firmware.epoch
        if sent != NOTHING:
            port.send(firmware.outbox, sent, epoch, epoch * firmware.period_ns)
        if on_epoch is not None and epoch % every == 0:
            on_epoch(epoch)


class _OwnClock:
    """The firmware's clock: monotonic time since power-on, with a rate error in ppm."""

    def __init__(self, error_ppm: float) -> None:
        self._origin_ns = time.monotonic_ns()
        self._error_ppm = error_ppm

    def now_ns(self) -> int:
        return own_clock_ns(time.monotonic_ns() - self._origin_ns, self._error_ppm)


class _Intake:
    """Gathers frames between two steps and notes the arrival of SYNC."""

    def __init__(self, firmware: Firmware, port: Port, clock: _OwnClock) -> None:
        self._firmware = firmware
        self._port = port
        self._clock = clock
        self._inbox = firmware.inbox
        self._ids = firmware.inbox["can_id"]
        self._last_id = int(firmware.contract[0].axis_outer_status.message.can_id)
        self.count = 0
        self._arrivals_ns: deque[int] = deque([0])

    @property
    def sync_arrival_ns(self) -> int:
        """Arrival of the first SYNC in the inbox, or else of the last one processed."""
        return self._arrivals_ns[0]

    def gather_until(self, deadline_ns: int, grace_ns: int) -> int:
        """Gather frames until the deadline, then until the epoch is complete or the grace is over.

        The grace is a time in which the machine ran: it begins anew after a stall, for which the
        other side may have stood still, too. Returns how late after the deadline its wait ended.
        """
        late_ns = self._gather(deadline_ns)
        if grace_ns:
            self._wait_in_slices(grace_ns // _GRACE_SLICES)
        return late_ns

    def _wait_in_slices(self, slice_ns: int) -> None:
        """Gather frames until the epoch is complete, or all slices of the grace were on time."""
        on_time = 0
        for _ in range(_GRACES_AT_MOST * _GRACE_SLICES):
            if on_time == _GRACE_SLICES or self._is_whole():
                return
            late_ns = self._gather(self._clock.now_ns() + slice_ns, until_whole=True)
            on_time = 0 if 2 * late_ns > slice_ns else on_time + 1

    def _is_whole(self) -> bool:
        return bool(np.any(self._ids[: self.count] == self._last_id))

    def _gather(self, deadline_ns: int, until_whole: bool = False) -> int:
        """Gather frames until the deadline, and any pending then; return the lateness."""
        late_ns = -1
        while self.count < len(self._inbox):
            now_ns = self._clock.now_ns()
            if now_ns >= deadline_ns and late_ns < 0:
                late_ns = now_ns - deadline_ns
            came = self._port.receive(self._inbox[self.count :], max(0, deadline_ns - now_ns))
            if came:
                self._note_arrivals(came)
            self.count += came
            if (late_ns >= 0 and not came) or (until_whole and self._is_whole()):
                break
        return max(0, late_ns)

    def _note_arrivals(self, came: int) -> None:
        """Note the time of every SYNC among the new frames."""
        syncs = self._syncs(self.count, self.count + came)
        if syncs:
            if not self._syncs(0, self.count):
                self._arrivals_ns.clear()
            self._arrivals_ns.extend([self._clock.now_ns()] * syncs)

    def _syncs(self, start: int, end: int) -> int:
        return int(np.count_nonzero(self._ids[start:end] == self._firmware.sync_id))

    def drop(self, consumed: int) -> None:
        """Drop the frames that a step has consumed."""
        for _ in range(min(self._syncs(0, consumed), len(self._arrivals_ns) - 1)):
            self._arrivals_ns.popleft()
        left = self.count - consumed
        if left:
            self._inbox[:left] = self._inbox[consumed : self.count].copy()
        self.count = left


def run_realtime(
    firmware: Firmware,
    port: Port,
    lateness: Lateness,
    clock_error_ppm: float = 0.0,
    every: int = 0,
    on_epoch: Callable[[int], None] | None = None,
) -> None:
    """Run by the firmware's own clock until shut down.

    The deadline of an epoch is half a period after its SYNC is expected. The loop waits for late
    frames for one more period without a stall, unless SYNC is lost. A step that misses its deadline
    by more than a period is an overrun: its axis commands may not arrive in time.
    """
    clock = _OwnClock(clock_error_ppm)
    intake = _Intake(firmware, port, clock)
    firmware.diagnostics.writer = ThreadWriter()  # a disk write may take many periods
    own = firmware.ram["clock"]
    synchronised, sync_lost = own["synchronised"], own["sync_lost"]
    next_sync_ns = own["next_sync_ns"]
    overruns = firmware.ram["faults"]["overruns"]
    load_percent = firmware.ram["load_percent"]
    period_ns = firmware.period_ns
    deadline_ns = clock.now_ns() + period_ns
    while not firmware.is_shut_down:
        is_followed = bool(synchronised[0]) and not sync_lost[0]
        late_ns = intake.gather_until(deadline_ns, period_ns if is_followed else 0)
        if synchronised[0]:
            lateness.add(late_ns, late_ns > period_ns)
            overruns[0] += late_ns > period_ns
        begin_ns = clock.now_ns()
        sent, consumed = firmware.step(firmware.inbox, 0, intake.count, intake.sync_arrival_ns)
        intake.drop(consumed)
        port.send(firmware.outbox, sent, firmware.epoch, firmware.epoch * period_ns)
        _note_load(load_percent, clock.now_ns() - begin_ns, period_ns)
        if synchronised[0]:
            deadline_ns = int(next_sync_ns[0]) + period_ns // 2
        else:
            deadline_ns += period_ns
        if on_epoch is not None and firmware.epoch % every == 0:
            on_epoch(firmware.epoch)


def _note_load(load_percent: Floats, busy_ns: int, period_ns: int) -> None:
    """Track the share of the period spent computing, averaged over about 16 epochs."""
    load_percent += (100.0 * busy_ns / period_ns - load_percent) / 16.0
