"""Exports a log as tables, one per message, in Parquet or CSV, using bounded memory."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from rrins.compiled.record import Floats, Integers, Words
from rrins.dbc.codec import load
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.logs.diagnosis import Diagnosis, is_diagnostic
from rrins.host_tools.logs.frame_steps import NO_EPOCH, epochs_by_sync
from rrins.host_tools.logs.reader import Log, Piece
from rrins.host_tools.logs.signals import (
    SignalOfMessage,
    crc_of_frames_holds,
    has_its_length,
    message_names,
    name_of_identifier,
    signals_of,
)
from rrins.host_tools.recording.errors import RecordError

Format = Literal["parquet", "csv"]

_ROWS = 65_536  # per row group
_TIME = "time_s"
_EPOCH = "sync_epoch"
_CRC = "crc_holds"
_DIAGNOSIS = "diagnosis"
_COMMENTS = {
    _TIME: "time of the frame, as logged",
    _EPOCH: "epoch opened by the last SYNC before the frame, unwrapped beyond 24 bits",
    _CRC: "whether the end-to-end CRC of the frame is correct",
    _DIAGNOSIS: "what the ISO-TP message says that the frame completes",
}


@dataclass
class Exported:
    """Result of an export."""

    rows: dict[str, int]  #: rows of each table, by message name
    unknown: int = 0  #: frames that are not in the DBC
    wrong_length: int = 0  #: frames whose length does not match their message; they are skipped
    left: int = 0  #: tables in the folder, of either format, that an earlier export left


class EpochCounter:
    """Finds for each frame of a log the epoch opened by the last SYNC."""

    def __init__(self) -> None:
        self._epoch = NO_EPOCH

    def epochs(self, frames: FrameArray) -> Integers:
        """Return the epoch of each frame, `NO_EPOCH` before the first SYNC."""
        out = np.zeros(len(frames), dtype=np.int64)
        self._epoch = int(epochs_by_sync(Frame.contiguous(frames), self._epoch, out))
        return out


def _field(name: str, kind: pa.DataType, **facts: str) -> pa.Field:
    return pa.field(name, kind, metadata={key: value for key, value in facts.items() if value})


def _columns(message: str) -> Iterator[tuple[pa.Field, SignalOfMessage | None]]:
    """Yield the fields of a message's table, each with its source signal."""
    yield _field(_TIME, pa.float64(), unit="s", comment=_COMMENTS[_TIME]), None
    yield _field(_EPOCH, pa.int64(), comment=_COMMENTS[_EPOCH]), None
    for signal in signals_of(message):
        kind = pa.int64() if signal.is_whole else pa.float64()
        yield _field(signal.column, kind, unit=signal.unit, comment=signal.comment), signal
        if signal.choices:
            names = _field(f"{signal.name}_name", pa.string(), comment="name of the value")
            yield names, signal
    yield _field(_CRC, pa.bool_(), comment=_COMMENTS[_CRC]), None
    if is_diagnostic(message):
        yield _field(_DIAGNOSIS, pa.string(), comment=_COMMENTS[_DIAGNOSIS]), None


class _Table:
    """Writes the table of one message to a file."""

    def __init__(self, folder: Path, message: str, kind: Format, source: str) -> None:
        described = load().database.get_message_by_name(message)
        self._message = message
        self._columns = list(_columns(message))
        self._schema = pa.schema(
            [field for field, _ in self._columns],
            metadata={
                "message": message,
                "identifier": f"0x{described.frame_id:03X}",
                "comment": str(described.comment or ""),
                "log": source,
            },
        )
        self.path = folder / f"{message}.{kind}"
        self._part = folder / f".{message}.{kind}.{os.getpid()}"
        self._pieces: list[tuple[FrameArray, Floats, Integers]] = []
        self._texts: list[str | None] = []
        self._waiting = 0
        self.rows = 0
        writer = pa.parquet.ParquetWriter if kind == "parquet" else pa.csv.CSVWriter
        self._writer = writer(str(self._part), self._schema)

    def add(
        self, frames: FrameArray, time_s: Floats, epochs: Integers, texts: list[str | None]
    ) -> None:
        """Add frames of the message, with what they say in diagnosis; write once there are many."""
        self._pieces.append((frames, time_s, epochs))
        self._texts += texts
        self._waiting += len(frames)
        if self._waiting >= _ROWS:
            self._write()

    def _write(self) -> None:
        if not self._waiting:
            return
        frames = Frame.joined([piece[0] for piece in self._pieces])
        time_s = np.concatenate([piece[1] for piece in self._pieces])
        epochs = np.concatenate([piece[2] for piece in self._pieces])
        arrays = []
        for field, signal in self._columns:
            if field.name == _TIME:
                arrays.append(pa.array(time_s))
            elif field.name == _EPOCH:
                arrays.append(pa.array(epochs, mask=epochs == NO_EPOCH))
            elif field.name == _DIAGNOSIS:
                arrays.append(pa.array(self._texts, pa.string()))
            elif signal is None:
                arrays.append(pa.array(crc_of_frames_holds(frames, self._message)))
            elif field.type == pa.string():
                arrays.append(_names(signal, frames["data"]))
            else:
                values = signal.values(frames["data"])
                arrays.append(pa.array(values, mask=~signal.is_in(frames), from_pandas=True))
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self.rows += len(frames)
        self._pieces.clear()
        self._texts.clear()
        self._waiting = 0

    def finish(self) -> None:
        """Write the remaining rows and close the file."""
        self._write()
        self._writer.close()

    def keep(self) -> None:
        """Move the finished file to its final path."""
        self._part.replace(self.path)

    def drop(self) -> None:
        """Remove the unfinished file."""
        with contextlib.suppress(OSError):
            self._writer.close()
        self._part.unlink(missing_ok=True)


def _names(signal: SignalOfMessage, words: Words) -> pa.Array:
    """Return the names of a signal's values; null for unnamed values."""
    known = sorted(signal.choices)
    raw = signal.raw(words)
    at = np.minimum(np.searchsorted(known, raw), len(known) - 1)
    is_named = np.asarray(known)[at] == raw
    names = pa.array([signal.choices[value] for value in known])
    return pa.DictionaryArray.from_arrays(pa.array(at, mask=~is_named), names).cast(pa.string())


def export(
    log: Log,
    folder: Path,
    kind: Format = "parquet",
    on_progress: Callable[[int], None] = lambda position: None,
) -> Exported:
    """Write the tables of a log to a folder; they appear only once all are complete.

    Raises
    ------
    RecordError
        If the log cannot be read or a table cannot be written.
    """
    tables: dict[str, _Table] = {}
    exported = Exported({})
    epochs, diagnosis = EpochCounter(), Diagnosis()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for piece in log.pieces():
            told = diagnosis.texts(piece.frames)
            _add_piece(
                piece, epochs.epochs(piece.frames), told, tables, exported, folder, kind, log
            )
            on_progress(log.position)
        for table in tables.values():
            table.finish()
        for name, table in tables.items():
            table.keep()
            exported.rows[name] = table.rows
        exported.left = _tables_left(folder, {table.path for table in tables.values()})
    except OSError as error:
        raise RecordError(f"{folder}: cannot be written: {error.strerror}") from error
    finally:
        for table in tables.values():
            table.drop()
    return exported


def _tables_left(folder: Path, written: set[Path]) -> int:
    """Return how many message tables a folder holds apart from those just written."""
    named = {folder / f"{name}.{kind}" for name in message_names() for kind in get_args(Format)}
    return sum(path.is_file() for path in named - written)


def _add_piece(
    piece: Piece,
    epochs: Integers,
    told: Mapping[int, str],
    tables: dict[str, _Table],
    exported: Exported,
    folder: Path,
    kind: Format,
    log: Log,
) -> None:
    """Distribute the frames of a piece to the tables of their messages."""
    identifiers = piece.frames["can_id"]
    order = np.argsort(identifiers, kind="stable")
    found, begins = np.unique(identifiers[order], return_index=True)
    for identifier, places in zip(found.tolist(), np.split(order, begins[1:]), strict=True):
        name = name_of_identifier(identifier)
        if name is None:
            exported.unknown += len(places)
            continue
        is_whole = has_its_length(piece.frames[places], name)
        exported.wrong_length += int(np.count_nonzero(~is_whole))
        places = places[is_whole]
        if not len(places):
            continue
        if name not in tables:
            tables[name] = _Table(folder, name, kind, log.path.name)
        texts = [told.get(k) for k in places.tolist()] if is_diagnostic(name) else []
        tables[name].add(piece.frames[places], piece.time_s[places], epochs[places], texts)
