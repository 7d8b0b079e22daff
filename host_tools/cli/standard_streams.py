"""Standard output and standard error of a command: on a full disk, and for names of any bytes.

Results that cannot be written end the command in one line. Progress and notes on standard error
are left out instead: the run goes on, and its exit status says how it ended.
"""

from __future__ import annotations

import codecs
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from rrins.host_tools.errors import RehearsalError

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


_ANY_TEXT = "rrins-any-text"
"""Name of the error handler under which nothing that is printed is an error."""


def _encode_anyway(error: UnicodeError) -> tuple[str | bytes, int]:
    """Give back the bytes of a file name that is not UTF-8; ``?`` for what the terminal lacks."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    given = (bytes([ord(c) - 0xDC00]) if "\udc80" <= c <= "\udcff" else b"?" for c in text)
    return b"".join(given), error.end


codecs.register_error(_ANY_TEXT, _encode_anyway)


class OutputError(RehearsalError):
    """Standard output cannot be written."""


class _Stream(io.FileIO):
    """The descriptor of a standard stream; after a failure to write, nothing more is written."""

    _has_failed = False

    def write(self, data: ReadableBuffer, /) -> int:
        """Write, or leave out."""
        if not self._has_failed:
            try:
                return super().write(data)
            except (
                BrokenPipeError
            ):  # the reader has seen enough, as `head` does; click ends quietly
                raise
            except OSError as error:
                self._has_failed = True
                self._on_failure(error)
        return memoryview(data).nbytes

    def _on_failure(self, error: OSError) -> None:
        """Leave it out."""


class _Results(_Stream):
    """Standard output."""

    def _on_failure(self, error: OSError) -> None:
        why = error.strerror or error
        raise OutputError(f"standard output cannot be written: {why}") from error


def _guarded(stream: TextIO | None, kind: type[_Stream]) -> TextIO:
    """Return a text stream of a kind that writes where `stream` does."""
    if stream is None:  # closed by who started the command
        return Path(os.devnull).open("w", encoding="utf-8")
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(kind(stream.fileno(), "w", closefd=False)),
        encoding=stream.encoding,
        errors=_ANY_TEXT,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


@contextmanager
def guarded_streams() -> Iterator[None]:
    """Guard the standard streams.

    Raises
    ------
    OutputError
        When standard output cannot be written.
    """
    sys.stdout = _guarded(sys.stdout, _Results)
    sys.stderr = _guarded(sys.stderr, _Stream)
    try:
        yield
    finally:
        sys.stdout.flush()
