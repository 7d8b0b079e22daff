"""Unpacks gzip up to any damage, and reports the damage."""

from __future__ import annotations

import io
import zlib
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

_PACKED = 1 << 16  # bytes
_GZIP = 31  # zlib's wbits value for gzip


class Unpacked(io.RawIOBase):
    """The content of a gzip file as a stream that ends where the file becomes unreadable.

    `gzip.GzipFile` raises an error instead and loses what it has unpacked in the same read.

    Parameters
    ----------
    packed : binary file

    Attributes
    ----------
    size : int
        Bytes unpacked so far.
    failure : str or None
        Why the content ends early; None if it does not.
    """

    def __init__(self, packed: IO[bytes]) -> None:
        self._packed = packed
        self._unpacker: zlib._Decompress | None = None
        self._content = memoryview(b"")
        self.size = 0
        self.failure: str | None = None

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        """Read into a buffer; return the number of bytes, 0 at the end."""
        while not self._content and self._unpack():
            pass
        room = memoryview(buffer)
        count = min(len(room), len(self._content))
        room[:count] = self._content[:count]
        self._content = self._content[count:]
        return count

    def close(self) -> None:
        """Close the file."""
        self._packed.close()
        super().close()

    def _unpack(self) -> bool:
        """Unpack more of the file; return whether there may be more."""
        if self.failure is not None:
            return False
        packed = self._packed.read(_PACKED)
        if not packed:
            if self._unpacker is not None:
                self.failure = "its compressed data end too early"
            return False
        content = bytearray()
        try:
            while packed:
                packed = self._unpack_member(packed, content)
        except zlib.error as error:
            self.failure = f"its compressed data are damaged: {error}"
        self.size += len(content)
        self._content = memoryview(bytes(content))
        return True

    def _unpack_member(self, packed: bytes, content: bytearray) -> bytes:
        """Unpack the current or next member; return the remaining bytes."""
        if self._unpacker is None:
            packed = packed.lstrip(b"\0")  # padding after a member
            if not packed:
                return b""
            self._unpacker = zlib.decompressobj(_GZIP)
        before = self._unpacker.copy()
        try:
            content += self._unpacker.decompress(packed)
        except zlib.error:
            for byte in packed:  # once more, up to the damage
                content += before.decompress(bytes((byte,)))
            raise
        rest: bytes = self._unpacker.unused_data
        if self._unpacker.eof:
            self._unpacker = None
        return rest
