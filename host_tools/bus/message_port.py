"""A side's port on any python-can bus, presented to the shells as epochs of frames.

In lockstep each side's last frame closes an epoch; the other side waits for it for at most
`_LOCKSTEP_PATIENCE_NS`.
"""

from __future__ import annotations

import time

import can
import numpy as np

from rrins.compiled.record import Records, Words
from rrins.dbc.contract import load_contract
from rrins.dbc.direct import Direct
from rrins.dbc.e2e import fill
from rrins.dbc.frame import ERR_FLAG, FrameArray, frame_array
from rrins.host_tools.bus.address import Address, Side
from rrins.host_tools.bus.batch import bytes_of
from rrins.host_tools.bus.datagram import CLASSIC, FRAME_SIZE
from rrins.host_tools.bus.message import is_classic, put_message
from rrins.host_tools.bus.port import PortClosedError, message_of_frame, open_bus
from rrins.host_tools.errors import BusError, SideLostError

_ATTACH_S = 300.0  # the other side may compile first, on a busy machine for minutes
_ANNOUNCE_NS = 200_000_000
_ANNOUNCED = 3  # heartbeats in one epoch, of a firmware that has just begun
_LOCKSTEP_PATIENCE_NS = 30_000_000_000
_POLL_S = 0.2
_NO_FRAMES = frame_array(0)


class MessagePort:
    """A side on any python-can bus, frame by frame.

    Parameters
    ----------
    address : Address
    side : {"firmware", "hardware"}
    bus : can.BusABC, optional
        An open bus, closed by the port.
    keeps : bool
        As of `BatchPort`.
    """

    def __init__(
        self,
        address: Address,
        side: Side,
        bus: can.BusABC | None = None,
        keeps: bool = False,
    ) -> None:
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
        self._keeps = keeps
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
                self._drain()
                return
        raise SideLostError(f"bus {self._address}: no firmware heard within {_ATTACH_S:.0f} s")

    def _drain(self) -> None:
        """Drop the announcements that have come since the first one."""
        while self._receive(0.0) is not None:
            pass

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

        A port that keeps gives the epoch up when a firmware announces itself anew.

        Raises
        ------
        SideLostError
            If nothing arrives for half a minute.
        """
        count = heartbeats = 0
        if into is not self._into:
            self._into, self._into_bytes = into, bytes_of(into)
        room, bytes_into = len(into), self._into_bytes
        deadline_ns = time.monotonic_ns() + _LOCKSTEP_PATIENCE_NS
        while True:
            message = self._receive(_POLL_S)
            if message is None:
                if time.monotonic_ns() > deadline_ns and not self._keeps:
                    patience_s = _LOCKSTEP_PATIENCE_NS // 1_000_000_000
                    raise SideLostError(
                        f"bus {self._address}: {self._other} has been silent for {patience_s} s"
                    )
                continue
            if not is_classic(message):
                continue
            heartbeats += message.arbitration_id == self._heartbeat_id
            if self._keeps and heartbeats == _ANNOUNCED:
                self._drain()
                return count
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

    def await_end(self, into: FrameArray) -> None:
        """Return at once: such a bus does not notice when the other side is gone."""
        self._keeps = True  # what it still says must not count for the next one

    def await_other(self) -> None:
        """Wait for the heartbeat of the side that comes in place of the one that is gone."""
        self._await_heartbeat()

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
