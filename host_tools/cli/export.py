"""`rrins export`: export a log as tables."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Literal

import click

from rrins.host_tools.cli.log_files import (
    log_argument,
    log_channel_option,
    print_reading,
    reading_progress,
)
from rrins.host_tools.cli.options import json_option
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.interruption import heed_sigterm


@click.command()
@log_argument
@click.argument("folder", metavar="OUT_DIR", type=click.Path(file_okay=False, path_type=Path))
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="Table format.",
)
@log_channel_option
@json_option
def export(
    log: Path,
    folder: Path,
    file_format: Literal["parquet", "csv"],
    log_channel: str | None,
    as_json: bool,
) -> None:
    """Write the log FILE to OUT_DIR as tables, one per message."""
    from rrins.host_tools.logs import tables
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.logs.signals import message_names

    heed_sigterm()
    source = Log(log, log_channel)
    begun = time.monotonic()
    with reading_progress("exporting", source.size, as_json) as on_progress:
        exported = tables.export(source, folder, file_format, on_progress)
    wall_s = time.monotonic() - begun
    print_reading(source)
    if exported.left:
        left, remain = "1 table", "remains"
        if exported.left != 1:
            left, remain = f"{exported.left} tables", "remain"
        print_note(f"{folder}: {left} of another export {remain} there")
    if exported.wrong_length:
        print_note(f"{log}: {exported.wrong_length} frames of the wrong length were skipped")
    if exported.unknown:
        print_note(f"{log}: {exported.unknown} frames are not in the DBC and were skipped")
    rows = {name: exported.rows[name] for name in message_names() if name in exported.rows}
    if as_json:
        summary = {
            "folder": str(folder),
            "format": file_format,
            "frames": source.frames,
            "rows": rows,
            "unknown": exported.unknown,
            "wrong_length": exported.wrong_length,
            "wall_s": round(wall_s, 3),
        }
        click.echo(json.dumps(summary))
        return
    for name, count in rows.items():
        click.echo(f"{count:>10}  {folder / f'{name}.{file_format}'}")
    click.echo(f"{source.frames} frames in {wall_s:.1f} s, {source.frames / wall_s:.0f} frames/s")
