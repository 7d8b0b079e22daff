"""Filters the lines of text logs (PEAK, CSV and others) for python-can's readers.

Those readers silently skip some lines and give up at a line with damaged numbers. The lines passed
on are counted, and a reader that gave up can be restarted at the next line.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import IO

_FIRST_COLUMNS = 5
_NO_FRAMES = frozenset(("ST", "ER", "EC", "EV", "ET", "Warng", "Error", "FFFFFFFF"))
"""Markers of status, error and event lines in one of the first columns, for all versions."""


class TextLines(ABC):
    """An iterator of the lines of a text log to pass to python-can's reader.

    Parameters
    ----------
    file : text file

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

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.frames = 0
        self.bad_lines = 0
        self.fd_frames = 0
        self.is_open = False
        self._lines = self._sound()

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        return next(self._lines)

    @abstractmethod
    def begin_again(self) -> None:
        """Prepare for a reader that restarts at the next line."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @abstractmethod
    def _sound(self) -> Iterator[str]:
        """Yield the lines to pass on."""


class TrcLines(TextLines):
    """The lines of a PEAK log; the last one is skipped if it is cut off within a byte."""

    def begin_again(self) -> None:
        """Continue with the next line; a new reader takes it for a frame if it looks like one."""

    def _sound(self) -> Iterator[str]:
        for line in self._file:
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

    def __init__(self, file: IO[str]) -> None:
        self._header = next(file, "")
        super().__init__(file)

    def begin_again(self) -> None:
        """Supply a header next, which a new reader skips."""
        self._lines = self._sound()

    def _sound(self) -> Iterator[str]:
        yield self._header
        for line in self._file:
            if line.strip():
                self.frames += 1
                yield line
