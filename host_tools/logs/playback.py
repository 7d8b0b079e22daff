"""Replays a log onto a bus, in real time, faster or slower, some or all of its frames."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise

import can
import numpy as np
from numpy.typing import NDArray

from dbc.codec import load
from dbc.frame import ERR_FLAG, FrameArray, frame_array
from host_tools.bus.datagram import MAX_FRAMES
from host_tools.bus.interface import RrinsBus
from host_tools.errors import BusError
from host_tools.logs.errors import RecordError
from host_tools.logs.reader import Log, Piece
from host_tools.logs.recorder import messages_of
from host_tools.logs.signals import did_you_mean, message_names
from host_tools.logs.truth import hardware_identifiers
from host_tools.port import Address, open_bus

NAME = "replay"
"""What a replay calls itself on the embedded bus."""

READER = "reader of a replay"
"""Name of the thread that reads ahead."""

_SEND_S = 5.0
_NAP_S = 0.05  # between two looks at what others send
_TO_CLEAR = 256
_PIECE = 128  # frames read at once: to read them holds up the sending no longer than a millisecond
_LARGE_PIECE = 8192  # where nothing is due
_AHEAD = 32  # pieces that wait to be sent
_LARGEST_GROUP = 4096  # frames of one time that are waited for to be sent together


@dataclass
class Played:
    """What a replay onto a bus came to.

    Attributes
    ----------
    frames : int
    wall_s : float
    latest_s : float
        How late the latest frame was.
    """

    frames: int = 0
    wall_s: float = 0.0
    latest_s: float = 0.0


def identifiers_of(words: Sequence[str]) -> NDArray[np.int64] | None:
    """Return the identifiers of what words name; None without words, for everything.

    A word is `hardware` (all that the hardware sends, the operator's MODE_COMMAND included),
    `firmware`, a message, or a pattern of messages with `*` and `?`.

    Raises
    ------
    RecordError
        When a word names nothing; with what it may have meant.
    """
    if not words:
        return None
    codec = load()
    found: list[int] = []
    for word in words:
        if word == "hardware":
            found += hardware_identifiers()
        elif word == "firmware":
            messages = codec.database.messages
            found += [m.frame_id for m in messages if "FIRMWARE" in m.senders]
        else:
            names = [name for name in message_names() if fnmatchcase(name, word)]
            if not names:
                hint = did_you_mean(word, [*message_names(), "hardware", "firmware"])
                raise RecordError(f"--only {word}: the DBC has no such message{hint}")
            found += [codec.frame_id(name) for name in names]
    return np.array(found, dtype=np.int64)


class _Player:
    """Sends frames that are due at one time."""

    def __init__(self, address: Address) -> None:
        wishes = {"name": NAME, "host": "auto"} if address.is_embedded else {}
        self._bus = open_bus(address, **wishes)
        self._address = address
        self._unread = frame_array(_TO_CLEAR)

    def send(self, frames: FrameArray, time_s: float) -> None:
        """Send frames.

        Raises
        ------
        BusError
            When the bus does not take them.
        """
        try:
            if isinstance(self._bus, RrinsBus):
                time_ns = round(time_s * 1e9)
                for first in range(0, len(frames), MAX_FRAMES):
                    part = frames[first : first + MAX_FRAMES]
                    self._bus.send_batch(part, len(part), time_ns=time_ns, timeout=_SEND_S)
            else:
                for message in messages_of(frames, time_s, self._address.channel):
                    self._bus.send(message, timeout=_SEND_S)
        except can.CanError as error:
            raise BusError(f"bus {self._address}: cannot send: {error}") from error

    def clear(self) -> None:
        """Drop what others have sent, so that the bus does not wait for us."""
        try:
            if isinstance(self._bus, RrinsBus):
                while self._bus.recv_batch(self._unread, 0.0) is not None:
                    pass
            else:
                while self._bus.recv(0.0) is not None:
                    pass
        except can.CanError as error:
            raise BusError(f"bus {self._address}: has ended: {error}") from error

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


class _ReadAhead:
    """Reads a log in a thread of its own, some pieces of a size ahead of who takes them."""

    def __init__(self, log: Log, size: int) -> None:
        self._log = log
        self._size = size
        self._free = threading.Semaphore(_AHEAD)
        self._read: queue.SimpleQueue[Piece | BaseException | None] = queue.SimpleQueue()
        self._is_over = False
        self._thread = threading.Thread(target=self._run, name=READER, daemon=True)

    def __enter__(self) -> Iterator[Piece]:
        self._thread.start()
        return self._pieces()

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._free.release()
        self._thread.join()

    def _run(self) -> None:
        try:
            for piece in self._log.pieces(self._size):
                self._free.acquire()
                if self._is_over:
                    return
                self._read.put(piece)
            self._read.put(None)
        except BaseException as error:  # noqa: BLE001 - raised again where the pieces are taken
            self._read.put(error)

    def _pieces(self) -> Iterator[Piece]:
        while (found := self._read.get()) is not None:
            if isinstance(found, BaseException):
                raise found
            yield found
            self._free.release()


def _groups(pieces: Iterable[Piece]) -> Iterator[tuple[FrameArray, float]]:
    """Yield the frames of one time together, across the pieces, and that time."""
    frames, time_s = frame_array(0), np.zeros(0)
    for piece in pieces:
        frames = np.concatenate([frames, piece.frames])
        time_s = np.concatenate([time_s, piece.time_s])
        begins = (1 + np.flatnonzero(time_s[1:] != time_s[:-1])).tolist()
        for begin, end in pairwise([0, *begins]):
            yield frames[begin:end], float(time_s[begin])
        if begins:
            frames, time_s = frames[begins[-1] :], time_s[begins[-1] :]
        elif len(frames) > _LARGEST_GROUP:
            yield frames, float(time_s[0])
            frames, time_s = frames[:0], time_s[:0]
    if len(frames):
        yield frames, float(time_s[0])


class Playback:
    """A replay onto a bus.

    Parameters
    ----------
    address : Address
        On the embedded bus frames keep the time that the log has for them; a bus that nobody hosts
        is begun.
    speed : float or None
        Times real time; None for as fast as the bus takes them.
    only : array of int, optional
        Identifiers that are sent; all by default.

    Attributes
    ----------
    played : Played

    Raises
    ------
    BusError
        When the bus cannot be opened.
    """

    def __init__(
        self, address: Address, speed: float | None = 1.0, only: NDArray[np.int64] | None = None
    ) -> None:
        self.played = Played()
        self._speed = speed
        self._only = only
        self._player = _Player(address)
        self._begun = time.monotonic()

    def play(self, log: Log) -> None:
        """Send the frames of a log, once; error frames are left out.

        A time that goes back, within the log, is no time to wait for.

        Raises
        ------
        BusError
            When the bus ends or does not take the frames.
        RecordError
            When the log cannot be read.
        """
        latest_s = offset_s = begun = 0.0
        is_first = True
        size = _LARGE_PIECE if self._speed is None else _PIECE
        try:
            with _ReadAhead(log, size) as pieces:
                for frames, time_s in _groups(self._wanted(pieces)):
                    if is_first:  # what it took to read until here is not the log's
                        is_first = False
                        latest_s = offset_s = time_s
                        begun = time.monotonic()
                    latest_s = max(latest_s, time_s)
                    if self._speed is not None:
                        self._wait_until(begun + (latest_s - offset_s) / self._speed)
                    self._player.send(frames, time_s)
                    self._player.clear()
                    self.played.frames += len(frames)
        finally:
            self.played.wall_s = time.monotonic() - self._begun

    def _wanted(self, pieces: Iterable[Piece]) -> Iterator[Piece]:
        """Yield what is to be sent of each piece."""
        for piece in pieces:
            wanted = piece.frames["can_id"] & ERR_FLAG == 0
            if self._only is not None:
                wanted &= np.isin(piece.frames["can_id"], self._only)
            yield Piece(np.ascontiguousarray(piece.frames[wanted]), piece.time_s[wanted])

    def _wait_until(self, due: float) -> None:
        while (left_s := due - time.monotonic()) > 0:
            time.sleep(min(left_s, _NAP_S))
            if left_s > _NAP_S:
                self._player.clear()
        self.played.latest_s = max(self.played.latest_s, -left_s)

    def close(self) -> None:
        """Leave the bus."""
        self._player.close()
