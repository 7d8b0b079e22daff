"""An epoch exchange: the hardware opens an epoch, the firmware steps, its frames go back.

`exchange_epoch` runs one from Python. `DirectExchange` runs one after the other in compiled code,
and is back in Python for whatever asks for it: diagnostics, a report, a log.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import F8, I8, Bool, Floats, Record, Records
from rrins.dbc.contract import Contract
from rrins.dbc.e2e import MessageLayout
from rrins.dbc.frame import FrameArray, frame_array
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.core.modes.modes import navigating
from rrins.firmware_py.core.records.memory import NavigationOutput, Ram
from rrins.firmware_py.core.step import firmware_step
from rrins.firmware_py.exchange import exchange_record
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.memory import Plant, Truth
from rrins.host_tools.hardware.step import hardware_step
from rrins.host_tools.runs.results.samples import SampleBuffer
from rrins.host_tools.wire.effects import (
    FRAMES,
    Effect,
    LateFrame,
    Node,
    Passage,
    affect,
    has_room,
)
from rrins.host_tools.wire.faults import WireFaults
from rrins.host_tools.wire.wire import Wire

_FIRMWARE, _HARDWARE = int(Node.FIRMWARE), int(Node.HARDWARE)


def exchange_epoch(
    hardware: Hardware, firmware: Firmware, epoch: int, count: int, clock_error_ppm: float = 0.0
) -> int:
    """Run an epoch of both sides in one process.

    Parameters
    ----------
    firmware : Firmware
        Its `outbox` has the frames that the hardware gets.
    count : int
        How many these are: what the exchange before returned; 0 in the first epoch.
    clock_error_ppm : float
        By how much the firmware's clock runs fast.

    Returns
    -------
    int
        Frames in the firmware's `outbox` now, for the next exchange.
    """
    was_on, is_on = hardware.has_power(epoch - 1), hardware.has_power(epoch)
    frames, sent = hardware.open_epoch(epoch, firmware.outbox, count)
    if not is_on:
        return 0
    if not was_on:
        firmware.power_on()
    count = answer_epoch(firmware, frames, sent, epoch, clock_error_ppm)
    hardware.frames_received += count
    return count


def answer_epoch(
    firmware: Firmware, frames: FrameArray, count: int, epoch: int, clock_error_ppm: float = 0.0
) -> int:
    """Let the firmware step on the frames of an epoch that is open; the half of an exchange.

    Returns how many frames its `outbox` has now.
    """
    arrival_ns = own_clock_ns(epoch * firmware.period_ns, clock_error_ppm)
    return firmware.step_whole(frames, count, arrival_ns)


class Mark(Record):
    """An epoch of which the frames are kept."""

    up: I8  #: frames of the hardware
    down: I8  #: frames of the firmware
    firmware_epoch: I8  #: which epoch it was by the firmware's count


class _Between(Record):
    """Values that `DirectExchange` and its compiled part exchange."""

    count: I8  #: frames in the firmware's outbox
    until: I8  #: epoch that is not run any more
    every: I8  #: epochs that are a multiple of this are the last of a call; 0: none
    truth_every: I8  #: epochs that are a multiple of this are kept of the truth
    is_disturbed: Bool  #: whether faults act on the wire
    clock_error_ppm: F8  #: of the firmware's clock
    navigation_rows: I8  #: navigation outputs that were written
    truth_rows: I8  #: truths that were written
    used: I8  #: frames that the firmware used
    up: I8  #: frames that the firmware received
    down: I8  #: frames that the firmware sent, but for those of the last epoch
    kept: I8  #: frames that were kept
    marks: I8  #: epochs of which frames were kept


@compiled_with(nogil=True)
def _exchange_epochs(
    plants: Records[Plant],
    pieces: Floats,
    ram: Records[Ram],
    contract: Records[Contract],
    up: FrameArray,
    down: FrameArray,
    compares: bool | None,
    estimates: bool | None,
    navigation: Records[NavigationOutput],
    truth: Records[Truth],
    effects: Records[Effect],
    passages: Records[Passage],
    late_up: Records[LateFrame],
    late_down: Records[LateFrame],
    layouts: Records[MessageLayout],
    heard_up: FrameArray,
    heard_down: FrameArray,
    kept: FrameArray,
    marks: Records[Mark],
    betweens: Records[_Between],
) -> None:
    """Run epochs of both sides until one asks for Python, is due, or has filled a buffer.

    Where there are marks, the frames of both sides are kept, but for those of the firmware in the
    last epoch.
    """
    plant, state, between = plants[0], ram[0], betweens[0]
    between.navigation_rows = between.truth_rows = 0
    between.used = between.up = between.down = between.kept = between.marks = 0
    most = len(heard_up) + len(down)
    while True:
        epoch = plant.epoch
        count, commands, arrived = between.count, down, up
        if between.is_disturbed and epoch > 0:
            commands = heard_down
            count = affect(
                effects, passages, late_down, layouts, _FIRMWARE, down, count, epoch - 1, commands
            )
        sent = hardware_step(plants, pieces, contract, commands, count, up)
        if between.is_disturbed:
            arrived = heard_up
            sent = affect(effects, passages, late_up, layouts, _HARDWARE, up, sent, epoch, arrived)
        state.clock.sync_arrival_ns = own_clock_ns(epoch * plant.period_ns, between.clock_error_ppm)
        state.clock.is_whole = True
        between.count = firmware_step(ram, contract, arrived, 0, sent, down, compares, estimates)
        between.up += sent
        between.used += state.consumed
        if len(marks) > 0:
            mark = marks[between.marks]
            mark.up, mark.down, mark.firmware_epoch = sent, between.count, state.epoch
            between.marks += 1
            _keep(kept, between, arrived, sent)
        if navigating(state):
            navigation[between.navigation_rows] = state.navigation
            between.navigation_rows += 1
        if epoch % between.truth_every == 0:
            truth[between.truth_rows] = plant.truth
            between.truth_rows += 1
        is_full = between.navigation_rows == len(navigation) or between.truth_rows == len(truth)
        if len(marks) > 0:
            is_full |= between.marks == len(marks) or between.kept + 2 * most > len(kept)
        is_due = between.every > 0 and epoch % between.every == 0
        is_last = plant.epoch >= between.until
        is_short = not (
            has_room(passages[0], late_up, _HARDWARE)
            and has_room(passages[0], late_down, _FIRMWARE)
        )
        if is_full or is_due or is_last or is_short or state.diagnostics.attention:
            return
        between.down += between.count
        if len(marks) > 0:
            _keep(kept, between, down, between.count)


@compiled
def _keep(kept: FrameArray, between: _Between, frames: FrameArray, count: int) -> None:
    """Keep the first frames of an array."""
    for k in range(count):
        kept[between.kept + k] = frames[k]
    between.kept += count


class DirectExchange:
    """Both sides in one process, epoch after epoch.

    Parameters
    ----------
    firmware : Firmware
        Both just switched on.
    truth : SampleBuffer
        Takes the truth of the epochs that are a multiple of `truth_every`.
    clock_error_ppm : float
        By how much the firmware's clock runs fast.
    wire : Wire, optional
        That of the hardware.
    kept : FrameArray, optional
        Takes the frames of the epochs of a call, of the hardware and of the firmware in turn, but
        for the firmware's last, which are in its outbox. Has room for two epochs at least.
    """

    def __init__(
        self,
        hardware: Hardware,
        firmware: Firmware,
        truth: SampleBuffer[Truth],
        truth_every: int,
        clock_error_ppm: float = 0.0,
        wire: Wire | None = None,
        kept: FrameArray | None = None,
    ) -> None:
        self._wire = wire
        self._kept = frame_array(0) if kept is None else kept
        self._marks = Mark.zeros(0 if kept is None else len(kept))
        self._faults = WireFaults((), 0) if wire is None else wire.faults
        most = len(hardware.outbox) if wire is None else FRAMES
        self._heard = frame_array(most), frame_array(most)
        self._hardware, self._firmware = hardware, firmware
        self._truth = truth
        self._between = _Between.zeros()
        self._between[0].truth_every = truth_every
        self._between[0].clock_error_ppm = clock_error_ppm
        self._result = exchange_record()

    @property
    def count(self) -> int:
        """Frames in the firmware's outbox, for the hardware's next epoch."""
        return int(self._between[0].count)

    @count.setter
    def count(self, count: int) -> None:
        self._between[0].count = count

    @property
    def marks(self) -> Records[Mark]:
        """The epochs of the last call whose frames were kept."""
        return self._marks[: int(self._between[0].marks)]

    def run(self, until: int, every: int) -> int:
        """Run one epoch or more; return the last one.

        Parameters
        ----------
        until : int
            Epoch that is not run any more; more than the next one.
        every : int
            An epoch that is a multiple of this is the last one of a call; 0: none is.
        """
        hardware, firmware, between = self._hardware, self._firmware, self._between[0]
        firmware.restart_if_due()
        wire, epoch = self._wire, hardware.epoch
        until = min(until, hardware.fault_server.report_epoch)
        if wire is not None:
            until = min(until, wire.same_until(epoch))
        if firmware.is_awake or epoch >= until or not hardware.has_power(epoch - 1):
            between.count = exchange_epoch(
                hardware, firmware, epoch, int(between.count), float(between.clock_error_ppm)
            )
            if epoch % between.truth_every == 0:
                self._truth.append(hardware.truth)
            return epoch
        between.until, between.every = until, every
        faults = self._faults
        between.is_disturbed = faults.acts(epoch)
        faults.make_room()
        _exchange_epochs(
            hardware.plant,
            hardware.pieces,
            firmware.ram,
            firmware.contract,
            hardware.outbox,
            firmware.outbox,
            firmware.compares,
            firmware.estimates,
            firmware.trace.room,
            self._truth.room,
            faults.effects,
            faults.passages,
            faults.late[Node.HARDWARE],
            faults.late[Node.FIRMWARE],
            faults.layouts,
            *self._heard,
            self._kept,
            self._marks,
            self._between,
        )
        self._settle()
        return hardware.epoch - 1

    def _settle(self) -> None:
        """Account for what the compiled part did, and let diagnostics see its last epoch."""
        hardware, between, result = self._hardware, self._between[0], self._result[0]
        self._truth.add(int(between.truth_rows))
        result.rows, result.received = between.navigation_rows, between.used
        result.sent, result.to_send = between.down, between.count
        between.count = self._firmware.settle(self._result, hardware.outbox, 0)
        hardware.frames_sent += int(between.up)
        hardware.frames_received += int(between.down + between.count)
