"""The lines of PEAK and CSV logs on their way to python-can's readers.

Those leave some lines out silently, and give up at one whose numbers are damaged. Lines that are
handed on are counted, and a reader that gave up can be begun again with the next line.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

_FIRST_COLUMNS = 5
_NO_FRAMES = frozenset(("ST", "ER", "EC", "EV", "ET", "Warng", "Error", "FFFFFFFF"))
"""What one of the first columns says in a line of status, error or event, in all versions."""


class TrcLines:
    """The lines of a PEAK log, an iterator.

    Parameters
    ----------
    file : text file

    Attributes
    ----------
    frames : int
        Lines handed on that should be frames.
    bad_lines : int
        Lines left out: the last one, where it has no end and is cut within a byte.
    """

    fd_frames = 0
    is_open = False

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self.frames = 0
        self.bad_lines = 0
        self._lines = self._counted()

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def begin_again(self) -> None:
        """Go on with the next line; a reader that begins takes it for a frame if it looks so."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _counted(self) -> Iterator[str]:
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


class CsvLines:
    """The lines of a table, an iterator that begins with a header however often it is begun.

    Parameters
    ----------
    file : text file

    Attributes
    ----------
    frames : int
        Lines handed on that should be frames.
    """

    bad_lines = 0
    fd_frames = 0
    is_open = False

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self._header = next(file, "")
        self.frames = 0
        self._lines = self._counted()

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        return next(self._lines)

    def begin_again(self) -> None:
        """Hand on a header next, which a reader that begins skips."""
        self._lines = self._counted()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _counted(self) -> Iterator[str]:
        yield self._header
        for line in self._file:
            if line.strip():
                self.frames += 1
                yield line
