"""Unpacks gzip up to any damage, and reports the damage."""

from __future__ import annotations

import gzip
import io
import zlib
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

_AT_ONCE = io.DEFAULT_BUFFER_SIZE  # as many bytes may be lost before a damaged place


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
        self._content = gzip.GzipFile(fileobj=packed)
        self.size = 0
        self.failure: str | None = None

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        """Read into a buffer; return the number of bytes, 0 at the end."""
        if self.failure is not None:
            return 0
        room = memoryview(buffer)
        try:
            content = self._content.read1(min(len(room), _AT_ONCE))
        except EOFError:
            self.failure = "its compressed data end too early"
            return 0
        except (gzip.BadGzipFile, zlib.error) as error:
            self.failure = f"its compressed data are damaged: {error}"
            return 0
        room[: len(content)] = content
        self.size += len(content)
        return len(content)

    def close(self) -> None:
        """Close the file."""
        self._packed.close()
        super().close()
