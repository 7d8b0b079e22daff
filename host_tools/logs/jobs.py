"""What the commands of the logs do: read, replay, write, show."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, cast

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from host_tools import interruption
from host_tools import scenario as scenarios
from host_tools.errors import FirmwareFaultError
from host_tools.logs.comparison import Comparison
from host_tools.logs.errors import DifferenceError, RecordError
from host_tools.logs.formats import check_path, name_without_ending
from host_tools.logs.playback import Playback, identifiers_of
from host_tools.logs.reader import Log
from host_tools.logs.recorder import Recorder, waits_for_recorder
from host_tools.logs.signals import find_signals, message_names, signals_of
from host_tools.port import Address
from host_tools.scenario import Scenario

_POLL_S = 0.1


def address_of(interface: str, channel: str | None, bitrate: int | None) -> Address:
    """Return the bus that the options name, `rrins0` by default."""
    from host_tools.runs import Bus, default_side_address

    return default_side_address(Bus(interface, channel, bitrate))


def tell(text: str) -> None:
    """Say a line to the user, on standard error."""
    click.echo(f"rrins: {text}", err=True)


def _tell_reading(log: Log) -> None:
    if log.damage is not None:
        tell(f"{log.damage}; what could be read was used")
    if log.passed_over:
        tell(f"{log.path}: {log.passed_over} CAN FD frames are passed over")
    if log.is_mixed:
        counts = ", ".join(f"{name} ({count} frames)" for name, count in log.channels.items())
        tell(f"{log.path}: its channels are mixed: {counts}; --log-channel chooses one")


@contextmanager
def _reading(what: str, size: int, quiet: bool = False) -> Iterator[Any]:
    """Show how far the reading of a log is; yields what takes the bytes read so far."""
    console = Console(stderr=True)
    with Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(compact=True),
        console=console,
        transient=True,
        disable=quiet or not console.is_terminal,
    ) as progress:
        task = progress.add_task(what, total=size)
        yield lambda position: progress.update(task, completed=position)


def record(
    path: Path,
    address: Address,
    rotate_mb: float | None,
    for_s: float | None,
    lossless: bool | None,
    as_json: bool,
) -> None:
    """Do `rrins record`."""
    rotate_bytes = None if rotate_mb is None else round(rotate_mb * 1e6)
    with interruption.as_event() as stop:
        if lossless is None:
            check_path(path)
            lossless = waits_for_recorder(address)
        recorder = Recorder(path, address, lossless, None, rotate_bytes, for_s)
        try:
            tell(f"recording {address} to {path}; Ctrl-C stops")
            begun = time.monotonic()
            while not (recorder.has_ended.is_set() or stop.wait(_POLL_S)):
                passed_s = 0.0 if address.is_embedded else time.monotonic() - begun
                if for_s is not None and passed_s > for_s:  # on a bus without frames
                    break
        finally:
            recorder.close()
    parts = [part.file for part in recorder.note.parts]
    found = {
        "file": str(path),
        "parts": parts,
        "frames": recorder.frames,
        "duration_s": round(recorder.duration_s, 6),
        "time": recorder.note.time,
    }
    if recorder.failure is not None:
        raise RecordError(f"recording {path}: {recorder.failure}")
    if as_json:
        click.echo(json.dumps(found))
    else:
        files = f" in {len(parts)} files" if len(parts) > 1 else ""
        click.echo(
            f"{path}: {recorder.frames} frames{files}, {recorder.duration_s:.3f} s of "
            f"{recorder.note.time or 'no'} time"
        )


def play(
    path: Path,
    address: Address,
    as_json: bool,
    speed: str,
    times: int,
    loop: bool,
    only: tuple[str, ...],
    log_channel: str | None,
) -> None:
    """Do `rrins replay` onto a bus."""
    identifiers = identifiers_of(only)
    factor = _speed_of(speed)
    log = Log(path, log_channel)
    playback = Playback(address, factor, identifiers)
    pace = "as fast as it goes" if factor is None else f"{factor:g} × real time"
    tell(f"replaying {path} onto {address}, {pace}; Ctrl-C stops")
    turns = 0
    try:
        while loop or turns < times:
            log = Log(path, log_channel) if turns else log
            playback.play(log)
            turns += 1
    finally:
        playback.close()
        played = playback.played
        found = {
            "frames": played.frames,
            "times": turns,
            "wall_s": round(played.wall_s, 3),
            "latest_ms": round(played.latest_s * 1000, 3),
        }
        words = (
            f"{played.frames} frames sent in {played.wall_s:.1f} s, "
            f"the latest {played.latest_s * 1000:.1f} ms late"
        )
        click.echo(json.dumps(found) if as_json else words)
    _tell_reading(log)
    if not played.frames:
        raise RecordError(f"{path}: none of its frames is what --only names")


def _speed_of(text: str) -> float | None:
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0 < speed < 1e9:
        raise click.BadParameter(
            f"{text!r} is neither a number above 0 nor 'max'", param_hint="--speed"
        )
    return speed


def _scenario_of(log: Log, name: str | None) -> tuple[str, Scenario]:
    """Return the scenario that is asked for, or that of the note beside the log."""
    if name is not None:
        return name, scenarios.load(name)
    recorded = None if log.note is None else log.note.loaded_scenario(log.path)
    if log.note is None or recorded is None:
        raise RecordError(
            f"{log.path}: no note beside it says by which scenario it was recorded; name one: "
            f"rrins replay {log.path} SCENARIO --firmware"
        )
    return log.note.scenario_name or log.path.stem, recorded


def navigate_again(
    path: Path,
    name: str | None,
    out: Path | None,
    with_comparison: bool,
    other: Path | None,
    as_json: bool,
    log_channel: str | None = None,
) -> None:
    """Do `rrins replay --firmware`."""
    from host_tools.logs.replay import replay
    from host_tools.logs.results import show, write_replay
    from host_tools.runs import folder_of
    from host_tools.sides import prepare_firmware

    log = Log(path, log_channel)
    name, scenario = _scenario_of(log, name)
    against = None if other is None else Log(other)
    folder = folder_of(out, path.name)
    prepare_firmware(scenario)
    with _reading("navigating again", log.size, as_json) as on_progress:
        replayed = replay(log, scenario, folder, with_comparison, against, on_progress)
    _tell_reading(log)
    summary, paths = write_replay(folder, name, scenario, log, replayed)
    if as_json:
        click.echo(json.dumps(summary))
    else:
        show(summary, paths)
    if replayed.comparison is not None:
        _judge(replayed.comparison, as_json)
    if not summary["firmware"]["epochs_navigated"]:
        raise FirmwareFaultError("the firmware never navigated; is it the log's scenario?")


def compare(ours: Path, theirs: Path, as_json: bool, log_channel: str | None = None) -> None:
    """Do `rrins replay A --compare B`; the channel is one of A."""
    from host_tools.logs.alignment import compare_logs

    left, right = Log(ours, log_channel), Log(theirs)
    with _reading("comparing", left.size + right.size, as_json) as on_progress:
        found = compare_logs(left, right, on_progress)
    _tell_reading(left)
    _tell_reading(right)
    if as_json:
        click.echo(json.dumps(found.summary()))
    _judge(found, as_json)


def _judge(comparison: Comparison, as_json: bool) -> None:
    """Say what differs.

    Raises
    ------
    DifferenceError
        When something does.
    """
    if comparison.first is None:
        if not as_json:
            click.echo(comparison.text())
        return
    if not as_json:
        Console().print(_table_of(comparison))
    raise DifferenceError(comparison.text())


def _table_of(comparison: Comparison) -> Table:
    table = Table(title="What differs", title_justify="left")
    for column in ("signal", "from epoch", "frames", "apart by up to"):
        table.add_column(column, justify="left" if column == "signal" else "right", no_wrap=True)
    for row in comparison.summary()["signals"]:
        apart = "" if row["largest"] is None else f"{row['largest']:.3g} {row['unit']}"
        epoch = "before SYNC" if row["first_epoch"] is None else str(row["first_epoch"])
        table.add_row(row["signal"], epoch, str(row["frames"]), apart)
    return table


def export(
    path: Path, folder: Path, kind: str, as_json: bool, log_channel: str | None = None
) -> None:
    """Do `rrins export`."""
    from host_tools.logs import tables

    log = Log(path, log_channel)
    begun = time.monotonic()
    with _reading("exporting", log.size, as_json) as on_progress:
        found = tables.export(log, folder, cast(Literal["parquet", "csv"], kind), on_progress)
    wall_s = time.monotonic() - begun
    _tell_reading(log)
    if found.left:
        left = "1 table" if found.left == 1 else f"{found.left} tables"
        tell(f"{folder}: {left} of another export {'is' if found.left == 1 else 'are'} left there")
    if found.wrong_length:
        tell(f"{path}: {found.wrong_length} frames have a wrong length and are left out")
    if found.unknown:
        tell(f"{path}: {found.unknown} frames are none of the contract's and are left out")
    rows = {name: found.rows[name] for name in message_names() if name in found.rows}
    if as_json:
        click.echo(
            json.dumps(
                {
                    "folder": str(folder),
                    "format": kind,
                    "frames": log.frames,
                    "rows": rows,
                    "unknown": found.unknown,
                    "wrong_length": found.wrong_length,
                    "wall_s": round(wall_s, 3),
                }
            )
        )
        return
    for name, count in rows.items():
        click.echo(f"{count:>10}  {folder / f'{name}.{kind}'}")
    click.echo(f"{log.frames} frames in {wall_s:.1f} s, {log.frames / wall_s:.0f} a second")


def list_contents(path: Path, log_channel: str | None = None) -> None:
    """Do `rrins plot --list`."""
    from host_tools.logs.series import gather

    log = Log(path, log_channel)
    with _reading("reading", log.size) as on_progress:
        _, contents = gather(log, (), on_progress=on_progress)
    _tell_reading(log)
    duration_s = contents.last_s - contents.first_s
    click.echo(f"{path}: {contents.frames} frames in {duration_s:.3f} s")
    for name in (n for n in message_names() if n in contents.messages):
        count = contents.messages[name]
        rate = f", {(count - 1) / duration_s:.4g} a second" if count > 1 and duration_s > 0 else ""
        click.echo(f"\n{name}: {count} frames{rate}")
        for described in signals_of(name):
            unit = f" [{described.unit}]" if described.unit else ""
            click.echo(f"    {described.full_name}{unit}")
    for identifier, count in sorted(contents.strangers.items()):
        click.echo(f"\n0x{identifier:03X}: {count} frames, none of the contract's")


def plot(
    path: Path,
    words: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    out: Path | None,
    log_channel: str | None = None,
) -> None:
    """Do `rrins plot`."""
    from host_tools.logs.pictures import draw_series, save
    from host_tools.logs.series import gather

    signals = find_signals(words)
    log = Log(path, log_channel)
    with _reading("reading", log.size) as on_progress:
        series, contents = gather(log, signals, from_s, to_s, on_progress)
    _tell_reading(log)
    absent = [one.signal.full_name for one in series if not one.frames]
    shown = [one for one in series if one.frames]
    named = [name for name in absent if name in words or name.split(".")[1] in words]
    if named or not shown:
        when = "" if from_s is None and to_s is None else " in that time"
        raise RecordError(f"{path}: has no frame of {', '.join(named or absent[:4])}{when}")
    picture = out or Path(name_without_ending(path) + ".png")
    save(draw_series(shown, contents, path.name), picture)
    click.echo(str(picture))
