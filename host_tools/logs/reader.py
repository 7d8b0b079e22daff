"""Reads a log of any format as arrays of frames, in pieces, however long and however damaged."""

from __future__ import annotations

import gzip
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import can
import numpy as np
from numpy.typing import NDArray

from dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, FrameArray, frame_array
from host_tools.logs.candump import Candump
from host_tools.logs.errors import RecordError
from host_tools.logs.formats import check_readable, ending_of, open_reader
from host_tools.logs.mf4 import read_data_frames
from host_tools.logs.note import Note, read_note

_PIECE = 65_536
_LINE = 42  # bytes of a candump log's line
_BLF_HEADER = 144  # the size that an unfinished BLF file says it has


@dataclass(frozen=True)
class Piece:
    """Frames as they stand in a log, and their times as the log has them."""

    frames: FrameArray
    time_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.frames)


class Log:
    """A recording, to be read once from its beginning to its end.

    Parameters
    ----------
    path : Path
        With a note beside it (`host_tools.logs.note`) the parts of the recording that follow are
        read as well.

    Attributes
    ----------
    note : Note or None
    size : int
        Bytes of all its parts.
    position : int
        Bytes read so far, for a progress bar.
    frames : int
        Classic frames read so far.
    passed_over : int
        CAN FD frames, which are none of the contract's.
    damage : str or None
        What could not be read; None while all is well.

    Raises
    ------
    RecordError
        When there is no such file, or it has the ending of no log.
    """

    def __init__(self, path: Path) -> None:
        check_readable(path)
        self.path = path
        self.note: Note | None = read_note(path)
        self._parts = self._existing_parts()
        self.size = sum(part.stat().st_size for part, _ in self._parts)
        self.position = 0
        self.frames = 0
        self.passed_over = 0
        self.damage: str | None = None

    def _existing_parts(self) -> list[tuple[Path, float]]:
        """Return the parts, and what to add to the times of each."""
        parts = () if self.note is None else self.note.parts
        if not parts or parts[0].file != self.path.name:
            return [(self.path, 0.0)]
        is_relative = ending_of(self.path)[0] == ".asc"  # counts from the first frame of each file
        first_s = parts[0].first_s or 0.0
        found: list[tuple[Path, float]] = []
        for part in parts:
            path = self.path.with_name(part.file)
            if not path.is_file():
                raise RecordError(f"{self.path}: its part {path} is missing")
            found.append((path, (part.first_s or 0.0) - first_s if is_relative else 0.0))
        return found

    def pieces(self, size: int = _PIECE) -> Iterator[Piece]:
        """Yield the frames in the order of the log.

        What cannot be read ends the reading, or is left out where that is possible; `damage` tells.

        Parameters
        ----------
        size : int
            About how many frames a piece has; of `.mf4`, where small ones are slow, more.

        Raises
        ------
        RecordError
            When nothing at all can be read.
        """
        done = 0
        for path, shift_s in self._parts:
            try:
                with path.open("rb") as raw:
                    for piece in self._pieces_of(path, raw, size):
                        if not raw.closed:  # a reader closes it at the end
                            self.position = done + raw.tell()
                        if not len(piece):
                            continue
                        self.frames += len(piece)
                        yield Piece(piece.frames, piece.time_s + shift_s) if shift_s else piece
            except RecordError as error:
                if not self.frames:
                    raise
                self.damage = str(error)
                break
            except Exception as error:  # noqa: BLE001 - other people's readers on any bytes
                self._note_damage(path, f"cannot be read on after {self.frames} frames", error)
                break
            done += path.stat().st_size
            self.position = done
        if not self.frames:
            raise RecordError(self.damage or f"{self.path}: holds no frames")

    def _note_damage(self, path: Path, what: str, error: Exception | None = None) -> None:
        why = "" if error is None else f" ({' '.join(str(error).split()) or type(error).__name__})"
        self.damage = f"{path}: {what}{why}"

    def _pieces_of(self, path: Path, raw: IO[bytes], size: int) -> Iterator[Piece]:
        ending, is_packed = ending_of(path)
        if ending == ".log":
            stream = gzip.GzipFile(fileobj=raw) if is_packed else raw
            yield from self._candump(path, _Sips(stream, size * _LINE))
            return
        if ending == ".mf4":
            read = 0
            for frames, time_s in read_data_frames(path, _PIECE):
                read += len(frames)
                yield Piece(frames, time_s)
            if read:
                return
        reader = open_reader(path, raw)
        yield from self._by_message(path, reader, size)
        if isinstance(reader, can.BLFReader):
            if reader.file_size > path.stat().st_size:
                self._note_damage(path, f"is cut off after {self.frames} frames")
            elif reader.file_size == _BLF_HEADER and reader.object_count == 0:
                self._note_damage(path, f"was not closed; it ends after {self.frames} frames")

    def _candump(self, path: Path, stream: Any) -> Iterator[Piece]:
        candump = Candump(stream)
        try:
            for frames, time_s in candump:
                yield Piece(frames, time_s)
        finally:
            self.passed_over += candump.fd_frames
            if candump.bad_lines:
                self._note_damage(path, f"{candump.bad_lines} lines are no frames and left out")

    def _by_message(self, path: Path, reader: Any, size: int) -> Iterator[Piece]:
        """Yield what python-can reads; what it has read before an error comes first."""
        gathered = _Gathered()
        shortened = 0
        failure: Exception | None = None
        messages = iter(reader)
        complaints = _Complaints()
        while failure is None:
            try:
                with complaints:
                    message = next(messages, None)
            except Exception as error:  # noqa: BLE001 - raised again below
                failure = error
                break
            if message is None:
                break
            if message.is_fd:
                self.passed_over += 1
                continue
            if message.dlc != len(message.data) and not message.is_remote_frame:
                shortened += 1
                continue
            gathered.take(message)
            if len(gathered.words) == size:
                yield gathered.piece()
        yield gathered.piece()
        if complaints.count:
            self._note_damage(path, f"{complaints.count} lines are no frames and left out")
        if shortened:
            self._note_damage(path, f"{shortened} frames are cut off and left out")
        if failure is not None:
            raise failure


class _Sips:
    """A stream that gives no more than so many bytes at once."""

    def __init__(self, stream: Any, most: int) -> None:
        self._stream = stream
        self._most = most

    def read(self, size: int) -> bytes:
        """Read on."""
        return bytes(self._stream.read(min(size, self._most)))


class _Complaints(logging.Handler):
    """Counts what python-can's readers say of lines that they leave out."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.count = 0
        self._logger = logging.getLogger("can")

    def emit(self, record: logging.LogRecord) -> None:
        """Count."""
        self.count += 1

    def __enter__(self) -> None:
        self._logger.propagate = False
        self._logger.addHandler(self)

    def __exit__(self, *_: object) -> None:
        self._logger.removeHandler(self)
        self._logger.propagate = True


class _Gathered:
    """Messages on their way into arrays."""

    def __init__(self) -> None:
        self._clear()

    def _clear(self) -> None:
        self._identifiers: list[int] = []
        self._lengths: list[int] = []
        self._times_s: list[float] = []
        self.words: list[int] = []

    def take(self, message: can.Message) -> None:
        """Take a classic message."""
        identifier = message.arbitration_id
        length = len(message.data)
        if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
            identifier |= EFF_FLAG if message.is_extended_id else 0
            if message.is_remote_frame:
                identifier |= RTR_FLAG
                length = message.dlc
            if message.is_error_frame:
                identifier |= ERR_FLAG
        self._identifiers.append(identifier)
        self._lengths.append(length if length <= 8 else 8)
        self._times_s.append(message.timestamp)
        self.words.append(int.from_bytes(message.data[:8], "little"))

    def piece(self) -> Piece:
        """Return what was taken, and begin anew."""
        frames = frame_array(len(self.words))
        frames["can_id"] = self._identifiers
        frames["length"] = self._lengths
        frames["data"] = self.words
        piece = Piece(frames, np.array(self._times_s, dtype=np.float64))
        self._clear()
        return piece
