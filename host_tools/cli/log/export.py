"""`rrins export`: a log, or what describes bus and computer, as files for other tools."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from rrins.host_tools.cli.log.files import log_channel_option, print_reading
from rrins.host_tools.cli.options import PATH, json_option, option
from rrins.host_tools.cli.output import counting, print_note, print_results
from rrins.host_tools.descriptions.writing import DESCRIPTIONS, write_description
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.logs.reader import Log


Format = Literal["parquet", "csv", "mcap", "pcapng"]
_FORMATS: tuple[Format, ...] = ("parquet", "csv", "mcap", "pcapng")
_FILES: tuple[Format, ...] = ("mcap", "pcapng")  # one file, not a folder


@click.command()
@click.argument("log", metavar="[FILE]", type=PATH, required=False)
@click.argument("out", metavar="OUT", type=PATH, required=False)
@option(
    "--format file_format",
    "Tables, or one file: MCAP for Foxglove, pcapng for Wireshark.  [default: what OUT ends in, "
    "else parquet]",
    _FORMATS,
)
@log_channel_option
@json_option
def export(
    log: Path | None,
    out: Path | None,
    file_format: Format | None,
    log_channel: str | None,
    as_json: bool,
) -> None:
    """Write the log FILE as tables, one per message, into the folder OUT; or as one file.

    The ending of OUT chooses: .mcap and .pcapng are files, anything else a folder.

    Without a log, OUT describes bus and computer to other tools: .pdx has the diagnosis (ODX).
    """
    from rrins.host_tools.logs.reader import Log

    if log is None:
        raise click.UsageError("Missing argument 'OUT'.")
    if out is None or out.suffix.lower() in DESCRIPTIONS:
        if out is not None:
            raise click.UsageError(f"{out} describes bus and computer: it is made without a log")
        if file_format is not None or log_channel is not None:
            raise click.UsageError("--format and --log-channel are for logs")
        _describe(log, as_json)
        return

    file_format = _format_of(out, file_format)
    heed_sigterm()
    source = Log(log, log_channel)
    if file_format in _FILES and out.is_dir():
        raise click.UsageError(f"{out} is a folder; {file_format} is a file")
    if file_format == "mcap":
        _export_mcap(source, out, as_json)
    elif file_format == "pcapng":
        _export_pcapng(source, out, as_json)
    else:
        _export_tables(source, out, file_format, as_json)


def _describe(path: Path, as_json: bool) -> None:
    """Write what describes bus and computer."""
    what = DESCRIPTIONS.get(path.suffix.lower())
    if what is None:
        endings = ", ".join(DESCRIPTIONS)
        raise click.UsageError(f"{path}: a log needs an OUT; without a log OUT ends in {endings}")
    write_description(path)
    print_results(as_json, {"file": str(path), "describes": what}, [f"{path}: {what}"])


def _format_of(out: Path, wanted: Format | None) -> Format:
    """Return the format that is wanted, or that the ending of OUT says."""
    from rrins.host_tools.recording.formats import WRITTEN

    ending = out.suffix.lower()
    for one in _FILES:
        if ending == f".{one}":
            if wanted not in (None, one):
                raise click.UsageError(f"{out} names a file, {one}, and not --format {wanted}")
            return one
    if wanted not in _FILES and not out.is_dir() and ending in (".parquet", *WRITTEN):
        raise click.UsageError(
            f"{out} names one file; OUT is a folder for a table per message, or ends in "
            + " or ".join(f".{one}" for one in _FILES)
        )
    return wanted or "parquet"


def _export_mcap(source: Log, path: Path, as_json: bool) -> None:
    from rrins.host_tools.dashboard.mcap_file import export_mcap

    begun = time.monotonic()
    with counting("exporting", source.size, as_json) as on_progress:
        exported = export_mcap(source, path, on_progress)
    wall_s = time.monotonic() - begun
    print_reading(source)
    _print_skipped(source.path, exported.wrong_length, exported.unknown)
    summary = {
        "file": str(path),
        "format": "mcap",
        "frames": source.frames,
        "messages": exported.messages,
        "unknown": exported.unknown,
        "wrong_length": exported.wrong_length,
        "wall_s": round(wall_s, 3),
    }
    lines = [f"{count:>10}  {topic}" for topic, count in exported.messages.items()]
    lines.append(f"{source.frames} frames in {wall_s:.1f} s: {path}")
    print_results(as_json, summary, lines)


def _export_pcapng(source: Log, path: Path, as_json: bool) -> None:
    from rrins.host_tools.logs.pcapng import export_pcapng

    begun = time.monotonic()
    with counting("exporting", source.size, as_json) as on_progress:
        told = export_pcapng(source, path, on_progress)
    wall_s = time.monotonic() - begun
    print_reading(source)
    summary = {
        "file": str(path),
        "format": "pcapng",
        "frames": source.frames,
        "diagnosis": told,
        "wall_s": round(wall_s, 3),
    }
    words = f"{source.frames} frames in {wall_s:.1f} s, {told} with diagnosis in words: {path}"
    print_results(as_json, summary, [words])


def _print_skipped(log: Path, wrong_length: int, unknown: int) -> None:
    if wrong_length:
        print_note(f"{log}: {wrong_length} frames of the wrong length were skipped")
    if unknown:
        print_note(f"{log}: {unknown} frames are not in the DBC and were skipped")


def _export_tables(
    source: Log, folder: Path, file_format: Literal["parquet", "csv"], as_json: bool
) -> None:
    from rrins.host_tools.logs import tables
    from rrins.host_tools.logs.signals import message_names

    if folder.is_file():
        raise click.UsageError(f"{folder} is a file; tables need a folder")
    begun = time.monotonic()
    with counting("exporting", source.size, as_json) as on_progress:
        exported = tables.export(source, folder, file_format, on_progress)
    wall_s = time.monotonic() - begun
    print_reading(source)
    if exported.left:
        left, remain = "1 table", "remains"
        if exported.left != 1:
            left, remain = f"{exported.left} tables", "remain"
        print_note(f"{folder}: {left} of another export {remain} there")
    _print_skipped(source.path, exported.wrong_length, exported.unknown)
    rows = {name: exported.rows[name] for name in message_names() if name in exported.rows}
    summary = {
        "folder": str(folder),
        "format": file_format,
        "frames": source.frames,
        "rows": rows,
        "unknown": exported.unknown,
        "wrong_length": exported.wrong_length,
        "wall_s": round(wall_s, 3),
    }
    lines = [f"{count:>10}  {folder / f'{name}.{file_format}'}" for name, count in rows.items()]
    speed = source.frames / wall_s
    lines.append(f"{source.frames} frames in {wall_s:.1f} s, {speed:.0f} frames/s")
    print_results(as_json, summary, lines)
