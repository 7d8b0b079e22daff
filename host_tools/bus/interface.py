"""The python-can interface ``rrins``, and its batch face for loops that move whole epochs."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Sequence
from typing import Any, Final, Literal

import can
import numpy as np
from can.typechecking import AutoDetectedConfig, CanFilters

from rrins.dbc.direct import Direct
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.bus import channel as channels
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.batch import Batch, bytes_of
from rrins.host_tools.bus.end import BusEnd
from rrins.host_tools.bus.guard import NOTHING_REFUSED, Refused
from rrins.host_tools.bus.hosting import Hosting
from rrins.host_tools.bus.hub import Hub
from rrins.host_tools.bus.launch import attach
from rrins.host_tools.bus.message import get_message, put_message
from rrins.host_tools.bus.unix_time import UnixTime
from rrins.host_tools.errors import BusError

_HEADER: Final = datagram.HEADER_SIZE
_FRAME: Final = datagram.FRAME_SIZE
_NO_FRAMES: Final = frame_array(0)
_NO_BYTES: Final = memoryview(bytearray())


_log: Final = logging.getLogger("rrins.host_tools.bus")

ANSWER_S = 10.0
"""Seconds within which a host must answer a new peer."""


class RrinsBus(Hosting, can.BusABC):
    """One end of an embedded virtual CAN bus between the processes of one machine.

    The bus is ordered and lossless. A `node` that does not receive stops it after some thousand
    frames, the way a halted target in a debugger should stop a rehearsal; attach what may be slow,
    or only looks, as an `observer`, which is cut off instead. Whoever mainly sends has to receive
    as well: the bus cannot know that it does not want to hear.

    **Clock.** A batch carries the time its sender gives it, in a rehearsal the simulated time since
    its start. A single message is stamped by the host: with the time of the last batch as long as
    the sender of that batch is attached, so that a recording has one clock; on a bus without
    batches with the Unix time. `can.Message.timestamp` is that time in seconds; with
    ``timestamps="unix"`` the Unix time of the host's time 0 is added to simulated time.

    **Threads.** One thread may receive while others send. There is no file descriptor to wait on,
    because one datagram holds several messages: `can.Notifier` uses a thread, with asyncio too.

    Parameters
    ----------
    channel : str or int
        Name of the channel, or the path of its socket.
    can_filters : sequence of dict, optional
        Filters of python-can, for the messages; batches are never filtered.
    host : {"auto", "never", "here"}
        ``"here"``: this object hosts the channel, which moves while it sends or receives.
        ``"never"``: attach, or fail. ``"auto"``: attach; if nobody hosts, start a process that does
        so until its last peer has left.
    name : str, optional
        What this end calls itself; by default its process.
    role : {"node", "observer"}
        Whether the bus waits for this end, or cuts it off.
    exclusive : bool
        Whether nobody else may carry the same name.
    receive_own_messages : bool
        Whether this end receives what it sends.
    fd : bool
        Whether CAN FD messages can be sent and are received; without it they are passed over, as
        SocketCAN does.
    in_step : bool
        Whether the bus goes on only as this end, a node that does not host, receives: it is ahead
        of it by some eighty datagrams at most, in place of some thousand.
    timestamps : {"bus", "unix"}
        Whether messages and batches carry the time of the bus, or that and the Unix time of the
        bus's time 0 added up: the clock's time in a rehearsal in real time.
    attach_timeout : float
        Seconds that the host has to answer.
    queue_limit : int
        For a host: bytes that may wait for an observer before it is cut off.
    foreign_senders : bool
        For a host: whether anybody may send what the contract gives to ``firmware`` or
        ``hardware`` while a peer of that name is attached. Without it such frames are not
        delivered.
    **kwargs
        Whatever else python-can passes to every interface.

    Raises
    ------
    can.CanInitializationError
        If the channel is not hosted, is hosted already, does not answer, or refuses.
    """

    def __init__(
        self,
        channel: str | int,
        can_filters: CanFilters | None = None,
        *,
        host: Literal["auto", "never", "here"] = "auto",
        name: str | None = None,
        role: Literal["node", "observer"] = "node",
        exclusive: bool = False,
        receive_own_messages: bool = False,
        fd: bool = False,
        in_step: bool = False,
        timestamps: Literal["bus", "unix"] = "bus",
        attach_timeout: float = ANSWER_S,
        queue_limit: int = 4 * 1024 * 1024,
        foreign_senders: bool = False,
        **kwargs: Any,
    ) -> None:
        if host not in ("auto", "never", "here"):
            raise ValueError(f"host is {host!r} and may be 'auto', 'never' or 'here'")
        if role not in ("node", "observer"):
            raise ValueError(f"role is {role!r} and may be 'node' or 'observer'")
        if timestamps not in ("bus", "unix"):
            raise ValueError(f"timestamps is {timestamps!r} and may be 'bus' or 'unix'")
        if host == "here" and role == "observer":
            raise ValueError("the host of a channel is a node")
        if in_step and (host == "here" or role == "observer"):
            raise ValueError("in_step is for a node that does not host the channel")
        if foreign_senders and host != "here":
            raise ValueError('foreign_senders is for the host of a channel, host="here"')
        self.channel = str(channel)
        self.channel_info = f"rrins channel {self.channel!r}"
        self._fd = fd
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        own_name = name if name is not None else f"process-{os.getpid()}"
        self._hub: Hub | None = None
        self._wire: BusEnd
        try:
            if host == "here":
                self._hub = Hub(
                    self.channel,
                    name=own_name,
                    exclusive=exclusive,
                    receive_own=receive_own_messages,
                    queue_limit=queue_limit,
                    foreign_senders=foreign_senders,
                )
                self._wire = self._hub
                self.host_pid = os.getpid()
            else:
                link = attach(
                    self.channel,
                    may_start=host == "auto",
                    name=own_name,
                    is_observer=role == "observer",
                    exclusive=exclusive,
                    receive_own=receive_own_messages,
                    in_step=in_step,
                    timeout=float(attach_timeout),
                )
                self._wire = link
                self.host_pid = link.host_pid
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self._number = self._wire.number
        self._unix = UnixTime(self._wire) if timestamps == "unix" else None

        self._send_lock = threading.Lock()
        self._out = datagram.receive_buffer()
        self._out_view = memoryview(self._out)
        self._out_frames: FrameArray = _NO_FRAMES  # the array of the last `send_batch`, as bytes
        self._out_bytes = _NO_BYTES

        self._receive_lock = threading.Lock()
        self._in = datagram.receive_buffer()
        self._in_view = memoryview(self._in)
        self._in_frames: FrameArray = _NO_FRAMES  # the array of the last `recv_batch`, as bytes
        self._in_bytes = _NO_BYTES
        self._in_capacity = 0
        self._count = 0  # frames in the received datagram,
        self._next = 0  # of which this one is the next to be delivered
        self._is_fd = False
        self._closes_epoch = False
        self._timestamp = 0.0
        self._batch = Batch()
        self._is_lost = False
        self.refused = NOTHING_REFUSED
        try:
            super().__init__(self.channel, can_filters, **kwargs)
        except BaseException:
            self._wire.close()
            raise

    def send_batch(
        self,
        frames: FrameArray,
        count: int,
        *,
        epoch: int = 0,
        time_ns: int = 0,
        closes_epoch: bool = False,
        timeout: float | None = None,
    ) -> None:
        """Send the first `count` frames of an array as one datagram.

        Parameters
        ----------
        frames : FrameArray
            Contiguous; best the same array each time.
        count : int
            Frames to send, 0 to `datagram.MAX_FRAMES`.
        epoch : int
            Epoch counter.
        time_ns : int
            Time of the batch in nanoseconds.
        closes_epoch : bool
            Whether this end has sent everything in this epoch.
        timeout : float, optional
            Seconds to wait for room; for ever by default.

        Raises
        ------
        can.CanTimeoutError
            If a node has held up the bus all the time; nothing was sent.
        can.CanOperationError
            If the bus has come to its end for this node, or a required peer has left.
        ValueError
            If the arguments make no batch.
        """
        self._begin_send(timeout)
        try:
            if frames is not self._out_frames:
                self._out_bytes = bytes_of(frames)
                self._out_frames = frames
            length = count * _FRAME
            size = _HEADER + length
            source = self._out_bytes
            if count < 0 or length > len(source) or count > datagram.MAX_FRAMES:
                raise ValueError(f"{count} frames of {len(frames)} make no batch")
            out = self._out_view
            datagram.put_header(
                self._out, datagram.FRAMES, closes_epoch, count, self._number, epoch, time_ns
            )
            out[_HEADER:size] = source[:length]
            if count and max(self._out[_HEADER + 4 : size : _FRAME]) > datagram.CLASSIC_PAYLOAD:
                raise ValueError("a frame of the batch has more than 8 bytes of payload")
            self._wire.send(out[:size], timeout)
        except BusError as error:
            raise self._translated(error) from error
        finally:
            self._send_lock.release()

    def recv_batch(self, into: FrameArray, timeout: float | None) -> Batch | None:
        """Receive one batch; a single message is a batch of one frame.

        A batch longer than `into` comes in parts, of which the last may close the epoch. CAN FD
        frames do not fit and are passed over. What `recv` has begun is continued.

        Parameters
        ----------
        into : FrameArray
            Contiguous, takes the frames; best the same array each time.
        timeout : float, optional
            Seconds to wait; None waits for ever.

        Returns
        -------
        Batch or None
            The object of this bus that says what was received, or None when the time is over.

        Raises
        ------
        can.CanOperationError
            If the bus has come to its end for this node, or a required peer has left.
        """
        with self._receive_lock:
            if into is not self._in_frames:
                self._in_bytes = bytes_of(into)
                self._in_capacity = len(into)
                if not self._in_capacity:
                    raise ValueError("an empty array takes no frames")
                self._in_frames = into
            batch = self._batch
            first = self._next
            if first >= self._count or self._is_fd:
                if not self._receive(timeout, takes_fd=False):
                    return None
                first = 0
            count = self._count - first
            if count > self._in_capacity:
                count = self._in_capacity
            start = _HEADER + first * _FRAME
            length = count * _FRAME
            self._in_bytes[:length] = self._in_view[start : start + length]
            self._next = first + count
            batch.count = count
            batch.closes_epoch = self._closes_epoch and self._next == self._count
            return batch

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one message.

        Parameters
        ----------
        msg : can.Message
            The message.
        timeout : float, optional
            Seconds to wait for room; for ever by default.

        Raises
        ------
        can.CanTimeoutError
            If a node has held up the bus all the time; the message was not sent.
        can.CanOperationError
            If the bus has come to its end for this node, or a required peer has left.
        """
        if msg.is_fd and not self._fd:
            raise can.CanOperationError(
                f"{self.channel_info} was opened for classic frames: open it with fd=True"
            )
        self._begin_send(timeout)
        try:
            size = _HEADER + put_message(self._out, _HEADER, msg)
            kind = datagram.FRAMES_FD if msg.is_fd else datagram.FRAMES
            datagram.put_header(self._out, kind, datagram.UNSTAMPED, 1, self._number, 0, 0)
            self._wire.send(self._out_view[:size], timeout)
        except BusError as error:
            raise self._translated(error) from error
        finally:
            self._send_lock.release()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        with self._receive_lock:
            deadline = None if timeout is None else time.monotonic() + timeout
            while self._next >= self._count:  # an empty batch has no message
                if not self._receive(timeout, takes_fd=self._fd):
                    return None, False
                if deadline is not None:
                    timeout = max(0.0, deadline - time.monotonic())
            frame_size = datagram.FD_FRAME_SIZE if self._is_fd else _FRAME
            message = get_message(
                self._in,
                _HEADER + self._next * frame_size,
                self._is_fd,
                self._timestamp,
                self.channel,
                self._batch.sender != self._number,
            )
            self._next += 1
            return message, False

    def flush_tx_buffer(self) -> None:
        """Do nothing: what was sent is on the bus already and cannot be taken back."""

    @property
    def state(self) -> can.BusState:
        """``ACTIVE``, or ``ERROR`` once the bus has come to its end for this node."""
        return can.BusState.ERROR if self._is_lost else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        if new_state is not can.BusState.ACTIVE:
            raise NotImplementedError("an end of an rrins channel is always active")

    def shutdown(self) -> None:
        """Leave the bus, or as host release it; what was sent still arrives. Idempotent."""
        if not self._is_shutdown:
            super().shutdown()
            self._wire.close()

    @staticmethod
    def _detect_available_configs() -> Sequence[AutoDetectedConfig]:
        return [{"interface": "rrins", "channel": name} for name in channels.detect()]

    def ask_refused(self, timeout: float | None = None) -> None:
        """Ask the host how many frames it has refused; `refused` has the answer, once received.

        Raises
        ------
        can.CanTimeoutError
            If a node has held up the bus all the time.
        can.CanOperationError
            If the bus has come to its end for this node.
        """
        self._begin_send(timeout)
        try:
            question = datagram.control(datagram.COUNTS, sender=self._number)
            self._wire.send(memoryview(question), timeout)
        except BusError as error:
            raise self._translated(error) from error
        finally:
            self._send_lock.release()

    def lend(self, direct: Direct) -> bool:
        """Tell compiled code of the other side's socket, for whole epochs without Python.

        Nobody else may use this object until `take_back`. Returns False, and lends nothing, while
        more ends are attached than one that listens, or something waits to be received.
        """
        if self._next < self._count or self._unix is not None:
            return False
        ends = self._wire.direct_ends()
        if ends is None:
            return False
        direct.fd, direct.door, other, direct.listener = ends
        direct.opening = np.uint64(datagram.first_word(datagram.FRAMES, datagram.CLOSES_EPOCH))
        direct.own = np.uint64(self._number)
        direct.other = np.uint64(other)
        direct.time_ns = direct.batches = 0
        direct.left_over = 0
        return True

    def take_back(self, left_over: memoryview, time_ns: int = 0, batches: int = 0) -> None:
        """Go on after compiled code.

        Parameters
        ----------
        left_over : memoryview
            A datagram that it has received and leaves to Python; empty for none.
        time_ns, batches : int
            Time of the last batch that it has sent, and how many these were.
        """
        try:
            self._wire.go_on(left_over, time_ns, batches)
        except BusError as error:
            raise self._translated(error) from error

    def _begin_send(self, timeout: float | None) -> None:
        if self._send_lock.acquire(blocking=False):
            return
        if not self._send_lock.acquire(timeout=-1 if timeout is None else max(0.0, timeout)):
            raise can.CanTimeoutError(f"another thread is sending on {self.channel_info}")

    def _receive(self, timeout: float | None, takes_fd: bool) -> bool:
        """Receive the next datagram of a kind we take; return False when the time is over."""
        start = 0
        while True:
            try:
                size = self._wire.receive(self._in, timeout)
                if not size:
                    return False
                kind, flags, count, sender, epoch, time_ns = datagram.parse(self._in, size)
            except BusError as error:
                raise self._translated(error) from error
            if kind == datagram.FRAMES or (takes_fd and kind == datagram.FRAMES_FD):
                break
            if kind in (datagram.NOTE, datagram.COUNTS):
                self._take_word(kind, datagram.text_of(self._in, count), epoch)
            if timeout is not None:
                now = time.monotonic_ns()
                timeout = max(0.0, timeout - (now - start) / 1e9) if start else timeout
                start = now
        if self._unix is not None:
            time_ns = self._unix.of(time_ns, sender, time.time_ns())
        batch = self._batch
        batch.epoch = epoch
        batch.time_ns = time_ns
        batch.sender = sender
        self._closes_epoch = bool(flags & datagram.CLOSES_EPOCH)
        self._is_fd = kind == datagram.FRAMES_FD
        self._timestamp = time_ns / 1e9
        self._count = count
        self._next = 0
        return True

    def _take_word(self, kind: int, text: str, frames: int) -> None:
        self.refused = Refused(frames, text)
        if kind == datagram.NOTE:
            _log.warning("channel %s: %s", self.channel, text)
