"""Unpacks gzip up to where it is damaged, and says what the damage is."""

from __future__ import annotations

import io
import zlib
from typing import IO, Any

_PACKED = 1 << 16  # bytes
_GZIP = 31  # zlib's word for gzip's header and trailer


class Unpacked(io.RawIOBase):
    """The content of a gzip file, as a stream that ends where the file cannot be unpacked on.

    `gzip.GzipFile` raises an error instead, and what it has unpacked with the same reading is lost.

    Parameters
    ----------
    packed : binary file

    Attributes
    ----------
    size : int
        Bytes unpacked so far.
    failure : str or None
        Why the content ends before its end; None while all is well.
    """

    def __init__(self, packed: IO[bytes]) -> None:
        self._packed = packed
        self._unpacker: Any = None
        self._content = memoryview(b"")
        self.size = 0
        self.failure: str | None = None

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer; return how many bytes, 0 at the end."""
        while not self._content and self._unpack():
            pass
        count = min(len(buffer), len(self._content))
        buffer[:count] = self._content[:count]
        self._content = self._content[count:]
        return count

    def close(self) -> None:
        """Close the file."""
        self._packed.close()
        super().close()

    def _unpack(self) -> bool:
        """Unpack the next bytes of the file; return whether there may be more."""
        if self.failure is not None:
            return False
        packed = self._packed.read(_PACKED)
        if not packed:
            if self._unpacker is not None:
                self.failure = "its packed data end too early"
            return False
        content = bytearray()
        try:
            while packed:
                packed = self._unpack_member(packed, content)
        except zlib.error as error:
            self.failure = f"its packed data are damaged: {error}"
        self.size += len(content)
        self._content = memoryview(bytes(content))
        return True

    def _unpack_member(self, packed: bytes, content: bytearray) -> bytes:
        """Unpack what belongs to the member that is begun, or begins; return the rest."""
        if self._unpacker is None:
            packed = packed.lstrip(b"\0")  # what may fill a file up behind a member
            if not packed:
                return b""
            self._unpacker = zlib.decompressobj(_GZIP)
        before = self._unpacker.copy()
        try:
            content += self._unpacker.decompress(packed)
        except zlib.error:
            for byte in packed:  # again, up to the damage
                content += before.decompress(bytes((byte,)))
            raise
        rest: bytes = self._unpacker.unused_data
        if self._unpacker.eof:
            self._unpacker = None
        return rest
