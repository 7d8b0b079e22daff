"""Memory that survives power loss at any moment: two copies, written alternately.

Each copy has a sequence number and a CRC. The one with the higher number is valid; writing replaces
the other, which becomes valid only once it is safely stored. Whenever the power fails, at least one
copy is intact. Each copy starts on a separate page, so a torn write cannot damage the other.
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
IMAGE = _HEAD.size + _CRC.size
"""Where the image begins, in bytes."""


class StoreError(Exception):
    """The memory cannot be opened, read or written."""


class StorageMedium(Protocol):
    """Where the bytes are."""

    def read(self, start: int, length: int) -> bytes:
        """Return up to `length` bytes; fewer at the end."""

    def write(self, start: int, data: bytes) -> None:
        """Replace bytes; return once they are safely stored."""

    def create(self, data: bytes) -> None:
        """Store the initial content: all of it or nothing."""

    def close(self) -> None:
        """Release it."""


class FileMedium:
    """A file, locked against other firmware processes.

    Parameters
    ----------
    path : Path
        Created empty if it does not exist; its folder must exist.

    Raises
    ------
    StoreError
        When it cannot be opened, or another process uses it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = -1
        try:
            if not path.parent.is_dir():
                raise StoreError(f"{path}: no such folder: {path.parent}")
            if path.exists() and not path.is_file():  # a device would be read and replaced
                raise StoreError(f"{path}: is not a file")
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise StoreError(f"{path}: cannot be opened: {error.strerror}") from error
        if not self._lock(file):
            os.close(file)
            raise StoreError(f"{path}: in use by another firmware process")
        self._file = file

    def _lock(self, file: int) -> bool:
        """Lock an open file; return whether it is locked and still the file at the path."""
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return os.path.samestat(os.fstat(file), self._path.stat())
        except OSError:
            return False

    def read(self, start: int, length: int) -> bytes:
        """Return up to `length` bytes; fewer at the end."""
        try:
            return os.pread(self._file, length, start)
        except OSError as error:
            raise StoreError(f"{self._path}: cannot be read: {error.strerror}") from error

    def write(self, start: int, data: bytes) -> None:
        """Replace bytes; return once they are safely stored."""
        try:
            done = 0
            while done < len(data):
                done += os.pwrite(self._file, data[done:], start + done)
            os.fsync(self._file)
        except OSError as error:
            raise StoreError(f"{self._path}: cannot be written: {error.strerror}") from error

    def create(self, data: bytes) -> None:
        """Store the initial content: all of it or nothing."""
        aside = self._path.with_name(f".{self._path.name}.{os.getpid()}")
        empty, file = self._file, -1
        try:
            file = os.open(aside, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # before anyone can open it
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
            raise StoreError(f"{self._path}: cannot be created: {why}") from error
        os.close(empty)

    def close(self) -> None:
        """Release the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __str__(self) -> str:
        return str(self._path)


class Condition(Enum):
    """Condition of the memory when it was read."""

    BLANK = "never written"
    WHOLE = "both copies sound"
    ONE_DAMAGED = "one copy damaged"
    LOST = "both copies damaged"


@dataclass(frozen=True)
class StoredCopy:
    """The memory's content: `image` is None if there is none, `sequence` counts the writes."""

    condition: Condition
    image: bytes | None = None
    sequence: int = 0


class TwoCopyStore:
    """An image in two copies.

    Parameters
    ----------
    capacity : int
        Largest image, bytes.
    """

    def __init__(self, medium: StorageMedium, capacity: int) -> None:
        self._medium = medium
        self._capacity = capacity
        self.slot_size = -(-(IMAGE + capacity) // PAGE) * PAGE
        """Bytes of a copy, in whole pages."""

    def read(self) -> StoredCopy:
        """Return the valid copy.

        Raises
        ------
        StoreError
            When it cannot be read, or is not a memory of this kind.
        """
        copies = [self._copy(slot) for slot in range(2)]
        raw = self._medium.read(0, 2 * self.slot_size + 1)
        if not raw:
            return StoredCopy(Condition.BLANK)
        is_ours = MAGIC in (raw[:4], raw[self.slot_size : self.slot_size + 4])
        if not is_ours and len(raw) != 2 * self.slot_size:
            raise StoreError(f"{self._medium}: not a memory of this kind; left unchanged")
        sound = [copy for copy in copies if copy is not None]
        if not sound:
            return StoredCopy(Condition.LOST)
        sequence, image = max(sound)
        condition = Condition.WHOLE if len(sound) == 2 else Condition.ONE_DAMAGED
        return StoredCopy(condition, image, sequence)

    def _copy(self, slot: int) -> tuple[int, bytes] | None:
        """Return the sequence number and image of a copy; None if it is damaged."""
        data = self._medium.read(slot * self.slot_size, IMAGE + self._capacity)
        if len(data) < IMAGE:
            return None
        magic, version, _, sequence, length, crc = _HEAD.unpack_from(data)
        head_holds = _CRC.unpack_from(data, _HEAD.size)[0] == zlib.crc32(data[: _HEAD.size])
        image = data[IMAGE : IMAGE + length]
        if not head_holds or magic != MAGIC or version != VERSION or zlib.crc32(image) != crc:
            return None
        return sequence, image

    def write(self, image: bytes) -> None:
        """Store an image; on return it is valid and safely stored.

        Raises
        ------
        StoreError
            When it cannot be written; the previous image remains valid.
        """
        if len(image) > self._capacity:
            raise StoreError(f"{self._medium}: {len(image)} bytes, limit {self._capacity}")
        copies = [self._copy(slot) for slot in range(2)]
        sequences = [-1 if copy is None else copy[0] for copy in copies]
        sequence = max(0, *sequences) + 1
        if not self._medium.read(0, 1):
            first = self._slot(image, sequence).ljust(self.slot_size, b"\0")
            second = self._slot(image, sequence + 1).ljust(self.slot_size, b"\0")
            self._medium.create(first + second)
            return
        slot = sequences.index(min(sequences))  # the damaged or older one
        self._medium.write(slot * self.slot_size, self._slot(image, sequence))
        if self._copy(slot) != (sequence, image):
            raise StoreError(f"{self._medium}: verification after writing failed")

    @staticmethod
    def _slot(image: bytes, sequence: int) -> bytes:
        head = _HEAD.pack(MAGIC, VERSION, 0, sequence, len(image), zlib.crc32(image))
        return head + _CRC.pack(zlib.crc32(head)) + image

    def close(self) -> None:
        """Release the medium."""
        self._medium.close()


@dataclass(frozen=True)
class Stores:
    """The non-volatile memories of a computer; None for one that is volatile."""

    parameters: TwoCopyStore | None = None
    faults: TwoCopyStore | None = None


def open_stores(path: Path, parameter_capacity: int, fault_capacity: int) -> Stores:
    """Open the memories of a computer: a file for the parameters, another for the trouble codes.

    Parameters
    ----------
    path : Path
        Of the parameters; the path of the trouble codes adds ``.dtc``.
    parameter_capacity, fault_capacity : int
        Bytes.

    Raises
    ------
    StoreError
        When a file cannot be opened.
    """
    parameters = TwoCopyStore(FileMedium(path), parameter_capacity)
    faults = TwoCopyStore(FileMedium(path.with_name(path.name + ".dtc")), fault_capacity)
    return Stores(parameters, faults)
