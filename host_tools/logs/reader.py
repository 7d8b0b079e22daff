"""Reads a log of any format as arrays of frames, in pieces, however long and however damaged."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING

import can
import numpy as np

from rrins.compiled.record import Bytes, Floats
from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.host_tools.bus.message import identifier_of
from rrins.host_tools.logs.candump import Candump
from rrins.host_tools.logs.unpacking import Unpacked
from rrins.host_tools.recording.blf import Run
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import check_readable, ending_of, open_reader
from rrins.host_tools.recording.note import Note, read_note
from rrins.host_tools.recording.text_lines import TextLines

if TYPE_CHECKING:
    from can.typechecking import Channel

_PIECE = 65_536
_AT_ONCE = 64  # messages
_LINE = 42  # bytes of a candump line
_MOST_CHANNELS = 256
_MOST_NAMED = 10  # channels in a message
_FIRST_CHANNEL = {".asc": 1, ".blf": 1}
_PAYLOAD = 8  # bytes of a full classic frame
_BLF_HEADER = 144  # the size stated by an unfinished BLF file


@dataclass(frozen=True)
class Piece:
    """Frames in log order, with their times as logged."""

    frames: FrameArray
    time_s: Floats

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True)
class _Block:
    """Frames, their times, their channel numbers, and the function that names a channel."""

    frames: FrameArray
    time_s: Floats
    channels: Bytes
    name_of: Callable[[int], str]


class Log:
    """A recording, read once from beginning to end.

    Parameters
    ----------
    path : Path
        If a note (`recording.note`) accompanies it, the subsequent parts of the recording are
        read as well.
    channel : str, optional
        The only channel to read, by its name in the log; all by default.

    Attributes
    ----------
    note : Note or None
    size : int
        Total bytes of all parts.
    position : int
        Bytes read so far, for a progress bar.
    frames : int
        Classic frames read so far.
    channels : dict
        Frames per channel, by channel name; empty if the format has no channels.
    passed_over : int
        CAN FD frames, which are skipped because the DBC has none.

    Raises
    ------
    RecordError
        If the file does not exist, or its suffix is not that of a log.
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
        self._read = 0  # frames on all channels
        self._damages: dict[Path, list[str]] = {}

    @property
    def damage(self) -> str | None:
        """The parts that could not be read; None if there are none."""
        damaged = [f"{path}: {'; '.join(damages)}" for path, damages in self._damages.items()]
        return "; ".join(damaged) or None

    @property
    def is_mixed(self) -> bool:
        """Whether the frames read so far come from several channels."""
        return self._channel is None and len(self.channels) > 1

    def _existing_parts(self) -> list[tuple[Path, float]]:
        """Return the parts, and the time offset of each."""
        parts = () if self.note is None else self.note.parts
        if not parts or parts[0].file != self.path.name:
            return [(self.path, 0.0)]
        is_relative = ending_of(self.path)[0] == ".asc"  # counts from each file's first frame
        first_s = parts[0].first_s or 0.0
        found: list[tuple[Path, float]] = []
        for part in parts:
            path = self.path.with_name(part.file)
            if not path.is_file():
                raise RecordError(f"{self.path}: its part {path} is missing")
            found.append((path, (part.first_s or 0.0) - first_s if is_relative else 0.0))
        return found

    def pieces(self, size: int = _PIECE) -> Iterator[Piece]:
        """Yield the frames in log order.

        Unreadable content is skipped if possible, otherwise it ends the reading; see `damage`.

        Parameters
        ----------
        size : int
            Approximate frames per piece.

        Raises
        ------
        RecordError
            If nothing can be read at all.
        """
        done = 0
        for path, shift_s in self._parts:
            try:
                with path.open("rb") as raw:
                    for block in self._blocks_of(path, raw, size):
                        if not raw.closed:  # readers close it at the end
                            self.position = done + raw.tell()
                        piece = self._piece_of(block, shift_s)
                        if len(piece):
                            yield piece
            except RecordError as error:
                if not self._read:
                    raise
                self._add_damage(path, str(error).removeprefix(f"{path}: "))
                break
            except Exception as error:  # noqa: BLE001 - third-party readers on arbitrary bytes
                self._add_damage(path, f"cannot be read on after {self._read} frames", error)
                break
            done += path.stat().st_size
            self.position = done
        if not self._read:
            raise RecordError(self.damage or f"{self.path}: holds no frames")
        if not self.frames:
            known = ", ".join([*self.channels][:_MOST_NAMED]) or "the format has no channels"
            raise RecordError(f"{self.path}: has no frames on channel {self._channel} ({known})")

    def _piece_of(self, block: _Block, shift_s: float) -> Piece:
        """Count the frames per channel; return those of the selected channel."""
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

    def _add_damage(self, path: Path, what: str, error: Exception | None = None) -> None:
        why = "" if error is None else f" ({' '.join(str(error).split()) or type(error).__name__})"
        self._damages.setdefault(path, []).append(f"{what}{why}")

    def _blocks_of(self, path: Path, raw: IO[bytes], size: int) -> Iterator[_Block]:
        ending, is_packed = ending_of(path)
        unpacked = Unpacked(raw) if is_packed else None
        stream: IO[bytes] = raw if unpacked is None else io.BufferedReader(unpacked)
        try:
            if ending == ".log":
                yield from self._candump(path, Candump(stream, size * _LINE))
            else:
                yield from self._by_message(path, stream, unpacked, size)
        except Exception:  # how readers report truncated content
            if unpacked is None or unpacked.failure is None:
                raise
        if unpacked is not None and unpacked.failure is not None:
            self._add_damage(path, f"is cut off after {self._read} frames, {unpacked.failure}")

    def _candump(self, path: Path, candump: Candump) -> Iterator[_Block]:
        try:
            for block in candump:
                yield _Block(*block, candump.channel)
        finally:
            self.passed_over += candump.fd_frames
            self._add_bad_lines(path, candump.bad_lines)

    def _add_bad_lines(self, path: Path, count: int) -> None:
        if count:
            lines = "1 line is not a frame" if count == 1 else f"{count} lines are not frames"
            self._add_damage(path, f"{lines}; skipped")

    def _by_message(
        self, path: Path, stream: IO[bytes], unpacked: Unpacked | None, size: int
    ) -> Iterator[_Block]:
        """Yield what python-can reads; frames read before an error come first."""
        reader, lines = open_reader(path, stream)
        collector = _FrameCollector(_FIRST_CHANNEL.get(ending_of(path)[0], 0))
        damaged = 0
        messages = _Messages(reader, lines)
        for message in messages:
            if isinstance(message, Run):
                collector.add_run(message)
            elif message.is_fd or message.dlc == len(message.data) > _PAYLOAD:
                self.passed_over += 1
            elif min(message.dlc, _PAYLOAD) != len(message.data) and not message.is_remote_frame:
                damaged += 1
            else:
                collector.add(message)
            if len(collector) >= size:
                yield collector.block()
        yield collector.block()
        if damaged:
            self._add_damage(
                path, f"{damaged} frames are shorter than their stated length; skipped"
            )
        self._add_bad_lines(path, messages.bad_lines)
        if messages.failure is not None:
            raise messages.failure
        if lines is not None:
            self.passed_over += lines.fd_frames
            if lines.is_open:
                self._add_damage(path, f"was not closed; it ends after {self._read} frames")
        if isinstance(reader, can.BLFReader):
            there = path.stat().st_size if unpacked is None else unpacked.size
            self._check_end_of_blf(path, reader, there)

    def _check_end_of_blf(self, path: Path, reader: can.BLFReader, there: int) -> None:
        if reader.file_size > there:
            self._add_damage(path, f"is cut off after {self._read} frames")
        elif reader.file_size == _BLF_HEADER and reader.object_count == 0:
            self._add_damage(path, f"was not closed; it ends after {self._read} frames")


class _Messages:
    """Messages from python-can's reader, resumed after unreadable lines of text logs.

    Attributes
    ----------
    failure : Exception or None
        Why reading stopped early.
    """

    def __init__(self, reader: Iterable[can.Message | Run], lines: TextLines | None) -> None:
        self._reader = reader
        self._lines = lines
        self._warnings = _WarningCounter()
        self._count = 0
        self.failure: Exception | None = None

    @property
    def bad_lines(self) -> int:
        """Lines that look like messages but could not be read."""
        if self._lines is None:
            return self._warnings.count
        return self._lines.bad_lines + self._lines.frames - self._count

    def __iter__(self) -> Iterator[can.Message | Run]:
        messages = iter(self._reader)
        first: Exception | None = None
        failed_at = 0
        while True:
            some, error = self._next_of(messages)
            self._count += len(some)
            yield from some
            if error is None and len(some) < _AT_ONCE:
                break
            if error is not None:
                first = first or error
                if self._lines is None or self._lines.frames == failed_at:  # not due to a line
                    self.failure = error
                    return
                failed_at = self._lines.frames
                self._lines.begin_again()
                messages = iter(self._reader)
        if not self._count:
            self.failure = first

    def _next_of(
        self, messages: Iterator[can.Message | Run]
    ) -> tuple[list[can.Message | Run], Exception | None]:
        """Return the next messages, and why there are no more."""
        some: list[can.Message | Run] = []
        try:
            with self._warnings:
                for message in islice(messages, _AT_ONCE):
                    some.append(message)  # noqa: PERF402 - keeps those before an error
        except Exception as error:  # noqa: BLE001 - third-party readers on arbitrary bytes
            return some, error
        return some, None


class _WarningCounter(logging.Handler):
    """Counts the lines that python-can's readers report as skipped."""

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


class _FrameCollector:
    """Collects messages into arrays.

    Parameters
    ----------
    first_channel : int
        The format's number for the channel that python-can numbers 0.
    """

    def __init__(self, first_channel: int) -> None:
        self._first_channel = first_channel
        self._numbers: dict[str, int] = {}
        self._done: list[tuple[FrameArray, Floats, Bytes]] = []
        self._done_frames = 0
        self._rows: list[tuple[int, int, int, float, int]] = []

    def __len__(self) -> int:
        return self._done_frames + len(self._rows)

    def add(self, message: can.Message) -> None:
        """Add a classic message."""
        length = message.dlc if message.is_remote_frame else len(message.data)
        word = int.from_bytes(message.data, "little")
        channel = self._number_of(message.channel)
        self._rows.append(
            (identifier_of(message), min(length, _PAYLOAD), word, message.timestamp, channel)
        )

    def _number_of(self, channel: Channel | None) -> int:
        if channel is None:
            name = ""
        else:
            name = str(channel + self._first_channel if isinstance(channel, int) else channel)
        return self._number_of_name(name)

    def _number_of_name(self, name: str) -> int:
        """Return a channel's number; all channels beyond the most have the last one."""
        if name not in self._numbers and len(self._numbers) == _MOST_CHANNELS - 1:
            return _MOST_CHANNELS - 1
        return self._numbers.setdefault(name, len(self._numbers))

    def _name_of(self, number: int) -> str:
        names = [*self._numbers, *[""] * (number + 1 - len(self._numbers))]
        return names[number]

    def add_run(self, run: Run) -> None:
        """Add frames that are arrays already."""
        self._finish_messages()
        numbers = np.zeros(int(run.channels.max()) + 1, dtype=np.uint8)
        for channel in np.flatnonzero(np.bincount(run.channels)).tolist():
            numbers[channel] = self._number_of_name(str(channel))
        self._add(run.frames, run.time_s, numbers[run.channels])

    def _finish_messages(self) -> None:
        """Turn the messages so far into arrays."""
        if not self._rows:
            return
        frames = frame_array(len(self._rows))
        frames["can_id"], frames["length"], frames["data"], times_s, channels = zip(
            *self._rows, strict=True
        )
        self._rows.clear()
        self._add(frames, np.array(times_s), np.array(channels, dtype=np.uint8))

    def _add(self, frames: FrameArray, time_s: Floats, channels: Bytes) -> None:
        self._done.append((frames, time_s, channels))
        self._done_frames += len(frames)

    def block(self) -> _Block:
        """Return the collected frames and start over."""
        self._finish_messages()
        done = self._done or [(frame_array(0), np.zeros(0), np.zeros(0, dtype=np.uint8))]
        self._done, self._done_frames = [], 0
        frames, times_s, channels = zip(*done, strict=True)
        return _Block(
            Frame.joined(frames), np.concatenate(times_s), np.concatenate(channels), self._name_of
        )
