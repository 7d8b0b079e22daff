"""Log formats by file suffix, and the writer and reader of each.

python-can writes and reads all of them. Two of its writers are replaced here: the one for `.mf4`
(see `recording.mf4`), and the one for `.db`, which drops pending frames when stopped.
"""

from __future__ import annotations

import gzip
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any, BinaryIO, Protocol, cast

import can
from can.io.logger import MESSAGE_WRITERS
from can.io.player import MESSAGE_READERS

from rrins.host_tools.recording.asc import AscLines
from rrins.host_tools.recording.blf import BlfReader, Run
from rrins.host_tools.recording.blf_writer import BlfWriter
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.mf4 import Mf4Writer, open_mf4_reader
from rrins.host_tools.recording.text_lines import CsvLines, TextLines, TrcLines

WRITTEN = (".asc", ".blf", ".csv", ".db", ".log", ".mf4", ".trc", ".txt")
"""Suffixes that can be recorded."""

READ = (".asc", ".blf", ".csv", ".db", ".log", ".mf4", ".trc")
"""Suffixes that can be read."""

_TEXT = (".asc", ".csv", ".log", ".trc", ".txt")  # also with .gz
_BATCH = 1000
_COMPRESSION = 4  # as small as the default, and three times faster
_TABLE = (
    "CREATE TABLE messages (ts REAL, arbitration_id INTEGER, extended INTEGER, "
    "remote INTEGER, error INTEGER, dlc INTEGER, data BLOB)"
)
_INSERT = "INSERT INTO messages VALUES (?, ?, ?, ?, ?, ?, ?)"


class Writer(Protocol):
    """Writes the frames of a log."""

    def on_message_received(self, message: can.Message, /) -> None:
        """Write a frame."""

    def file_size(self) -> int:
        """Return the size so far in bytes, before any final compression."""

    def stop(self) -> None:
        """Write pending frames and close the file."""


def ending_of(path: Path) -> tuple[str, bool]:
    """Return a log's suffix in lower case without `.gz`, and whether it had `.gz`."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes[-1:] == [".gz"]:
        return "".join(suffixes[-2:-1]), True
    return "".join(suffixes[-1:]), False


def check_path(path: Path) -> None:
    """Raise `RecordError` unless a recording can be written to `path`."""
    ending, is_packed = ending_of(path)
    if ending not in WRITTEN or (is_packed and ending not in _TEXT):
        known = " ".join(WRITTEN)
        raise RecordError(
            f"recording {path}: the suffix must be one of {known}, or {'.gz '.join(_TEXT)}.gz"
        )
    if not path.parent.is_dir():
        raise RecordError(f"recording {path}: no such folder: {path.parent}")


class _WithoutDirection:
    """A text file that drops the direction which python-can appends to a line.

    All frames of a bus are received ones; and Wireshark reads what ``candump -L`` writes, no more.
    """

    def __init__(self, file: IO[str]) -> None:
        self._file = file

    def write(self, line: str) -> int:
        """Write a line."""
        return self._file.write(line.removesuffix(" R\n").removesuffix(" T\n").rstrip("\n") + "\n")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


class _CandumpWriter(can.CanutilsLogWriter):
    """A writer of what ``candump -L`` writes."""

    def __init__(self, file: Path | IO[str]) -> None:
        super().__init__(cast(Any, file))
        self.file = cast(Any, _WithoutDirection(self.file))


_SqliteRow = tuple[float, int, bool, bool, bool, int, bytes]


class _SqliteWriter:
    """Writes a fresh table for `can.SqliteReader`."""

    def __init__(self, path: Path) -> None:
        if path.is_file():
            path.unlink()
        self._path = path
        self._connection: sqlite3.Connection | None = None
        self._rows: list[_SqliteRow] = []

    def on_message_received(self, message: can.Message) -> None:
        self._rows.append(
            (
                message.timestamp,
                message.arbitration_id,
                message.is_extended_id,
                message.is_remote_frame,
                message.is_error_frame,
                message.dlc,
                bytes(message.data),
            )
        )
        if len(self._rows) == _BATCH:
            self._flush()

    def _flush(self) -> None:
        try:
            if self._connection is None:
                self._connection = sqlite3.connect(self._path, check_same_thread=False)
                self._connection.execute(_TABLE)
            with self._connection:
                self._connection.executemany(_INSERT, self._rows)
        except sqlite3.Error as error:
            raise OSError(f"SQLite: {error}") from error
        self._rows.clear()

    def file_size(self) -> int:
        return self._path.stat().st_size if self._path.exists() else 0

    def stop(self) -> None:
        try:
            self._flush()
        finally:
            if self._connection is not None:
                self._connection.close()


def open_writer(path: Path) -> Writer:
    """Open a log for writing; replaces an existing file.

    Raises
    ------
    RecordError
        If it cannot be written.
    """
    check_path(path)
    ending, is_packed = ending_of(path)
    try:
        if ending == ".mf4":
            return Mf4Writer(path)
        if ending == ".db":
            return _SqliteWriter(path)
        if ending == ".blf":
            return BlfWriter(path, compression_level=_COMPRESSION)
        file = gzip.open(path, "wt", encoding="utf-8") if is_packed else path  # noqa: SIM115 - its writer's
        kind = _CandumpWriter if ending == ".log" else MESSAGE_WRITERS[ending]
        return cast(Callable[[Path | IO[str]], Writer], kind)(file)
    except RecordError as error:
        raise RecordError(f"recording {path}: {error}") from error
    except (ValueError, OSError, ImportError, NotImplementedError) as error:
        raise RecordError(f"recording {path}: {error}") from error


def check_readable(path: Path) -> None:
    """Raise `RecordError` unless `path` is a file whose suffix is that of a readable log."""
    ending, is_packed = ending_of(path)
    if not path.is_file():
        raise RecordError(f"{path}: no such file")
    if ending not in READ or (is_packed and ending in (".db", ".mf4")):
        raise RecordError(f"{path}: not a readable log; the suffix must be one of {' '.join(READ)}")


def name_without_ending(path: Path) -> str:
    """Return the name of a log without its format suffix and without `.gz`."""
    name = path.name
    for suffix in reversed(path.suffixes[-2:]):
        if suffix.lower() not in (*WRITTEN, ".gz"):
            break
        name = name[: -len(suffix)]
    return name


_LINES: dict[str, type[TextLines]] = {".asc": AscLines, ".csv": CsvLines, ".trc": TrcLines}


def open_reader(
    path: Path, stream: IO[bytes]
) -> tuple[Iterable[can.Message | Run], TextLines | None]:
    """Return a reader of a log, an iterator of messages, and its source of lines.

    `stream` is the uncompressed content. The lines are None if the reader reads `stream` directly.
    A reader of BLF yields many frames at once.
    """
    ending, _ = ending_of(path)
    reader: Callable[..., Iterable[can.Message]] = MESSAGE_READERS[ending]
    if ending == ".mf4":
        return open_mf4_reader(path), None
    if ending == ".db":
        return reader(path), None
    if ending == ".blf":
        return BlfReader(cast(BinaryIO, stream)), None
    if ending not in _TEXT:
        return reader(stream), None
    lines = _LINES[ending](stream)
    return reader(lines), lines
