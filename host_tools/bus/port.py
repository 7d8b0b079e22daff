"""A side's port on the bus: any python-can bus, presented to the shells as epochs of frames.

`BatchPort` moves whole epochs over the embedded bus; `MessagePort` serves every other python-can
interface, frame by frame. In lockstep over the latter, each side's last frame closes an epoch; the
other side waits for it for at most `_LOCKSTEP_PATIENCE_NS`.
"""

from __future__ import annotations

import errno
import time
from dataclasses import dataclass
from typing import Any, Literal

import can
import numpy as np

from rrins.compiled.record import Records, Words
from rrins.dbc import direct as direct_exchange
from rrins.dbc.contract import load_contract
from rrins.dbc.direct import Direct
from rrins.dbc.e2e import fill
from rrins.dbc.frame import ERR_FLAG, Frame, FrameArray, frame_array
from rrins.host_tools.bus.batch import Batch, bytes_of
from rrins.host_tools.bus.channel import NoHostError
from rrins.host_tools.bus.datagram import CLASSIC, FRAME_SIZE
from rrins.host_tools.bus.guard import BusSummary
from rrins.host_tools.bus.interface import ANSWER_S, RrinsBus
from rrins.host_tools.bus.message import identifier_of, is_classic, put_message
from rrins.host_tools.errors import BusError, SideLostError

Side = Literal["firmware", "hardware"]

EMBEDDED = "rrins"
"""The python-can interface name of the embedded bus."""

_ATTACH_S = 300.0  # the other side may compile first, on a busy machine for minutes
_ANNOUNCE_NS = 200_000_000
_LOCKSTEP_PATIENCE_NS = 30_000_000_000
_POLL_S = 0.2
_RETRY_S = 0.02
_NO_FRAMES = frame_array(0)
_KEPT_FREE = 1024  # room for the frames of a side, whatever others send


class BusNotThereError(BusError):
    """Nobody hosts the channel of the embedded bus."""


class PortClosedError(BusError):
    """The bus ended while a side was using it."""


@dataclass(frozen=True)
class Address:
    """Address of a bus: a python-can interface, its channel and, if needed, its bit rate."""

    interface: str
    channel: str
    bitrate: int | None = None

    def __str__(self) -> str:
        return f"{self.interface}:{self.channel}"

    @property
    def is_embedded(self) -> bool:
        """Whether this is the embedded bus."""
        return self.interface == EMBEDDED


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
    """

    def __init__(
        self,
        address: Address,
        side: Side,
        attach_wait_s: float = 0.0,
        foreign_senders: bool = False,
    ) -> None:
        self._address = address
        self._other = "hardware" if side == "firmware" else "firmware"
        self._attach_s = _ATTACH_S
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
                self._bus.wait_for(name, self._attach_s)
            except can.CanError as error:
                raise SideLostError(
                    f"bus {self._address}: no {name} attached within {self._attach_s:.0f} s"
                ) from error
        self._bus.require([self._other])

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames and close the epoch."""
        try:
            self._bus.send_batch(frames, count, epoch=epoch, time_ns=time_ns, closes_epoch=True)
        except can.CanError as error:
            raise self._closed(error) from error

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the other side has closed its epoch; return the number of frames received."""
        batch = self._receive(into, None)
        assert batch is not None
        count = batch.count
        while not batch.closes_epoch:  # someone else's frames came first
            count = min(count, len(into) - _KEPT_FREE)
            batch = self._receive(into[count:], None)
            assert batch is not None
            count += batch.count
        return count

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
        self._bus.take_back(words.view(np.uint8).data[: int(lent.left_over)], int(lent.time_ns))

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
        try:
            return self._bus.recv_batch(into, timeout)
        except can.CanError as error:
            raise self._closed(error) from error

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


class MessagePort:
    """A side on any python-can bus, frame by frame.

    Parameters
    ----------
    address : Address
    side : {"firmware", "hardware"}
    bus : can.BusABC, optional
        An open bus, closed by the port.
    """

    def __init__(self, address: Address, side: Side, bus: can.BusABC | None = None) -> None:
        contract = load_contract()[0]
        closing = {
            "firmware": int(contract.axis_outer_command.message.can_id),
            "hardware": int(contract.axis_outer_status.message.can_id),
        }
        other: Side = "hardware" if side == "firmware" else "firmware"
        self._address = address
        self._side = side
        self._other = other
        self._own_last = closing[side]
        self._others_last = closing[other]
        self._heartbeat = contract.heartbeat_firmware.message
        self._heartbeat_id = int(self._heartbeat.can_id)
        self._held: can.Message | None = None
        self._is_broken = False
        self._into: FrameArray = _NO_FRAMES  # the array of the last `receive_epoch`, as bytes
        self._into_bytes = bytes_of(_NO_FRAMES)
        self._bus = open_bus(address) if bus is None else bus

    def meet(self, others: tuple[str, ...] = ()) -> None:
        """Wait for the other side; `others` are ignored, as such a bus cannot identify them.

        The firmware announces itself by its heartbeat until the hardware opens the first epoch.

        Raises
        ------
        BusError
            If another firmware, or another hardware, is active on this bus.
        """
        if self._side == "firmware":
            self._announce()
        else:
            self._await_heartbeat()

    def _announce(self) -> None:
        hello = frame_array(1)
        next_ns = time.monotonic_ns() + _ANNOUNCE_NS
        while True:
            message = self._receive(_POLL_S / 4)
            if message is not None:
                if message.arbitration_id in (self._own_last, self._heartbeat_id):
                    raise BusError(f"bus {self._address}: another firmware is already on it")
                self._held = message
                return
            if time.monotonic_ns() >= next_ns:
                fill(hello[0], self._heartbeat, np.uint64(0), 0)
                self._send(message_of_frame(hello[0]))
                next_ns += _ANNOUNCE_NS

    def _await_heartbeat(self) -> None:
        deadline_ns = time.monotonic_ns() + round(_ATTACH_S * 1e9)
        while time.monotonic_ns() < deadline_ns:
            message = self._receive(_POLL_S)
            if message is None:
                continue
            if message.arbitration_id == self._own_last:
                raise BusError(f"bus {self._address}: another hardware is already on it")
            if message.arbitration_id == self._heartbeat_id:
                return
        raise SideLostError(f"bus {self._address}: no firmware heard within {_ATTACH_S:.0f} s")

    def send(self, frames: FrameArray, count: int, epoch: int, time_ns: int) -> None:
        """Send an epoch's frames; the last one closes the epoch."""
        for can_id, length, data in CLASSIC.iter_unpack(frames[:count].tobytes()):
            if not can_id & ERR_FLAG:  # error frames are never sent
                self._send(can.Message(0.0, can_id, False, data=data[:length]))

    def _send(self, message: can.Message) -> None:
        try:
            self._bus.send(message, timeout=1.0)
        except can.CanError as error:
            self._is_broken = True
            raise PortClosedError(f"bus {self._address}: cannot send: {error}") from error

    def _receive(self, timeout: float) -> can.Message | None:
        if self._held is not None:
            message, self._held = self._held, None
            return message
        try:
            return self._bus.recv(timeout)
        except can.CanError as error:
            self._is_broken = True
            raise PortClosedError(f"bus {self._address}: cannot receive: {error}") from error

    def receive_epoch(self, into: FrameArray) -> int:
        """Wait until the other side has closed its epoch; return the number of frames received.

        Raises
        ------
        SideLostError
            If nothing arrives for half a minute.
        """
        count = 0
        if into is not self._into:
            self._into, self._into_bytes = into, bytes_of(into)
        room, bytes_into = len(into), self._into_bytes
        deadline_ns = time.monotonic_ns() + _LOCKSTEP_PATIENCE_NS
        while True:
            message = self._receive(_POLL_S)
            if message is None:
                if time.monotonic_ns() > deadline_ns:
                    patience_s = _LOCKSTEP_PATIENCE_NS // 1_000_000_000
                    raise SideLostError(
                        f"bus {self._address}: {self._other} has been silent for {patience_s} s"
                    )
                continue
            if not is_classic(message):
                continue
            is_last = message.arbitration_id == self._others_last
            if count < room:
                count += 1
            elif not is_last:
                continue  # a flood: there is no room, but for the frame that closes the epoch
            put_message(bytes_into, (count - 1) * FRAME_SIZE, message)
            if is_last:
                return count

    def receive(self, into: FrameArray, timeout_ns: int) -> int:
        """Wait up to `timeout_ns` for a frame; return the number of all frames received by then."""
        count = 0
        message = self._receive(timeout_ns * 1e-9)
        if message is None:
            return count
        room, bytes_into = len(into), bytes_of(into)
        while message is not None and count < room:
            if is_classic(message):
                put_message(bytes_into, count * FRAME_SIZE, message)
                count += 1
            if count == room:
                break
            message = self._receive(0.0)
        return count

    def lend(self, direct: Records[Direct]) -> bool:
        """Return False: every frame goes through python-can."""
        return False

    def take_back(self, direct: Records[Direct], words: Words) -> None:
        """Do nothing: nothing is lent."""

    def rest(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)

    def dismiss(self) -> None:
        """Do nothing: such a bus does not notice when a side leaves."""

    def has_other(self) -> bool:
        """Return False: such a bus does not know."""
        return False

    def statistics(self) -> None:
        """Return None: such a bus does not know who sends."""

    def close(self) -> None:
        """Leave the bus."""
        try:
            self._bus.shutdown()
        except can.CanError as error:  # an unplugged adapter cannot be closed
            if not self._is_broken:
                raise PortClosedError(f"bus {self._address}: cannot close: {error}") from error


def open_port(
    address: Address, side: Side, attach_wait_s: float = 0.0, foreign_senders: bool = False
) -> BatchPort | MessagePort:
    """Open a side's port on a bus.

    Raises
    ------
    BusError
        If the bus does not exist, or that side is already on it.
    """
    if address.is_embedded:
        return BatchPort(address, side, attach_wait_s, foreign_senders)
    return MessagePort(address, side)
