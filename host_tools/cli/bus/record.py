"""`rrins record`: record a bus to a log file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Literal

import click

from rrins.host_tools.cli.options import (
    FILE,
    POSITIVE,
    Bus,
    bus_option,
    json_option,
    option,
    timestamps_option,
)
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.interruption import as_event

_POLL_S = 0.1


@click.command()
@click.argument("path", metavar="FILE", type=FILE)
@bus_option
@option(
    "--rotate-size rotate_mb",
    "Start a new file at the next SYNC once a file exceeds this size in megabytes.",
    POSITIVE,
    metavar="MB",
)
@option(
    "--for for_s",
    "Stop after this many seconds of bus time.  [default: until Ctrl-C or the bus ends]",
    POSITIVE,
    metavar="S",
)
@option(
    "--lossless/--observer",
    "Whether the embedded bus waits for the recorder.  [default: wait, except in real time]",
)
@timestamps_option
@json_option
def record(
    path: Path,
    bus: Bus,
    rotate_mb: float | None,
    for_s: float | None,
    lossless: bool | None,
    timestamps: Literal["bus", "unix"],
    as_json: bool,
) -> None:
    """Record a bus to FILE.

    The file extension sets the format: .log (candump), .asc, .blf, .mf4, .csv, .trc, .db or .txt;
    text formats can be compressed with .gz. A recording that FILE already has is moved into
    the folder `previous` beside it.
    """
    from rrins.host_tools.recording.errors import RecordError
    from rrins.host_tools.recording.formats import check_path
    from rrins.host_tools.recording.recorder import Recorder, waits_for_recorder

    address = bus.address()
    rotate_bytes = None if rotate_mb is None else round(rotate_mb * 1e6)
    with as_event() as stop:
        if lossless is None:
            check_path(path)
            lossless = waits_for_recorder(address)
        recorder = Recorder(
            path, address, lossless, None, rotate_bytes, for_s, timestamps=timestamps
        )
        try:
            if recorder.kept_words is not None:
                print_note(recorder.kept_words)
            print_note(f"recording {address} to {path}; Ctrl-C stops")
            begun = time.monotonic()
            while not (recorder.has_ended.is_set() or stop.wait(_POLL_S)):
                passed_s = 0.0 if address.is_embedded else time.monotonic() - begun
                if for_s is not None and passed_s > for_s:  # on a bus without frames
                    break
        finally:
            recorder.close()
    if recorder.failure is not None:
        raise RecordError(f"recording {path}: {recorder.failure}")
    parts = [part.file for part in recorder.note.parts]
    summary = {
        "file": str(path),
        "parts": parts,
        "frames": recorder.frames,
        "duration_s": round(recorder.duration_s, 6),
        "time": recorder.note.time,
    }
    files = f" in {len(parts)} files" if len(parts) > 1 else ""
    text = (
        f"{path}: {recorder.frames} frames{files}, {recorder.duration_s:.3f} s of "
        f"{recorder.note.time or 'no'} time"
    )
    print_results(as_json, summary, [text])
