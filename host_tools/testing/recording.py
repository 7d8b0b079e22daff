"""The recording of a bench's bus: the last frames in fixed memory, decoded on demand."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import Any, overload

import can
import numpy as np
from cantools.errors import Error as CantoolsError
from numpy.typing import NDArray

from rrins.compiled.record import Integers
from rrins.dbc.codec import load
from rrins.dbc.e2e import COUNTER_MODULUS, crc_holds, fill
from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.host_tools.bus.message import get_message
from rrins.host_tools.testing.errors import BenchError

CAPACITY = 200_000
"""Frames that a bench keeps: about 100 s of a bus at 200 Hz."""

SignalValue = int | float | str
"""A number in the unit of the DBC, or its name in the value table."""

Values = dict[str, Any]
"""Signals of a frame by name, in the units of the DBC, named values by name; in addition `time_s`
(simulated, since power-on) and `crc_holds`."""


class Sender(IntEnum):
    """Who sent a frame."""

    HARDWARE = 0
    FIRMWARE = 1
    TEST = 2
    OTHER = 3


def messages_of(frames: FrameArray, channel: str) -> Iterator[can.Message]:
    """Yield frames as python-can messages."""
    data = bytearray(frames.tobytes())
    for offset in range(0, len(data), frames.dtype.itemsize):
        yield get_message(data, offset, False, 0.0, channel, False)


class FrameRing:
    """The last frames of a bus with their times, in memory of fixed size.

    Parameters
    ----------
    capacity : int
        Number of frames kept.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._frames = frame_array(capacity)
        self._ids = self._frames["can_id"]
        self._times_ns = np.zeros(capacity, dtype=np.int64)
        self._senders = np.zeros(capacity, dtype=np.uint8)
        self.total = 0
        """Frames recorded so far; also the number of the next one."""

    def append(
        self,
        frames: FrameArray,
        count: int,
        times_ns: int | Integers,
        senders: Sender | NDArray[np.uint8],
    ) -> None:
        """Record the first `count` frames of an array; time and sender are of all, or of each."""
        at = self.total % self._capacity
        places: slice | NDArray[np.intp] = slice(at, at + count)
        if at + count > self._capacity:
            places = np.arange(at, at + count) % self._capacity
        self._frames[places] = frames[:count]
        self._times_ns[places] = times_ns
        self._senders[places] = senders
        self.total += count

    def find(self, can_id: int, first: int = 0) -> tuple[FrameArray, Integers]:
        """Return the frames of an identifier from number `first` on, and their times in ns."""
        where = self._places(first)
        where = where[self._ids[where] == can_id]
        return self._frames[where], self._times_ns[where]

    def has(self, can_id: int, first: int) -> bool:
        """Return whether there is a frame of an identifier from number `first` on."""
        low, high = first % self._capacity, self.total % self._capacity
        if low <= high and self.total - first < self._capacity:
            return bool((self._ids[low:high] == can_id).any())
        return bool((self._ids[self._places(first)] == can_id).any())

    def at(self, number: int) -> tuple[FrameArray, int, Sender]:
        """Return a frame by its number, as an array of one, with its time in ns and sender.

        Raises
        ------
        BenchError
            If it is no longer kept.
        """
        if not max(self.total - self._capacity, 0) <= number < self.total:
            raise BenchError(f"frame {number} is no longer in the recording")
        place = number % self._capacity
        time_ns, sender = int(self._times_ns[place]), Sender(self._senders[place])
        return self._frames[place : place + 1], time_ns, sender

    def _places(self, first: int) -> NDArray[np.intp]:
        low = max(first, self.total - self._capacity, 0)
        return np.arange(low, self.total) % self._capacity

    def sha256(self) -> str:
        """Return the hexadecimal digest of the frames kept, their times and senders."""
        where = self._places(0)
        digest = hashlib.sha256()
        for part in (self._frames[where], self._times_ns[where], self._senders[where]):
            digest.update(part.tobytes())
        return digest.hexdigest()

    def write_log(self, path: Path, channel: str) -> int:
        """Write the frames kept as a candump log; return their number.

        Times are simulated seconds since power-on; the test's own frames are marked ``T``.
        """
        where = self._places(0)
        frames = messages_of(self._frames[where], channel)
        times_s = (self._times_ns[where] / 1e9).tolist()
        received = (self._senders[where] != Sender.TEST).tolist()
        with can.CanutilsLogWriter(path) as writer:
            for message, time_s, is_rx in zip(frames, times_s, received, strict=True):
                message.timestamp = time_s
                message.is_rx = is_rx
                writer.on_message_received(message)
        return len(where)


class Contract:
    """The DBC as a bench uses it."""

    def __init__(self) -> None:
        self._codec = load()
        self._names = [message.name for message in self._codec.database.messages]

    def can_id(self, message: str) -> int:
        """Return a message's identifier.

        Raises
        ------
        BenchError
            If the DBC has no such message; the error suggests the closest name.
        """
        if message not in self._names:
            raise BenchError(f"the DBC has no message {message}{_hint(message, self._names)}")
        return self._codec.frame_id(message)

    def check_signals(self, message: str, names: Sequence[str]) -> None:
        """Raise `BenchError` unless a message has all these signals."""
        self.can_id(message)
        known = [s.name for s in self._codec.database.get_message_by_name(message).signals]
        for name in names:
            if name not in known:
                raise BenchError(f"{message} has no signal {name}{_hint(name, known)}")

    def named(self, message: str, signal: str, value: SignalValue) -> SignalValue:
        """Return a wanted value in decoded form: the name of a number that has one.

        Raises
        ------
        BenchError
            If it is a name that is not in the signal's value table.
        """
        choices = self._codec.choices(message, signal)
        if isinstance(value, int) and value in choices:
            return choices[int(value)]
        if isinstance(value, str) and value not in choices.values():
            known = list(choices.values())
            raise BenchError(f"{message}.{signal} is never {value!r}{_hint(value, known)}")
        return value

    def decode(self, message: str, frame: Frame, time_ns: int) -> Values:
        """Return the values of a frame."""
        decoded = self._codec.database.get_message_by_name(message).decode(
            int(frame["data"]).to_bytes(8, "little")
        )
        assert isinstance(decoded, dict)
        values: Values = {
            name: value if isinstance(value, int | float) else str(value)
            for name, value in decoded.items()
        }
        row = self._codec.messages[self._codec.message_index(message)]
        return values | {"time_s": time_ns / 1e9, "crc_holds": bool(crc_holds(frame, row))}

    def counts_epochs(self, message: str) -> bool:
        """Return whether a message's counter is the epoch, not the number of transmissions."""
        return self._codec.counts_epochs(message)

    def encode(self, message: str, values: Mapping[str, SignalValue], counter: int) -> FrameArray:
        """Return an array of one frame of a message, with counter and CRC.

        Omitted signals are 0; `crc` and `alive_counter`, if given, are sent unchanged.

        Raises
        ------
        BenchError
            If the message has no such signal, or a value is out of range.
        """
        self.check_signals(message, list(values))
        values = {name: self.named(message, name, value) for name, value in values.items()}
        described = self._codec.database.get_message_by_name(message)
        blank: dict[str, SignalValue] = {signal.name: 0 for signal in described.signals}
        try:
            payload = described.encode(blank | dict(values), strict=True)
        except (CantoolsError, ValueError, TypeError, OverflowError) as error:
            raise BenchError(f"{message} cannot be sent: {error}") from error
        word = np.uint64(int.from_bytes(payload, "little"))
        row = self._codec.messages[self._codec.message_index(message)]
        frames = frame_array(1)
        fill(frames[0], row, word, int(values.get("alive_counter", counter)) % COUNTER_MODULUS)
        if not self._codec.is_protected(message):
            frames[0]["data"] = word
        if "crc" in values:
            protected = int(frames[0]["data"])
            frames[0]["data"] = protected & ~0xFF | int(values["crc"])
        return frames


def _hint(name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, 1)
    return f", did you mean {near[0]}?" if near else ""


class Messages(Sequence[Values]):
    """Frames of one message, oldest first, decoded on access."""

    def __init__(
        self, contract: Contract, message: str, frames: FrameArray, times_ns: Integers
    ) -> None:
        self._contract = contract
        self._message = message
        self._frames = frames
        self._times_ns = times_ns

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> Values: ...

    @overload
    def __getitem__(self, index: slice) -> Messages: ...

    def __getitem__(self, index: int | slice) -> Values | Messages:
        if isinstance(index, slice):
            return Messages(
                self._contract, self._message, self._frames[index], self._times_ns[index]
            )
        return self._contract.decode(self._message, self._frames[index], int(self._times_ns[index]))

    def __repr__(self) -> str:
        return f"<{len(self)} {self._message}>"
