"""Where the frames of a recording come from: the embedded bus, or any of python-can's."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import cast

import can
import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.direct import AVAILABLE, WORDS, Direct, take_many
from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.host_tools.bus.batch import bytes_of
from rrins.host_tools.bus.datagram import FRAME_SIZE
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.message import messages_of

_POLL_S = 0.1
_PAUSE_S = 0.002
"""Rest of a recorder that has caught up, before it waits on the bus: dozens of datagrams gather, of
which each would wake it otherwise; the socket holds hundreds. A silent bus wakes it ten times a
second."""

_BATCH = 4096
_AT_ONCE = 64  # datagrams

_Batch = tuple[bytes, float]
"""Frames of one time, s; as bytes, which are joined faster than arrays."""


def _frames_of(content: bytes) -> FrameArray:
    return cast(FrameArray, np.frombuffer(content, Frame.dtype))


class EmbeddedSource:
    """The frames of the embedded bus, in the order in which the firmware handles them.

    In lockstep the firmware reads frames that arrive between the hardware's frames and its own
    answer only in its next epoch; here such frames follow the answer.
    """

    def __init__(self, bus: RrinsBus, channel: str, in_lockstep: bool) -> None:
        self._bus = bus
        self._channel = channel
        self._in_lockstep = in_lockstep
        self._frames = frame_array(_BATCH)
        self._bytes = bytes_of(self._frames)
        self._lent, self._words = Direct.zeros(), np.zeros(WORDS, dtype=np.uint64)
        self._heads = np.zeros((_AT_ONCE, 4), dtype=np.int64)
        if AVAILABLE:  # compile now, while nobody waits
            self._lent[0].fd = -1
            take_many(self._lent[0], self._words, self._frames, self._heads)
        self._is_open = False  # an epoch is open: not yet closed by the firmware
        self._between: list[_Batch] = []

    def receive(self) -> list[can.Message] | None:
        """Return the next messages, empty for a batch without frames; None if nothing arrived."""
        came = self.receive_batches()
        return None if came is None else self._messages(came)

    def _messages(self, batches: list[_Batch]) -> list[can.Message]:
        of_each = (messages_of(_frames_of(c), time_s, self._channel) for c, time_s in batches)
        return [message for messages in of_each for message in messages]

    def receive_batches(self) -> list[_Batch] | None:
        """Return the next frames as arrays, as `receive` does."""
        if came := self._waiting():
            return came
        batch = self._bus.recv_batch(self._frames, 0.0)
        if batch is None:
            time.sleep(_PAUSE_S)
            batch = self._bus.recv_batch(self._frames, _POLL_S)
        if batch is None:
            return None
        content = bytes(self._bytes[: batch.count * FRAME_SIZE])
        return self._in_order(content, batch.time_ns, batch.sender, batch.closes_epoch)

    def _waiting(self) -> list[_Batch]:
        """Return the batches that are there already, taken by compiled code as far as it can."""
        if not (AVAILABLE and self._bus.lend(self._lent[0])):
            return []
        count = take_many(self._lent[0], self._words, self._frames, self._heads)
        if left_over := int(self._lent[0].left_over):
            self._bus.take_back(self._words.view(np.uint8).data[:left_over])
        came, begin = [], 0
        for frames, time_ns, sender, closes_epoch in self._heads[:count].tolist():
            end = begin + frames * FRAME_SIZE
            came += self._in_order(bytes(self._bytes[begin:end]), time_ns, sender, closes_epoch)
            begin = end
        return came

    def _in_order(
        self, content: bytes, time_ns: int, sender: int, closes_epoch: bool
    ) -> list[_Batch]:
        """Return what is next once a batch has come."""
        came = [(content, time_ns / 1e9)] if content else []
        if not self._in_lockstep:
            return came
        if sender == 0:
            self._is_open = self._is_open or bool(closes_epoch)
        elif closes_epoch:
            self._is_open = False
            came += self._between
            self._between = []
        elif self._is_open:
            self._between += came
            return []
        return came

    def rest(self) -> list[can.Message]:
        """Return the messages that followed the last hardware frames."""
        return self._messages(self._between)


class ManyAtOnce:
    """Collects the frames of a source, and hands them over by the thousand, or when it is idle."""

    def __init__(self, source: EmbeddedSource, write: Callable[[FrameArray, Floats], None]) -> None:
        self._source, self._write = source, write
        self._batches: list[_Batch] = []
        self._count = 0

    def receive(self) -> list[can.Message] | None:
        """Collect what comes, and return no message; None if nothing arrived."""
        came = self._source.receive_batches()
        if came:
            self._batches += came
            self._count += sum(len(content) for content, _ in came) // FRAME_SIZE
        if came is None or self._count >= _BATCH:
            self.flush()
        return None if came is None else []

    def flush(self) -> None:
        """Hand over what is collected."""
        batches, self._batches, self._count = self._batches, [], 0
        if batches:
            counts = [len(content) // FRAME_SIZE for content, _ in batches]
            time_s = np.repeat([time_s for _, time_s in batches], counts)
            self._write(_frames_of(b"".join(content for content, _ in batches)), time_s)


class AnySource:
    """The frames of any python-can bus."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def receive(self) -> list[can.Message] | None:
        """Return the next message; None if nothing arrived."""
        message = self._bus.recv(_POLL_S)
        return None if message is None else [message]

    def rest(self) -> list[can.Message]:
        """Return nothing: every message has been passed on."""
        return []
