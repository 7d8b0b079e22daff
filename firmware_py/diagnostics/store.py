"""Memory that survives power loss at any moment: two copies, written in turns.

Each copy has a sequence number and a CRC. The one with the higher number counts; writing replaces
the other, and only when that is safely stored does it count. Whenever the power fails, at least one
copy is whole. Each copy begins on a page of its own, so that a torn write cannot reach the other.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import zlib
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

MAGIC = b"RRTC"
VERSION = 1
PAGE = 4096

_HEAD = struct.Struct(">4sHHQII")  # magic, version, 0, sequence, length, CRC-32 of the image
_CRC = struct.Struct(">I")  # of the head
_IMAGE = _HEAD.size + _CRC.size


class StoreError(Exception):
    """The memory cannot be had, read or written."""


class Medium(Protocol):
    """Where the bytes are."""

    def read(self, start: int, length: int) -> bytes:
        """Return bytes, fewer where there are no more."""

    def write(self, start: int, data: bytes) -> None:
        """Replace bytes, and return when they are safely stored."""

    def create(self, data: bytes) -> None:
        """Store the first bytes ever: all of them or none."""

    def close(self) -> None:
        """Let go of it."""


class FileMedium:
    """A file; another firmware cannot have it at the same time.

    Parameters
    ----------
    path : Path
        Made, empty, where there is none; its folder has to exist.

    Raises
    ------
    StoreError
        When it cannot be opened, or another process has it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = -1
        try:
            if not path.parent.is_dir():
                raise StoreError(f"{path}: there is no folder {path.parent}")
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise StoreError(f"{path}: cannot be opened: {error.strerror}") from error
        if not self._lock(file):
            os.close(file)
            raise StoreError(f"{path}: another firmware has it")
        self._file = file

    def _lock(self, file: int) -> bool:
        """Lock an open file; return whether it is ours, and still the one that the path names."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return os.path.samestat(os.fstat(file), self._path.stat())
        except OSError:
            return False

    def read(self, start: int, length: int) -> bytes:
        """Return bytes, fewer where there are no more."""
        try:
            return os.pread(self._file, length, start)
        except OSError as error:
            raise StoreError(f"{self._path}: cannot be read: {error.strerror}") from error

    def write(self, start: int, data: bytes) -> None:
        """Replace bytes, and return when they are safely stored."""
        try:
            done = 0
            while done < len(data):
                done += os.pwrite(self._file, data[done:], start + done)
            os.fsync(self._file)
        except OSError as error:
            raise StoreError(f"{self._path}: cannot be written: {error.strerror}") from error

    def create(self, data: bytes) -> None:
        """Store the first bytes ever: all of them or none."""
        aside = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        empty, file = self._file, -1
        try:
            file = os.open(aside, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # before anybody can find it
            self._file = file
            self.write(0, data)
            aside.rename(self._path)
            folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except (OSError, StoreError) as error:
            self._file = empty
            if file >= 0:
                os.close(file)
            with contextlib.suppress(OSError):
                aside.unlink()
            why = error.strerror if isinstance(error, OSError) else error
            raise StoreError(f"{self._path}: cannot be made: {why}") from error
        os.close(empty)

    def close(self) -> None:
        """Let go of the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __str__(self) -> str:
        return str(self._path)


class Condition(Enum):
    """What was found when the memory was read."""

    BLANK = "never written"
    WHOLE = "both copies sound"
    ONE_DAMAGED = "one copy damaged"
    LOST = "both copies damaged"


@dataclass(frozen=True)
class Found:
    """The memory's content: `image` is None where there is none, `sequence` how often written."""

    condition: Condition
    image: bytes | None = None
    sequence: int = 0


class TwoCopyStore:
    """An image in two copies.

    Parameters
    ----------
    medium : Medium
    capacity : int
        The longest image, bytes.
    """

    def __init__(self, medium: Medium, capacity: int) -> None:
        self._medium = medium
        self._capacity = capacity
        self.slot_size = -(-(_IMAGE + capacity) // PAGE) * PAGE
        """Bytes of a copy, in whole pages."""

    def read(self) -> Found:
        """Return what counts.

        Raises
        ------
        StoreError
            When it cannot be read, or is something else than a memory of this kind.
        """
        copies = [self._copy(slot) for slot in range(2)]
        raw = self._medium.read(0, 2 * self.slot_size + 1)
        if not raw:
            return Found(Condition.BLANK)
        is_ours = MAGIC in (raw[:4], raw[self.slot_size : self.slot_size + 4])
        if not is_ours and len(raw) != 2 * self.slot_size:
            raise StoreError(f"{self._medium}: is no memory of this kind; it is left as it is")
        sound = [copy for copy in copies if copy is not None]
        if not sound:
            return Found(Condition.LOST)
        sequence, image = max(sound)
        condition = Condition.WHOLE if len(sound) == 2 else Condition.ONE_DAMAGED
        return Found(condition, image, sequence)

    def _copy(self, slot: int) -> tuple[int, bytes] | None:
        """Return sequence number and image of a copy; None where it is damaged."""
        data = self._medium.read(slot * self.slot_size, _IMAGE + self._capacity)
        if len(data) < _IMAGE:
            return None
        magic, version, _, sequence, length, crc = _HEAD.unpack_from(data)
        head_holds = _CRC.unpack_from(data, _HEAD.size)[0] == zlib.crc32(data[: _HEAD.size])
        image = data[_IMAGE : _IMAGE + length]
        if not head_holds or magic != MAGIC or version != VERSION or zlib.crc32(image) != crc:
            return None
        return sequence, image

    def write(self, image: bytes) -> None:
        """Store an image; when it returns, it counts and will go on to do so.

        Raises
        ------
        StoreError
            When it cannot be written; what counted before still does.
        """
        if len(image) > self._capacity:
            raise StoreError(f"{self._medium}: {len(image)} bytes, {self._capacity} at most")
        copies = [self._copy(slot) for slot in range(2)]
        sequences = [-1 if copy is None else copy[0] for copy in copies]
        sequence = max(0, *sequences) + 1
        if not self._medium.read(0, 1):
            first = self._slot(image, sequence).ljust(self.slot_size, b"\0")
            second = self._slot(image, sequence + 1).ljust(self.slot_size, b"\0")
            self._medium.create(first + second)
            return
        slot = sequences.index(min(sequences))  # the damaged or the older one
        self._medium.write(slot * self.slot_size, self._slot(image, sequence))
        if self._copy(slot) != (sequence, image):
            raise StoreError(f"{self._medium}: what was written does not read back")

    @staticmethod
    def _slot(image: bytes, sequence: int) -> bytes:
        head = _HEAD.pack(MAGIC, VERSION, 0, sequence, len(image), zlib.crc32(image))
        return head + _CRC.pack(zlib.crc32(head)) + image

    def close(self) -> None:
        """Let go of the medium."""
        self._medium.close()


@dataclass(frozen=True)
class Stores:
    """The memories of a computer that survive power loss; None for one that does not."""

    parameters: TwoCopyStore | None = None
    faults: TwoCopyStore | None = None


def open_stores(path: Path, parameter_capacity: int, fault_capacity: int) -> Stores:
    """Open the memories of a computer: parameters in a file, trouble codes in one beside it.

    Parameters
    ----------
    path : Path
        Of the parameters; that of the trouble codes ends in ``.dtc`` besides.
    parameter_capacity, fault_capacity : int
        Bytes.

    Raises
    ------
    StoreError
        When one cannot be opened.
    """
    parameters = TwoCopyStore(FileMedium(path), parameter_capacity)
    faults = TwoCopyStore(FileMedium(path.with_name(path.name + ".dtc")), fault_capacity)
    return Stores(parameters, faults)
