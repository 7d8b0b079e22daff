"""Reads BLF logs: runs of classic frames as arrays, the rest with python-can, all within limits.

A damaged size costs neither memory nor time.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass

import can
import numpy as np
import numpy.typing as npt
from can.io.blf import BLFParseError

from rrins.compiled.record import Floats, Integers
from rrins.dbc.frame import EFF_FLAG, RTR_FLAG, FrameArray, frame_array

_HEADER = struct.Struct("<4sHHLL")  # signature, header's size, its version, size, type
_CONTAINER = struct.Struct("<H14x")  # compression
_CONTAINER_TYPE = 10
_STORED, _DEFLATED = 0, 2
_SIGNATURE = b"LOBJ"
_LARGEST_CONTAINER = 64 << 20  # bytes, unpacked; Vector's and python-can's have 128 KiB
_LARGEST_OBJECT = 16 << 20  # bytes; a CAN FD frame has some 150
_SEARCHED = 8  # bytes from the end of an object in which the next begins
_RUN = 32  # objects alike that are worth an array
_EMPTY_OBJECT = re.compile(_SIGNATURE + rb".{4}\0{4}", re.DOTALL)
_FIELDS = ("begin", "size", "kind", "unit", "time", "channel", "flags", "dlc", "id", "data")
CLASSIC = {
    size: np.dtype(
        {
            "names": list(_FIELDS),
            "formats": ["<u8", "<u4", "<u4", "<u4", "<u8", "<u2", "u1", "u1", "<u4", "<u8"],
            "offsets": [0, 8, 12, 16, 24, 32, 34, 35, 36, 40],
            "itemsize": size,
        }
    )
    for size in (48, 56)
}
"""Classic frames by their size: Vector's newer ones have 8 bytes more, which say nothing new."""
_KINDS = (1, 86)  # CAN_MESSAGE, CAN_MESSAGE2
BEGIN = int.from_bytes(struct.pack("<4sHH", _SIGNATURE, 32, 1), "little")
"""The first eight bytes of such a frame."""
_BEGINNING = struct.Struct("<QLL8xQ")  # begin, size, kind, time
_TENS_OF_US = 1  # the unit of a time; else it is 1 ns
_LATEST = 1 << 53  # a float holds all times up to there
_REMOTE = 0x80
MASKS = np.array([(1 << 8 * length) - 1 for length in range(9)], dtype=np.uint64)
"""Of the payload, by length."""


@dataclass(frozen=True)
class Run:
    """Consecutive frames, with their times in s and their channels' numbers."""

    frames: FrameArray
    time_s: Floats
    channels: Integers


class BlfReader(can.BLFReader):
    """python-can's reader with limits to the sizes that a file states, and faster.

    It yields messages and, for runs of classic frames that are as usual, `Run`.

    Raises
    ------
    can.io.blf.BLFParseError
        While it is read: if a size is beyond its limit, or zero.
    """

    def __iter__(self) -> Generator[can.Message | Run, None, None]:  # type: ignore[override]  # a Run, too
        while header := self.file.read(_HEADER.size):
            signature, _, _, size, kind = _HEADER.unpack(header)
            if signature != _SIGNATURE:
                raise BLFParseError("no object where one should begin")
            _check_size(size, _LARGEST_CONTAINER)
            content = self.file.read(size - _HEADER.size)
            self.file.read(size % 4)  # padding
            if kind == _CONTAINER_TYPE:
                yield from self._parse_container(_unpacked(content))
        self.stop()

    def _parse_container(self, data: bytes) -> Iterator[can.Message | Run]:  # type: ignore[override]  # a Run, too
        yield from super()._parse_container(data)
        if len(self._tail) >= _HEADER.size and self._tail.startswith(_SIGNATURE):
            _check_size(_HEADER.unpack_from(self._tail)[3], _LARGEST_OBJECT)

    def _parse_data(self, data: bytes) -> Iterator[can.Message | Run]:  # type: ignore[override]  # a Run, too
        empty = _empty_object(data)
        if empty is not None:
            data = data[:empty]
        at = 0
        while True:
            begin, run = _run(data, at)
            if len(run):
                yield self._frames_of(run)
                at = begin + run.nbytes
            end = _next_run(data, at)
            try:
                yield from self._by_message(data[at:end], at)
            except struct.error:  # an object is shorter than its kind
                if end == len(data):
                    raise
                at, end = self._pos, len(data)
                yield from self._by_message(data[at:], at)
            if end == len(data):
                break
            at = end
        if empty is not None:
            raise BLFParseError("an object of 0 bytes")

    def _by_message(self, data: bytes, begin: int) -> Iterator[can.Message]:
        """Read objects with python-can; `begin` is where they are in the container."""
        try:
            yield from super()._parse_data(data)
        finally:
            self._pos += begin

    def _frames_of(self, run: npt.NDArray[np.void]) -> Run:
        """Return the frames of a run."""
        frames = frame_array(len(run))
        identifiers, is_remote = run["id"], (run["flags"] & _REMOTE) != 0
        frames["can_id"] = identifiers & (0x1FFF_FFFF | EFF_FLAG)  # where a BLF has it, too
        frames["can_id"][is_remote] |= RTR_FLAG
        frames["length"] = np.minimum(run["dlc"], 8)
        frames["data"] = np.where(is_remote, np.uint64(0), run["data"] & MASKS[frames["length"]])
        per_s = np.where(run["unit"] == _TENS_OF_US, 1e5, 1e9)
        time_s = run["time"] / per_s + self.start_timestamp
        return Run(frames, time_s, run["channel"].astype(np.int64))


def _run(data: bytes, at: int) -> tuple[int, npt.NDArray[np.void]]:
    """Return where the object at a place begins, and the classic frames from there on if alike."""
    begin = data.find(_SIGNATURE, at, at + _SEARCHED)
    key = _key(data, begin)
    if key is None:
        return at, np.zeros(0, CLASSIC[48])
    size, kind = key
    objects = np.frombuffer(data, CLASSIC[size], (len(data) - begin) // size, begin)
    alike = (objects["begin"] == BEGIN) & (objects["size"] == size) & (objects["kind"] == kind)
    alike &= objects["time"] < _LATEST
    others = np.flatnonzero(~alike)
    return begin, objects[: others[0]] if len(others) else objects


def _key(data: bytes, begin: int) -> tuple[int, int] | None:
    """Return size and kind of a classic frame; None if the object is something else, or cut off."""
    if not 0 <= begin <= len(data) - _BEGINNING.size:
        return None
    head, size, kind, time = _BEGINNING.unpack_from(data, begin)
    is_classic = head == BEGIN and size in CLASSIC and kind in _KINDS and time < _LATEST
    return (size, kind) if is_classic and begin + size <= len(data) else None


def _next_run(data: bytes, at: int) -> int:
    """Return where the next run of classic frames begins that is worth an array; or the end."""
    alike, before = 0, None
    start = at
    while (begin := data.find(_SIGNATURE, at, at + _SEARCHED)) >= 0:
        if begin + _HEADER.size > len(data):
            break
        key = _key(data, begin)
        if key is None or key != before:
            start, alike, before = begin, 0, key
        alike += key is not None
        if alike == _RUN:
            return start
        size = _HEADER.unpack_from(data, begin)[3]
        if size < _HEADER.size:
            break
        at = begin + size
    return len(data)


def _check_size(size: int, most: int) -> None:
    if not _HEADER.size <= size <= most:
        raise BLFParseError(f"an object of {size} bytes")


def _unpacked(content: bytes) -> bytes:
    """Return what a container holds."""
    (method,) = _CONTAINER.unpack_from(content)
    packed = content[_CONTAINER.size :]
    if method == _STORED:
        return packed
    if method != _DEFLATED:
        raise BLFParseError(f"a container of unknown compression {method}")
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(packed, _LARGEST_CONTAINER)
    if unpacker.unconsumed_tail:
        raise BLFParseError(f"a container of more than {_LARGEST_CONTAINER >> 20} MiB")
    return data


def _empty_object(data: bytes) -> int | None:
    """Return where an object of no bytes begins, which a reader would read again and again."""
    if _EMPTY_OBJECT.search(data) is None:  # as good as always
        return None
    at = data.find(_SIGNATURE, 0, 8)
    while 0 <= at <= len(data) - _HEADER.size:
        size = _HEADER.unpack_from(data, at)[3]
        if size == 0:
            return at
        at = data.find(_SIGNATURE, at + size, at + size + 8)
    return None
