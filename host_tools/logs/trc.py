"""The lines of a PEAK log on their way to python-can's reader, which leaves some out silently."""

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
