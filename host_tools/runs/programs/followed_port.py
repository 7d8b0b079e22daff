"""The hardware's port where the firmware is the user's own program: it is followed and watched.

A program that hangs, floods the bus or never attaches is told in one line, instead of a wait.
"""

from __future__ import annotations

import time
from typing import Final

import can

from rrins.compiled.record import Records
from rrins.dbc.direct import Direct
from rrins.dbc.frame import FrameArray
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.batch import Batch
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.bus.port import BatchPort
from rrins.host_tools.errors import SideLostError
from rrins.host_tools.runs.programs.follower import Follower

FRAMES_PER_S: Final = 25_000
"""More than 1 Mbit/s carries, of frames without data: who sends more in a second floods the bus."""

_ATTACH_S: Final = 30.0  # nothing of the user's program is compiled at its start
_BURST: Final = 256  # frames that may come in one epoch beyond its share


class Watch:
    """Knows how long the firmware has been silent, and how much it sends.

    Parameters
    ----------
    name : str
        What the program is called.
    patience_s : float
        Longest silence in wall clock time; 0 waits for ever.
    rate_hz : int
        Epochs per second.
    """

    def __init__(self, name: str, follower: Follower, patience_s: float, rate_hz: int) -> None:
        self._name = name
        self._follower = follower
        self._rate_hz = rate_hz
        self._share = FRAMES_PER_S / rate_hz
        self._level = 0.0
        self._heard_ns = time.monotonic_ns()
        self.patience_s = patience_s
        self.epoch = 0

    @property
    def _at(self) -> str:
        return f"in epoch {self.epoch} ({self.epoch / self._rate_hz:.3f} s)"

    def open_epoch(self, epoch: int) -> None:
        """Take note that the hardware opens an epoch."""
        self.epoch = epoch
        self._level = max(0.0, self._level - self._share)

    def take(self, frames: FrameArray, count: int) -> None:
        """Take the frames that came in the epoch.

        Raises
        ------
        SideLostError
            If they are too many.
        """
        if count:
            self._heard_ns = time.monotonic_ns()
            self.count(count)
            self._follower.take(frames, count, self.epoch)

    def count(self, frames: int) -> None:
        """Count frames.

        Raises
        ------
        SideLostError
            If they are too many.
        """
        self._level += frames
        if self._level > FRAMES_PER_S + _BURST:
            raise SideLostError(
                f"{self._name} floods the bus: more than {FRAMES_PER_S} frames in a second, "
                f"{self._at}"
            )

    def hangs(self, what: str) -> SideLostError:
        """Return the error of a firmware that no longer answers."""
        return SideLostError(f"{self._name} {what} for {self.patience_s:g} s, {self._at}: it hangs")

    def stays_away(self, error: SideLostError) -> SideLostError:
        """Return the error of a firmware that has not come, from that of the port."""
        return SideLostError(f"{self._name} has not come: {error}")

    def is_too_long(self, since_ns: int) -> bool:
        """Return whether a silence that began at a time lasts longer than the patience."""
        return bool(self.patience_s) and (time.monotonic_ns() - since_ns) * 1e-9 > self.patience_s

    def check_silence(self) -> None:
        """Check, in real time, that the firmware still sends.

        Raises
        ------
        SideLostError
            If it has been silent for too long.
        """
        if self.is_too_long(self._heard_ns):
            raise self.hangs("has sent nothing")

    def begin(self) -> None:
        """Begin to wait for the firmware."""
        self._heard_ns = time.monotonic_ns()


class FollowedBatchPort(BatchPort):
    """The hardware on the embedded bus, with a watch on the firmware.

    Parameters
    ----------
    foreign_senders, keeps : bool
        As of `BatchPort`.
    """

    def __init__(
        self, address: Address, watch: Watch, foreign_senders: bool = False, keeps: bool = False
    ) -> None:
        self._watch = watch
        super().__init__(address, "hardware", foreign_senders=foreign_senders, keeps=keeps)
        if watch.patience_s:
            self._attach_s = max(_ATTACH_S, watch.patience_s)

    def meet(self, others: tuple[str, ...] = ()) -> None:
        """Wait until the firmware and all named others have attached.

        Raises
        ------
        SideLostError
            If the program does not come.
        """
        try:
            super().meet(others)
        except SideLostError as error:
            raise self._watch.stays_away(error) from error
        self._watch.begin()

    def lend(self, direct: Records[Direct]) -> bool:
        """Return False: all that the program sends is looked at."""
        return False

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames and close the epoch."""
        self._watch.open_epoch(epoch)
        super().send(frames, count, epoch, time_ns)

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the firmware has closed its epoch; return the number of frames received."""
        count = super().receive_epoch(into)
        self._watch.take(into, count)
        return count

    def receive(self, into: FrameArray, timeout_ns: int) -> int:
        """Wait up to `timeout_ns` for frames; return the number received, possibly 0."""
        count = super().receive(into, timeout_ns)
        self._watch.take(into, count)
        self._watch.check_silence()
        return count

    def _receive(self, into: FrameArray, timeout: float | None) -> Batch | None:
        batch = super()._receive(into, timeout)
        if timeout is None and batch is not None and not batch.closes_epoch:
            self._watch.count(batch.count)
        return batch

    def _note_silence(self, since_ns: int) -> None:
        if self._watch.is_too_long(since_ns):
            raise self._watch.hangs("has not closed its epoch")


class FollowedMessagePort(MessagePort):
    """The hardware on any python-can bus, with a watch on the firmware."""

    def __init__(
        self, address: Address, watch: Watch, bus: can.BusABC | None = None, keeps: bool = False
    ) -> None:
        self._watch = watch
        super().__init__(address, "hardware", bus, keeps)

    def meet(self, others: tuple[str, ...] = ()) -> None:
        """Wait for the firmware's heartbeat."""
        super().meet(others)
        self._watch.begin()

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames."""
        self._watch.open_epoch(epoch)
        super().send(frames, count, epoch, time_ns)

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the firmware has closed its epoch; return the number of frames received."""
        count = super().receive_epoch(into)
        self._watch.take(into, count)
        return count

    def receive(self, into: FrameArray, timeout_ns: int) -> int:
        """Wait up to `timeout_ns` for frames; return their number."""
        count = super().receive(into, timeout_ns)
        self._watch.take(into, count)
        self._watch.check_silence()
        return count


def open_followed_port(
    address: Address, watch: Watch, foreign_senders: bool = False, keeps: bool = False
) -> FollowedBatchPort | FollowedMessagePort:
    """Open the hardware's port with a watch on the firmware.

    Raises
    ------
    BusError
        If the bus does not exist, or another hardware is on it.
    """
    if address.is_embedded:
        return FollowedBatchPort(address, watch, foreign_senders, keeps)
    return FollowedMessagePort(address, watch, keeps=keeps)
