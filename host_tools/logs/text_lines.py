"""The lines of text logs, PEAK's and CSV among them, on their way to python-can's readers.

Those leave some lines out silently, and give up at one whose numbers are damaged. Lines that are
handed on are counted, and a reader that gave up can be begun again with the next line.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import IO

_FIRST_COLUMNS = 5
_NO_FRAMES = frozenset(("ST", "ER", "EC", "EV", "ET", "Warng", "Error", "FFFFFFFF"))
"""What one of the first columns says in a line of status, error or event, in all versions."""


class TextLines(ABC):
    """The lines of a text log that python-can's reader is to see, an iterator.

    Parameters
    ----------
    file : text file

    Attributes
    ----------
    frames : int
        Lines handed on that should be frames.
    bad_lines : int
        Lines left out that are neither frames nor anything else that a log may have.
    fd_frames : int
        CAN FD frames, which are passed over.
    is_open : bool
        Whether a block of frames has begun and not ended, as when the writer was killed.
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
        """Be ready for a reader that begins again, with the next line."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @abstractmethod
    def _sound(self) -> Iterator[str]:
        """Yield the lines that are handed on."""


class TrcLines(TextLines):
    """The lines of a PEAK log; the last one is left out where it is cut within a byte."""

    def begin_again(self) -> None:
        """Go on with the next line; a reader that begins takes it for a frame if it looks so."""

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
    """The lines of a table, which begin with its header however often they are begun."""

    def __init__(self, file: IO[str]) -> None:
        self._header = next(file, "")
        super().__init__(file)

    def begin_again(self) -> None:
        """Hand on a header next, which a reader that begins skips."""
        self._lines = self._sound()

    def _sound(self) -> Iterator[str]:
        yield self._header
        for line in self._file:
            if line.strip():
                self.frames += 1
                yield line
