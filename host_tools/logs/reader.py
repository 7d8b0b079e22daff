"""Reads a log of any format as arrays of frames, in pieces, however long and however damaged."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Iterator
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
from host_tools.logs.text_lines import TextLines
from host_tools.logs.unpacking import Unpacked

_PIECE = 65_536
_LINE = 42  # bytes of a candump log's line
_MOST_CHANNELS = 256
_FIRST_CHANNEL = {".asc": 1, ".blf": 1}
_PAYLOAD = 8  # bytes of a whole classic frame
_BLF_HEADER = 144  # the size that an unfinished BLF file says it has


@dataclass(frozen=True)
class Piece:
    """Frames as they stand in a log, and their times as the log has them."""

    frames: FrameArray
    time_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True)
class _Block:
    """Frames, their times, the numbers of their channels, and what gives the name of a number."""

    frames: FrameArray
    time_s: NDArray[np.float64]
    channels: NDArray[np.uint8]
    name_of: Callable[[int], str]


class Log:
    """A recording, to be read once from its beginning to its end.

    Parameters
    ----------
    path : Path
        With a note beside it (`host_tools.logs.note`) the parts of the recording that follow are
        read as well.
    channel : str, optional
        The only channel whose frames are read, as the log names it; all by default.

    Attributes
    ----------
    note : Note or None
    size : int
        Bytes of all its parts.
    position : int
        Bytes read so far, for a progress bar.
    frames : int
        Classic frames read so far.
    channels : dict
        How many frames each channel has, by the name that it has in the log; none where the
        format tells no channels.
    passed_over : int
        CAN FD frames, which are none of the contract's.

    Raises
    ------
    RecordError
        When there is no such file, or it has the ending of no log.
    """

    def __init__(self, path: Path, channel: str | None = None) -> None:
        check_readable(path)
        self.path = path
        self.note: Note | None = read_note(path)
        self._parts = self._existing_parts()
        self.size = sum(part.stat().st_size for part, _ in self._parts)
        self.position = 0
        self.frames = 0
        self.channels: dict[str, int] = {}
        self.passed_over = 0
        self._channel = channel
        self._read = 0  # frames of all channels
        self._damages: dict[Path, list[str]] = {}

    @property
    def damage(self) -> str | None:
        """What could not be read; None while all is well."""
        told = [f"{path}: {'; '.join(damages)}" for path, damages in self._damages.items()]
        return "; ".join(told) or None

    @property
    def is_mixed(self) -> bool:
        """Whether the frames read so far are of several channels."""
        return self._channel is None and len(self.channels) > 1

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
                    for block in self._blocks_of(path, raw, size):
                        if not raw.closed:  # a reader closes it at the end
                            self.position = done + raw.tell()
                        piece = self._taken(block, shift_s)
                        if len(piece):
                            yield piece
            except RecordError as error:
                if not self._read:
                    raise
                self._note_damage(path, str(error).removeprefix(f"{path}: "))
                break
            except Exception as error:  # noqa: BLE001 - other people's readers on any bytes
                self._note_damage(path, f"cannot be read on after {self._read} frames", error)
                break
            done += path.stat().st_size
            self.position = done
        if not self._read:
            raise RecordError(self.damage or f"{self.path}: holds no frames")
        if not self.frames:
            known = ", ".join(self.channels) or "it tells no channels"
            raise RecordError(f"{self.path}: has no frames of channel {self._channel} ({known})")

    def _taken(self, block: _Block, shift_s: float) -> Piece:
        """Count the frames of the channels; return those that are wanted."""
        wanted = np.ones(len(block.frames), dtype=np.bool_)
        for number in np.flatnonzero(np.bincount(block.channels)).tolist():
            name = block.name_of(number)
            mine = block.channels == number
            if name:
                self.channels[name] = self.channels.get(name, 0) + int(np.count_nonzero(mine))
            if self._channel not in (None, name):
                wanted &= ~mine
        self._read += len(wanted)
        frames, time_s = block.frames, block.time_s
        if not wanted.all():
            frames, time_s = frames[wanted], time_s[wanted]
        self.frames += len(frames)
        return Piece(frames, time_s + shift_s if shift_s else time_s)

    def _note_damage(self, path: Path, what: str, error: Exception | None = None) -> None:
        why = "" if error is None else f" ({' '.join(str(error).split()) or type(error).__name__})"
        self._damages.setdefault(path, []).append(f"{what}{why}")

    def _blocks_of(self, path: Path, raw: IO[bytes], size: int) -> Iterator[_Block]:
        ending, is_packed = ending_of(path)
        unpacked = Unpacked(raw) if is_packed else None
        stream: Any = raw if unpacked is None else io.BufferedReader(unpacked)
        try:
            if ending == ".log":
                yield from self._candump(path, _Sips(stream, size * _LINE))
            elif ending == ".mf4":
                yield from self._mf4(path, raw, size)
            else:
                yield from self._by_message(path, stream, unpacked, size)
        except Exception:  # what a reader says of content that ends too early
            if unpacked is None or unpacked.failure is None:
                raise
        if unpacked is not None and unpacked.failure is not None:
            self._note_damage(path, f"is cut off after {self._read} frames, {unpacked.failure}")

    def _candump(self, path: Path, stream: Any) -> Iterator[_Block]:
        candump = Candump(stream)
        try:
            for block in candump:
                yield _Block(*block, candump.channel)
        finally:
            self.passed_over += candump.fd_frames
            self._note_bad_lines(path, candump.bad_lines)

    def _note_bad_lines(self, path: Path, count: int) -> None:
        if count:
            lines = "1 line is no frame" if count == 1 else f"{count} lines are no frames"
            self._note_damage(path, f"{lines} and left out")

    def _mf4(self, path: Path, raw: IO[bytes], size: int) -> Iterator[_Block]:
        has_read = False
        for frames, time_s, channels, passed_over in read_data_frames(path, _PIECE):
            has_read = True
            self.passed_over += passed_over
            yield _Block(frames, time_s, channels, str)
        if not has_read:
            yield from self._by_message(path, raw, None, size)

    def _by_message(
        self, path: Path, stream: Any, unpacked: Unpacked | None, size: int
    ) -> Iterator[_Block]:
        """Yield what python-can reads; what it has read before an error comes first."""
        reader, lines = open_reader(path, stream)
        gathered = _Gathered(_FIRST_CHANNEL.get(ending_of(path)[0], 0))
        damaged = 0
        messages = _Messages(reader, lines)
        for message in messages:
            if message.is_fd or message.dlc == len(message.data) > _PAYLOAD:
                self.passed_over += 1
            elif min(message.dlc, _PAYLOAD) != len(message.data) and not message.is_remote_frame:
                damaged += 1
            else:
                gathered.take(message)
            if len(gathered.words) == size:
                yield gathered.block()
        yield gathered.block()
        if damaged:
            self._note_damage(
                path, f"{damaged} frames have not as many bytes as they say and are left out"
            )
        self._note_bad_lines(path, messages.bad_lines)
        if messages.failure is not None:
            raise messages.failure
        if lines is not None:
            self.passed_over += lines.fd_frames
            if lines.is_open:
                self._note_damage(path, f"was not closed; it ends after {self._read} frames")
        if isinstance(reader, can.BLFReader):
            there = path.stat().st_size if unpacked is None else unpacked.size
            self._check_end_of_blf(path, reader, there)

    def _check_end_of_blf(self, path: Path, reader: can.BLFReader, there: int) -> None:
        if reader.file_size > there:
            self._note_damage(path, f"is cut off after {self._read} frames")
        elif reader.file_size == _BLF_HEADER and reader.object_count == 0:
            self._note_damage(path, f"was not closed; it ends after {self._read} frames")


class _Sips:
    """A stream that gives no more than so many bytes at once."""

    def __init__(self, stream: Any, most: int) -> None:
        self._stream = stream
        self._most = most

    def read(self, size: int) -> bytes:
        """Read on."""
        return bytes(self._stream.read(min(size, self._most)))


class _Messages:
    """What python-can's reader reads, also behind a line of a text that it cannot read.

    Attributes
    ----------
    failure : Exception or None
        Why it could not be read on.
    """

    def __init__(self, reader: Any, lines: TextLines | None) -> None:
        self._reader = reader
        self._lines = lines
        self._complaints = _Complaints()
        self._count = 0
        self.failure: Exception | None = None

    @property
    def bad_lines(self) -> int:
        """Lines that should have been messages."""
        if self._lines is None:
            return self._complaints.count
        return self._lines.bad_lines + self._lines.frames - self._count

    def __iter__(self) -> Iterator[can.Message]:
        messages = iter(self._reader)
        first: Exception | None = None
        failed_at = 0
        while True:
            try:
                with self._complaints:
                    message = next(messages, None)
            except Exception as error:  # noqa: BLE001 - other people's readers on any bytes
                first = first or error
                if self._lines is None or self._lines.frames == failed_at:  # no line's fault
                    self.failure = error
                    return
                failed_at = self._lines.frames
                self._lines.begin_again()
                messages = iter(self._reader)
                continue
            if message is None:
                break
            self._count += 1
            yield message
        if not self._count:
            self.failure = first


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
    """Messages on their way into arrays.

    Parameters
    ----------
    first_channel : int
        What the format calls the channel that python-can calls 0.
    """

    def __init__(self, first_channel: int) -> None:
        self._first_channel = first_channel
        self._names: list[str] = []
        self._clear()

    def _clear(self) -> None:
        self._identifiers: list[int] = []
        self._lengths: list[int] = []
        self._times_s: list[float] = []
        self._channels: list[int] = []
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
        self._lengths.append(min(length, _PAYLOAD))
        self._times_s.append(message.timestamp)
        self._channels.append(self._number_of(message.channel))
        self.words.append(int.from_bytes(message.data, "little"))

    def _number_of(self, channel: Any) -> int:
        if channel is None:
            name = ""
        else:
            name = str(channel + self._first_channel if isinstance(channel, int) else channel)
        if name not in self._names:
            self._names.append(name)
        return min(self._names.index(name), _MOST_CHANNELS - 1)

    def block(self) -> _Block:
        """Return what was taken, and begin anew."""
        frames = frame_array(len(self.words))
        frames["can_id"] = self._identifiers
        frames["length"] = self._lengths
        frames["data"] = self.words
        block = _Block(
            frames,
            np.array(self._times_s, dtype=np.float64),
            np.array(self._channels, dtype=np.uint8),
            self._names.__getitem__,
        )
        self._clear()
        return block
