"""Replays some or all frames of a log onto a bus, in real time, faster or slower."""

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

from rrins.compiled.record import Integers
from rrins.dbc.codec import load
from rrins.dbc.frame import ERR_FLAG, Frame, FrameArray, frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.guard import LARGEST_BATCH
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.message import messages_of
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.errors import BusError
from rrins.host_tools.logs.reader import Log, Piece
from rrins.host_tools.logs.signals import did_you_mean, message_names
from rrins.host_tools.logs.truth import hardware_identifiers
from rrins.host_tools.recording.errors import RecordError

NAME = "replay"
"""Name of a replay on the embedded bus."""

READER = "reader of a replay"
"""Name of the read-ahead thread."""

_SEND_S = 5.0
_NAP_S = 0.05  # between checks for frames from others
_TO_CLEAR = 256
_PIECE = 128  # frames per read: delays sending by at most a millisecond
_LARGE_PIECE = 8192  # when nothing is due
_AHEAD = 32  # pieces waiting to be sent
_LARGEST_GROUP = 4096  # frames with the same time stamp that are sent together


@dataclass
class Played:
    """Result of a replay onto a bus."""

    frames: int = 0
    wall_s: float = 0.0
    latest_s: float = 0.0  #: largest delay of a frame


def identifiers_of(words: Sequence[str]) -> Integers | None:
    """Return the identifiers that words select; None without words, meaning everything.

    A word is `hardware` (everything the hardware sends, including the operator's MODE_COMMAND),
    `firmware`, a message name, or a pattern of message names with `*` and `?`.

    Raises
    ------
    RecordError
        If a word matches nothing; the message suggests close names.
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


_LATEST_S = 9e9  # in nanoseconds, 64 bits; in the year 2255


class _Player:
    """Sends frames that are due at the same time."""

    def __init__(self, address: Address) -> None:
        options = {"name": NAME, "host": "auto"} if address.is_embedded else {}
        self._bus = open_bus(address, **options)
        self._address = address
        self._unread = frame_array(_TO_CLEAR)

    def send(self, frames: FrameArray, time_s: float) -> None:
        """Send frames.

        Raises
        ------
        BusError
            If the bus does not accept them.
        """
        try:
            if isinstance(self._bus, RrinsBus):
                if not 0 <= time_s < _LATEST_S:
                    raise BusError(f"bus {self._address}: no frame has the time {time_s:g} s")
                time_ns = round(time_s * 1e9)
                for first in range(0, len(frames), LARGEST_BATCH):
                    part = frames[first : first + LARGEST_BATCH]
                    self._bus.send_batch(part, len(part), time_ns=time_ns, timeout=_SEND_S)
            else:
                for message in messages_of(frames, time_s, self._address.channel):
                    self._bus.send(message, timeout=_SEND_S)
        except can.CanError as error:
            raise BusError(f"bus {self._address}: cannot send: {error}") from error

    def clear(self) -> None:
        """Drop frames from others, so that the bus does not wait for us."""
        try:
            if isinstance(self._bus, RrinsBus):
                while self._bus.recv_batch(self._unread, 0.0) is not None:
                    pass
            else:
                while self._bus.recv(0.0) is not None:
                    pass
        except can.CanError as error:
            raise BusError(f"bus {self._address}: closed: {error}") from error

    def close(self) -> None:
        """Detach from the bus."""
        self._bus.shutdown()


class _ReadAhead:
    """Reads a log in a separate thread, a few pieces ahead of the consumer."""

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
        except BaseException as error:  # noqa: BLE001 - re-raised where the pieces are consumed
            self._read.put(error)

    def _pieces(self) -> Iterator[Piece]:
        while (found := self._read.get()) is not None:
            if isinstance(found, BaseException):
                raise found
            yield found
            self._free.release()


def _groups(pieces: Iterable[Piece]) -> Iterator[tuple[FrameArray, float]]:
    """Yield groups of frames with the same time, across pieces, and that time."""
    frames, time_s = frame_array(0), np.zeros(0)
    for piece in pieces:
        frames = Frame.joined([frames, piece.frames])
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
        On the embedded bus frames keep their logged time; a bus without a host is started.
    speed : float or None
        Multiple of real time; None to send as fast as the bus accepts frames.
    only : array of int, optional
        Identifiers to send; all by default.

    Attributes
    ----------
    played : Played

    Raises
    ------
    BusError
        If the bus cannot be opened.
    """

    def __init__(
        self, address: Address, speed: float | None = 1.0, only: Integers | None = None
    ) -> None:
        self.played = Played()
        self._speed = speed
        self._only = only
        self._player = _Player(address)
        self._begun = time.monotonic()

    def play(self, log: Log) -> None:
        """Send the frames of a log once, without error frames.

        Time stamps that go backwards within the log cause no wait.

        Raises
        ------
        BusError
            If the bus closes or does not accept the frames.
        RecordError
            If the log cannot be read.
        """
        latest_s = offset_s = begun = 0.0
        is_first = True
        size = _LARGE_PIECE if self._speed is None else _PIECE
        try:
            with _ReadAhead(log, size) as pieces:
                for frames, time_s in _groups(self._wanted(pieces)):
                    if is_first:  # reading up to here does not count as logged time
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
        """Yield the frames of each piece that are to be sent."""
        for piece in pieces:
            wanted = piece.frames["can_id"] & ERR_FLAG == 0
            if self._only is not None:
                wanted &= np.isin(piece.frames["can_id"], self._only)
            yield Piece(piece.frames[wanted], piece.time_s[wanted])

    def _wait_until(self, due: float) -> None:
        while (left_s := due - time.monotonic()) > 0:
            time.sleep(min(left_s, _NAP_S))
            if left_s > _NAP_S:
                self._player.clear()
        self.played.latest_s = max(self.played.latest_s, -left_s)

    def close(self) -> None:
        """Detach from the bus."""
        self._player.close()
