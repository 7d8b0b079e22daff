"""Writes recorded signals: Parquet, CSV, MF4 or MCAP, as the ending of the file says."""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rrins.host_tools import files
from rrins.host_tools.errors import XcpError
from rrins.host_tools.xcp.recording import Recording

_NS_PER_S = 1_000_000_000


def write(recording: Recording, path: Path) -> None:
    """Write a file, whole or not at all.

    Raises
    ------
    RehearsalError
        If it cannot be written.
    """
    writer = writer_of(path)
    with files.replacing(path) as place:
        writer(recording, place)


def writer_of(path: Path) -> Callable[[Recording, Path], None]:
    """Return the writer of a file: so early that nothing has been recorded in vain.

    Raises
    ------
    XcpError
        If there is none for its ending, or its folder cannot be written to.
    ModuleNotFoundError
        If a package is missing.
    """
    ending = path.suffix.lower()
    if ending not in _WRITERS:
        raise XcpError(f"{path}: ends in none of {', '.join(_WRITERS)}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise XcpError(f"{path}: cannot be written: {path.parent} is not a folder to write to")
    package, writer = _WRITERS[ending]
    importlib.import_module(package)
    return writer


def _write_parquet(recording: Recording, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    fields = [pa.field("time", pa.float64(), metadata={"unit": "s"})]
    for name, column in recording.values.items():
        notes = {"unit": recording.units[name], "description": recording.texts[name]}
        fields.append(pa.field(name, pa.from_numpy_dtype(column.dtype), metadata=notes))
    columns = [recording.time_s, *recording.values.values()]
    pa.parquet.write_table(pa.table(columns, schema=pa.schema(fields)), path)


def _write_csv(recording: Recording, path: Path) -> None:
    names = ["time", *recording.values]
    columns = [recording.time_s.tolist(), *(c.tolist() for c in recording.values.values())]
    with path.open("w", encoding="utf-8") as out:
        out.write(",".join(names) + "\n")
        for row in zip(*columns, strict=True):
            out.write(",".join(map(repr, row)) + "\n")


def _write_mf4(recording: Recording, path: Path) -> None:
    import asammdf

    signals = [
        asammdf.Signal(
            samples=column.astype(np.uint8) if column.dtype == bool else column,
            timestamps=recording.time_s,
            name=name,
            unit=recording.units[name],
            comment=recording.texts[name],
        )
        for name, column in recording.values.items()
    ]
    with asammdf.MDF(version="4.10") as out:
        out.append(signals, comment="XCP measurement")
        out.save(path.with_suffix(".mf4"), overwrite=True).replace(path)  # knows no other ending


def _write_mcap(recording: Recording, path: Path) -> None:
    from mcap.writer import Writer

    properties = {
        name: {"type": "number", "description": recording.texts[name]} for name in recording.values
    }
    schema = json.dumps({"type": "object", "title": "xcp", "properties": properties})
    columns = [column.tolist() for column in recording.values.values()]
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(library="rrins")
        kind = writer.register_schema("xcp", "jsonschema", schema.encode())
        channel = writer.register_channel("/xcp", "json", kind)
        for k, time_s in enumerate(recording.time_s.tolist()):
            row = {name: column[k] for name, column in zip(recording.values, columns, strict=True)}
            time_ns = round(time_s * _NS_PER_S)
            writer.add_message(channel, time_ns, json.dumps(row).encode(), time_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # of mcap


_WRITERS = {
    ".parquet": ("pyarrow", _write_parquet),
    ".csv": ("csv", _write_csv),
    ".mf4": ("asammdf", _write_mf4),
    ".mcap": ("mcap", _write_mcap),
}
"""By ending: the package that writes it, and how."""
