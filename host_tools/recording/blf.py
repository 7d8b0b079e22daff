"""Reads BLF logs with python-can, within limits: a damaged size costs neither memory nor time."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Generator, Iterator

import can
from can.io.blf import BLFParseError

_HEADER = struct.Struct("<4sHHLL")  # signature, header's size, its version, size, type
_CONTAINER = struct.Struct("<H14x")  # compression
_CONTAINER_TYPE = 10
_STORED, _DEFLATED = 0, 2
_SIGNATURE = b"LOBJ"
_LARGEST_CONTAINER = 64 << 20  # bytes, unpacked; Vector's and python-can's have 128 KiB
_LARGEST_OBJECT = 16 << 20  # bytes; a CAN FD frame has some 150
_EMPTY_OBJECT = re.compile(_SIGNATURE + rb".{4}\0{4}", re.DOTALL)


class BlfReader(can.BLFReader):
    """python-can's reader with limits to the sizes that a file states.

    Raises
    ------
    can.io.blf.BLFParseError
        While it is read: if a size is beyond its limit, or zero.
    """

    def __iter__(self) -> Generator[can.Message, None, None]:
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

    def _parse_container(self, data: bytes) -> Iterator[can.Message]:
        yield from super()._parse_container(data)
        if len(self._tail) >= _HEADER.size and self._tail.startswith(_SIGNATURE):
            _check_size(_HEADER.unpack_from(self._tail)[3], _LARGEST_OBJECT)

    def _parse_data(self, data: bytes) -> Iterator[can.Message]:
        at = _empty_object(data)
        yield from super()._parse_data(data if at is None else data[:at])
        if at is not None:
            raise BLFParseError("an object of 0 bytes")


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
