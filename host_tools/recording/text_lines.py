"""The lines of text logs (PEAK, CSV and others) for python-can's readers.

Those silently skip some lines and give up at a line with damaged numbers: the lines passed on are
counted, and a reader that gave up can be restarted at the next line.
"""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import IO

_LONGEST_LINE = 1 << 20  # characters
_FIRST_COLUMNS = 4
_NO_FRAMES = frozenset(("ST", "ER", "EC", "EV", "ET", "Warng", "Error", "FFFFFFFF"))
"""Markers of status, error and event lines in one of the first columns, for all versions."""


class TextLines(ABC):
    """An iterator of the lines of a text log that python-can's reader has to read.

    Parameters
    ----------
    stream : binary file

    Attributes
    ----------
    frames : int
        Lines passed on that should be frames.
    bad_lines : int
        Skipped lines that are neither frames nor other valid content of a log.
    fd_frames : int
        CAN FD frames, which are skipped.
    is_open : bool
        Whether a block of frames has no end, for example because the writer was killed.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._text = io.TextIOWrapper(stream, encoding="utf-8-sig", errors="replace")
        self.frames = 0
        self.bad_lines = 0
        self.fd_frames = 0
        self.is_open = False
        self._lines = self._sound()

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        return next(self._lines)

    def begin_again(self) -> None:
        """Prepare for a reader that restarts at the next line."""
        self._lines = self._sound()

    def close(self) -> None:
        """Close the file."""
        self._text.close()

    @abstractmethod
    def _sound(self) -> Iterator[str]:
        """Yield the lines to pass on."""

    def _all(self) -> Iterator[str]:
        """Yield the lines of the file, except those that no log has because they are too long."""
        while line := self._text.readline(_LONGEST_LINE):
            if len(line) < _LONGEST_LINE or line.endswith("\n"):
                yield line
                continue
            self.bad_lines += 1
            while line and not line.endswith("\n"):
                line = self._text.readline(_LONGEST_LINE)


class TrcLines(TextLines):
    """The lines of a PEAK log; the last one is skipped if it is cut off within a byte."""

    def _sound(self) -> Iterator[str]:
        for line in self._all():
            columns = line.split()
            if not columns:
                continue
            if columns[0].startswith(";") or _NO_FRAMES.intersection(columns[:_FIRST_COLUMNS]):
                yield line
            elif line.endswith("\n") or len(columns[-1]) > 1:
                self.frames += 1
                yield line
            else:
                self.bad_lines += 1


class CsvLines(TextLines):
    """The lines of a CSV table; every restart repeats the header."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._header: str | None = None
        super().__init__(stream)

    def _sound(self) -> Iterator[str]:
        lines = self._all()
        if self._header is None:
            self._header = next(lines, "")
        yield self._header
        for line in lines:
            if line.strip():
                self.frames += 1
                yield line
