"""The lines of text logs (PEAK, CSV and others): the usual ones parsed, the others filtered.

Lines that are exactly as usual are parsed many at a time (`recording.frame_lines`). All others go
to python-can's readers. Those silently skip some lines and give up at a line with damaged numbers:
the lines passed on are counted, and a reader that gave up can be restarted at the next line.
"""

from __future__ import annotations

import codecs
import re
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import IO, Final

import numpy as np
from can.io.trc import TRCFileVersion, TRCReader

from rrins.compiled.record import Bytes, Floats, Integers
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.recording import frame_lines
from rrins.host_tools.recording.frame_lines import (
    BUS,
    DATA,
    DATA_TYPE,
    DIRECTION,
    IDENTIFIER,
    LENGTH,
    NUMBER,
    RESERVED,
    TIME_MS,
)

_BLOCK = 1 << 20  # bytes
_LONGEST_LINE = 1 << 20  # bytes
_PADDING = bytes(64)  # behind a block: nothing is read beyond it
_LINE = re.compile(r"[^\n]*\n|[^\n]+")
_FIRST_COLUMNS = 4
_NO_FRAMES = frozenset(("ST", "ER", "EC", "EV", "ET", "Warng", "Error", "FFFFFFFF"))
"""Markers of status, error and event lines in one of the first columns, for all versions."""


class BlockRead(Exception):  # noqa: N818 - no error: it takes a reader's turn from it
    """The lines of a block have been parsed; its frames can be taken."""


@dataclass(frozen=True)
class Layout:
    """How the usual lines of a log look.

    Attributes
    ----------
    form : int
        `frame_lines.ASC`, `TRC` or `CSV`.
    roles : array of int64
        What the columns of a PEAK log hold.
    per_s : float
        Units of its times in a second.
    begun_s : float
        What is then added to them.
    """

    form: int
    roles: Integers
    per_s: float = 1.0
    begun_s: float = 0.0


@dataclass(frozen=True)
class Parsed:
    """Frames parsed from lines, in order: with their times, s, and their channels' numbers."""

    frames: FrameArray
    time_s: Floats
    channels: Integers


class _Block:
    """Whole lines of a log, and the frames that have been parsed from them."""

    def __init__(self, content: bytes) -> None:
        self.text: Bytes = np.frombuffer(content + _PADDING, dtype=np.uint8)
        self.content = content
        self.at = 0
        capacity = len(content) // frame_lines.SHORTEST_LINE + 1
        self._frames = frame_array(capacity)
        self._times = np.zeros(capacity)
        self._channels = np.zeros(capacity, dtype=np.int64)
        self._row = 0
        self._taken = 0

    @property
    def is_over(self) -> bool:
        return self.at >= len(self.content)

    @property
    def is_taken(self) -> bool:
        return self._taken == self._row

    def parse(self, layout: Layout) -> int:
        """Parse usual lines up to the next that is not; return their number."""
        before = self._row
        self.at, self._row = frame_lines.parse(
            layout.form,
            self.text,
            self.at,
            len(self.content),
            layout.roles,
            self._frames,
            self._times,
            self._channels,
            before,
        )
        mine = self._times[before : self._row]
        if layout.per_s != 1:
            mine /= layout.per_s
        mine += layout.begun_s
        return self._row - before

    def line(self) -> bytes:
        """Return the next line as it is."""
        end = self.content.find(b"\n", self.at) + 1 or len(self.content)
        line = self.content[self.at : end]
        self.at = end
        return line

    def take(self) -> Parsed | None:
        """Return the frames parsed since the last call, if any."""
        rows = slice(self._taken, self._row)
        self._taken = self._row
        if rows.start == rows.stop:
            return None
        return Parsed(self._frames[rows], self._times[rows], self._channels[rows])


class TextLines(ABC):
    """An iterator of the lines of a text log that python-can's reader has to read.

    Parameters
    ----------
    stream : binary file

    Attributes
    ----------
    parsed : int
        Frames of the lines that were parsed here; `take` returns them.
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
        self._stream = stream
        self._block = _Block(b"")
        self._rest = stream.read(len(codecs.BOM_UTF8)).removeprefix(codecs.BOM_UTF8)
        self._odd: deque[str] = deque()
        self._is_at_end = False
        self._is_overlong = False  # within a line that is too long: the rest is skipped
        self.parsed = 0
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

    def take(self) -> Parsed | None:
        """Return the frames parsed since the last call, if any: those before the current line."""
        return self._block.take()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    @abstractmethod
    def layout(self) -> Layout | None:
        """Return how the usual lines of the log look from here on, if that is known."""

    @abstractmethod
    def _sound(self) -> Iterator[str]:
        """Yield the lines to pass on."""

    def _others(self) -> Iterator[str]:
        """Yield the lines that are not parsed here.

        Raises
        ------
        BlockRead
            When frames have to be taken before more is read.
        """
        while True:
            if self._odd:
                yield self._odd.popleft()
                continue
            if self._block.is_over:
                if not self._block.is_taken:
                    raise BlockRead
                if not self._read_block():
                    return
            layout = self.layout()
            if layout is not None:
                self.parsed += self._block.parse(layout)
            if not self._block.is_over:
                self._odd.extend(_lines_of(self._block.line()))

    def _read_block(self) -> bool:
        """Read whole lines, or what is left at the end; return whether there was anything."""
        while not self._is_at_end:
            content = self._stream.read(_BLOCK)
            self._is_at_end = not content
            if self._is_overlong:
                content = content[_first_end(content) :]
                self._is_overlong = not content
            text = self._rest + content
            end = len(text) if self._is_at_end else 1 + max(text.rfind(b"\n"), text.rfind(b"\r"))
            whole, self._rest = text[:end], text[end:]
            if len(self._rest) > _LONGEST_LINE:  # no line is this long
                self._rest = b""
                self._is_overlong = True
                self.bad_lines += 1
            if whole:
                self._block = _Block(whole)
                return True
        return False


def _first_end(content: bytes) -> int:
    """Return where the first line ends, or the length if it does not."""
    ends = [end for end in (content.find(b"\n"), content.find(b"\r")) if end >= 0]
    return min(ends, default=len(content))


def _lines_of(line: bytes) -> list[str]:
    """Return a line as text; a carriage return inside of it ends a line, too."""
    text = line.decode("utf-8", "replace")
    if "\r" not in text:
        return [text]
    return _LINE.findall(text.replace("\r\n", "\n").replace("\r", "\n"))


_NONE: Final = np.zeros(0, dtype=np.int64)
_PEAK_COLUMNS: Final = {
    "N": NUMBER,
    "O": TIME_MS,
    "T": DATA_TYPE,
    "B": BUS,
    "I": IDENTIFIER,
    "d": DIRECTION,
    "R": RESERVED,
    "L": LENGTH,
    "l": LENGTH,
    "D": DATA,
}
_PEAK_NEEDS: Final = {TIME_MS, DATA_TYPE, IDENTIFIER, DIRECTION, LENGTH, DATA}
_PEAK_1: Final = {
    TRCFileVersion.UNKNOWN: (NUMBER, TIME_MS, IDENTIFIER, LENGTH, DATA),
    TRCFileVersion.V1_0: (NUMBER, TIME_MS, IDENTIFIER, LENGTH, DATA),
    TRCFileVersion.V1_1: (NUMBER, TIME_MS, DIRECTION, IDENTIFIER, LENGTH, DATA),
    TRCFileVersion.V1_3: (NUMBER, TIME_MS, BUS, DIRECTION, IDENTIFIER, RESERVED, LENGTH, DATA),
}
_PER_S = 1000.0


class TrcLines(TextLines):
    """The lines of a PEAK log; the last one is skipped if it is cut off within a byte.

    Attributes
    ----------
    reader : can.TRCReader
        Which reads them; it knows the version and the columns once it has read a frame.
    """

    reader: TRCReader | None = None

    def layout(self) -> Layout | None:
        """Return how frames look, once the reader has read the header."""
        if self.reader is None or not self.frames:
            return None
        begun_s = getattr(self.reader, "_start_time", None)  # its public time is rounded to µs
        columns = self.reader.columns
        names = tuple(sorted(columns, key=columns.__getitem__))
        return _peak_layout(self.reader.file_version, names, begun_s)

    def _sound(self) -> Iterator[str]:
        for line in self._others():
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


@lru_cache(maxsize=8)
def _peak_layout(
    version: TRCFileVersion, columns: tuple[str, ...], begun_s: float | None
) -> Layout | None:
    """Return the layout of a version; `columns` are those that the header of version 2 names."""
    roles = _PEAK_1.get(version)
    is_1_0 = roles == _PEAK_1[TRCFileVersion.V1_0]
    if roles is None:
        roles = tuple(_PEAK_COLUMNS.get(name, -1) for name in columns)
        is_usual = len(set(roles)) == len(roles) and roles[-1:] == (DATA,) and -1 not in roles
        if not is_usual or not set(roles) >= _PEAK_NEEDS:
            return None
    if begun_s is None:
        return None
    return Layout(
        frame_lines.TRC, np.array(roles, dtype=np.int64), _PER_S, 0.0 if is_1_0 else begun_s
    )


class CsvLines(TextLines):
    """The lines of a CSV table; every restart repeats the header."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._header: str | None = None
        super().__init__(stream)

    def layout(self) -> Layout | None:
        """Return how frames look, below the header."""
        return None if self._header is None else Layout(frame_lines.CSV, _NONE)

    def _sound(self) -> Iterator[str]:
        others = self._others()
        if self._header is None:
            self._header = next(others, "")
        yield self._header
        for line in others:
            if line.strip():
                self.frames += 1
                yield line
