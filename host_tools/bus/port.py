"""A side's port on the embedded bus, which moves whole epochs; the address of any bus."""

from __future__ import annotations

import errno
import time
from typing import Any

import can
import numpy as np

from rrins.compiled.record import Records, Words
from rrins.dbc import direct as direct_exchange
from rrins.dbc.direct import Direct
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.bus.batch import Batch
from rrins.host_tools.bus.channel import NoHostError
from rrins.host_tools.bus.datagram import CLASSIC
from rrins.host_tools.bus.guard import BusSummary
from rrins.host_tools.bus.interface import ANSWER_S, RrinsBus
from rrins.host_tools.bus.message import identifier_of
from rrins.host_tools.errors import BusError, SideLostError

_ATTACH_S = 300.0  # the other side may compile first, on a busy machine for minutes
_POLL_S = 0.2
_RETRY_S = 0.02
_KEPT_FREE = 1024  # room for the frames of a side, whatever others send


class BusNotThereError(BusError):
    """Nobody hosts the channel of the embedded bus."""


class PortClosedError(BusError):
    """The bus ended while a side was using it."""


def open_bus(address: Address, **wishes: Any) -> can.BusABC:
    """Open a python-can bus.

    Raises
    ------
    BusError
        If it cannot be opened; the message, one line, names the bus and the reason.
    """
    if address.bitrate is not None:
        wishes["bitrate"] = address.bitrate
    try:
        if address.is_embedded:
            return RrinsBus(channel=address.channel, **wishes)
        return can.Bus(interface=address.interface, channel=address.channel, **wishes)
    except can.CanInitializationError as error:
        if isinstance(error.__cause__, NoHostError):
            raise BusNotThereError(
                f"bus {address}: not running; start `rrins hardware --channel "
                f"{address.channel}` or a rehearsal on it first"
            ) from error
        raise BusError(f"bus {address}: {_one_line(error)}") from error
    except (can.CanError, OSError, ImportError, ValueError, TypeError) as error:
        raise BusError(f"bus {address}: cannot be opened: {_one_line(error)}") from error


_HINTS = {
    errno.EAFNOSUPPORT: " (this kernel has no SocketCAN)",
    errno.ENODEV: " (`ip link` lists the interfaces)",
    errno.ENETDOWN: " (bring it up with `ip link set … up`)",
}


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    number = error.errno if isinstance(error, OSError) else getattr(error, "error_code", None)
    return text + _HINTS.get(number or 0, "")


def open_when_there(address: Address, wait_s: float, **wishes: Any) -> can.BusABC:
    """Open an embedded bus, waiting up to `wait_s` seconds for its host.

    The host may also take that long to answer, as it may be busy.

    Raises
    ------
    BusNotThereError
        If nobody hosts it by then.
    """
    deadline_ns = time.monotonic_ns() + round(wait_s * 1e9)
    wishes = {"attach_timeout": max(wait_s, ANSWER_S)} | wishes
    while True:
        try:
            return open_bus(address, **wishes)
        except BusNotThereError:
            if time.monotonic_ns() >= deadline_ns:
                raise
        time.sleep(_RETRY_S)


class BatchPort:
    """A side on the embedded bus.

    Parameters
    ----------
    address : Address
    side : {"firmware", "hardware"}
        The hardware hosts the bus and waits for the firmware to attach.
    attach_wait_s : float
        Longest wait of the firmware for the bus.
    foreign_senders : bool
        Whether the hardware, which hosts the bus, lets others send what is the sides'.
    keeps : bool
        Whether the hardware goes on without a firmware until one attaches again. In lockstep time
        stands still meanwhile, and what the lost one has not answered counts as unanswered.
    """

    def __init__(
        self,
        address: Address,
        side: Side,
        attach_wait_s: float = 0.0,
        foreign_senders: bool = False,
        keeps: bool = False,
    ) -> None:
        self._address = address
        self._other = "hardware" if side == "firmware" else "firmware"
        self._attach_s = _ATTACH_S
        self._keeps = keeps
        self._other_number = 0  # of the node that is the other side
        self._is_host = side == "hardware"
        wishes: dict[str, Any] = {"name": side, "exclusive": True}
        if self._is_host:
            bus = open_bus(address, host="here", foreign_senders=foreign_senders, **wishes)
        else:
            bus = open_when_there(address, attach_wait_s, host="never", **wishes)
        assert isinstance(bus, RrinsBus)
        self._bus = bus

    def meet(self, others: tuple[str, ...] = ()) -> None:
        """Wait until the other side and all named others have attached."""
        if not self._is_host:
            return
        self._bus.limit_others()  # what they sent before would be in the sides' way
        for name in (*others, self._other):
            try:
                self._other_number = self._bus.wait_for(name, self._attach_s).number
            except can.CanError as error:
                raise SideLostError(
                    f"bus {self._address}: no {name} attached within {self._attach_s:.0f} s"
                ) from error
        if not self._keeps:
            self._bus.require([self._other])

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames and close the epoch."""
        try:
            self._bus.send_batch(frames, count, epoch=epoch, time_ns=time_ns, closes_epoch=True)
        except can.CanError as error:
            raise self._closed(error) from error

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the other side has closed its epoch; return the number of frames received."""
        count = 0
        while True:
            batch = self._receive(into[count:] if count else into, None)
            if batch is None:  # the other side is another one now
                return count
            count += batch.count
            if batch.closes_epoch:
                return count
            count = min(count, len(into) - _KEPT_FREE)  # someone else's frames came first

    def receive(self, into: FrameArray, timeout_ns: int) -> int:
        """Wait up to `timeout_ns` for frames; return the number received, possibly 0."""
        batch = self._receive(into, timeout_ns * 1e-9)
        return 0 if batch is None else batch.count

    def lend(self, direct: Records[Direct]) -> bool:
        """Tell compiled code of the other side's socket.

        Returns False while it is not to use it: somebody else is on the bus, or something waits.
        """
        return direct_exchange.AVAILABLE and self._bus.lend(direct[0])

    def take_back(self, direct: Records[Direct], words: Words) -> None:
        """Go on where compiled code has left off.

        Parameters
        ----------
        direct : Records[Direct]
        words : array
            Begins with what compiled code has received and not used.
        """
        lent = direct[0]
        left_over = words.view(np.uint8).data[: int(lent.left_over)]
        self._bus.take_back(left_over, int(lent.time_ns), int(lent.batches))

    def rest(self, seconds: float) -> None:
        """Wait, and serve the bus meanwhile if this side hosts it."""
        if not self._is_host:
            time.sleep(seconds)
            return
        try:
            self._bus.rest(seconds)
        except can.CanError as error:
            raise self._closed(error) from error

    def dismiss(self) -> None:
        """Allow the other side to leave; do not treat it as a fault."""
        if self._is_host:
            self._bus.require([])

    def await_end(self, into: FrameArray) -> None:
        """Wait until the other side, which has lost its power, is gone; forget what it has sent."""
        self.dismiss()
        while self.has_other() or self._bus.recv_batch(into, 0.0) is not None:
            self.rest(_POLL_S / 100)

    def await_other(self) -> None:
        """Wait for the other side that comes in place of the one that is gone."""
        self._other_number = self._bus.wait_for(self._other, self._attach_s).number
        if not self._keeps:
            self._bus.require([self._other])

    def has_other(self) -> bool:
        """Return whether the other side is attached; always False on the firmware's side."""
        return self._is_host and any(peer.name == self._other for peer in self._bus.peers)

    def statistics(self) -> BusSummary | None:
        """Return what the bus did not let through; None for a side that does not host it."""
        return self._bus.statistics() if self._is_host else None

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()

    def _receive(self, into: FrameArray, timeout: float | None) -> Batch | None:
        """Receive a batch; without a timeout None says that the other side is another one now."""
        try:
            if timeout is not None:
                return self._bus.recv_batch(into, timeout)
            since_ns = time.monotonic_ns()
            while (batch := self._bus.recv_batch(into, _POLL_S)) is None:
                self._note_silence(since_ns)
                if self._keeps and self._is_replaced():
                    return None
            return batch
        except can.CanError as error:
            raise self._closed(error) from error

    def _is_replaced(self) -> bool:
        """Return whether the other side has gone; wait then until another one is there."""
        if self._other_number in [peer.number for peer in self._bus.peers]:
            return False
        self._other_number = self._bus.wait_for(self._other).number
        return True

    def _note_silence(self, since_ns: int) -> None:
        """Take note that the other side has not closed its epoch since a time; for subclasses."""

    def _closed(self, error: can.CanError) -> SideLostError:
        return SideLostError(f"bus {self._address}: {self._other} is gone: {error}")


def frame_of_message(frame: Frame, message: can.Message) -> None:
    """Write a classic python-can message into a frame."""
    frame["can_id"] = identifier_of(message)
    frame["length"] = min(message.dlc, 8)
    frame["data"] = int.from_bytes(message.data[:8], "little")


def message_of_frame(frame: Frame, timestamp: float = 0.0) -> can.Message:
    """Return the python-can message of a data frame with a standard identifier."""
    can_id, length, data = CLASSIC.unpack(frame.tobytes())
    return can.Message(
        timestamp=timestamp, arbitration_id=can_id, is_extended_id=False, data=data[:length]
    )
