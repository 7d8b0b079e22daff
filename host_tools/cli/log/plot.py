"""`rrins plot`: plot signals of a log over time."""

from __future__ import annotations

from pathlib import Path

import click

from rrins.host_tools.cli.log.files import (
    log_argument,
    log_channel_option,
    print_reading,
)
from rrins.host_tools.cli.options import Picture, flag, format_option, option
from rrins.host_tools.cli.output import counting
from rrins.host_tools.interruption import heed_sigterm

_DIAGNOSIS = "diagnosis"
"""The word that stands for diagnostic messages beside signals."""


@click.command()
@log_argument
@click.argument("signals", metavar="SIGNAL...", nargs=-1)
@option("--from from_s", "Start, in seconds after the first frame.", float, metavar="S")
@option("--to to_s", "End, in seconds after the first frame.", float, metavar="S")
@option(
    "--out",
    "Plot file: .png, .svg or .pdf.  [default: name of FILE, in this folder]",
    Picture(),
)
@format_option
@log_channel_option
@flag("--list as_list", "List the messages and signals in the log instead.")
def plot(
    log: Path,
    signals: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    out: Path | None,
    log_channel: str | None,
    as_list: bool,
) -> None:
    """Plot signals of the log FILE over time.

    A SIGNAL is MESSAGE.signal, a signal name that only one message has, or a pattern:
    'SENSOR_*.gyro_dtheta', '*.encoder_angle_deg', 'NAV_ATTITUDE.*'. The word diagnosis stands for
    the messages of a diagnostic tool and the computer.
    """
    heed_sigterm()
    if as_list:
        _list_contents(log, log_channel)
        return
    if not signals:
        raise click.UsageError("give at least one SIGNAL, or --list")
    _draw(log, signals, from_s, to_s, out, log_channel)


def _list_contents(path: Path, log_channel: str | None) -> None:
    """Print the messages and signals in a log."""
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.logs.series import gather
    from rrins.host_tools.logs.signals import message_names, signals_of
    from rrins.host_tools.rounding import rounded

    log = Log(path, log_channel)
    with counting("reading", log.size) as on_progress:
        _, contents = gather(log, (), on_progress=on_progress)
    print_reading(log)
    duration_s = contents.last_s - contents.first_s
    click.echo(f"{path}: {contents.frames} frames in {duration_s:.3f} s")
    for name in (n for n in message_names() if n in contents.messages):
        count = contents.messages[name]
        hz = (count - 1) / duration_s if count > 1 and duration_s > 0 else None
        rate = "" if hz is None else f", {rounded(hz, 4)} per second"
        click.echo(f"\n{name}: {count} frames{rate}")
        for signal in signals_of(name):
            unit = f" [{signal.unit}]" if signal.unit else ""
            click.echo(f"    {signal.full_name}{unit}")
    if contents.diagnosis:
        click.echo(f"\n{_DIAGNOSIS}: {len(contents.diagnosis)} messages")
    for identifier, count in sorted(contents.unknown.items()):
        click.echo(f"\n0x{identifier:03X}: {count} frames, not in the DBC")


def _draw(
    path: Path,
    words: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    out: Path | None,
    log_channel: str | None,
) -> None:
    """Plot the named signals."""
    from rrins.host_tools.drawing.saving import write_picture, write_pictures
    from rrins.host_tools.logs.pictures import draw_series
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.logs.series import gather
    from rrins.host_tools.logs.signals import find_signals
    from rrins.host_tools.recording.errors import RecordError
    from rrins.host_tools.recording.formats import name_without_ending

    has_diagnosis = _DIAGNOSIS in words
    words = tuple(word for word in words if word != _DIAGNOSIS)
    signals = find_signals(words)
    log = Log(path, log_channel)
    with counting("reading", log.size) as on_progress:
        series, contents = gather(log, signals, from_s, to_s, on_progress)
    print_reading(log)
    absent = [one.signal.full_name for one in series if not one.frames]
    shown = [one for one in series if one.frames]
    named = [name for name in absent if name in words or name.split(".")[1] in words]
    if has_diagnosis and not contents.diagnosis:
        named.append(_DIAGNOSIS)
    if named or not (shown or has_diagnosis):
        when = "" if from_s is None and to_s is None else " in that time span"
        raise RecordError(f"{path}: no frames of {', '.join(named or absent[:4])}{when}")
    drawn = draw_series(shown, contents, f"Signals of {path.name}", has_diagnosis)
    if out is None:
        (out,) = write_pictures(Path(), {name_without_ending(path): drawn})
    else:
        write_picture(out, drawn)
    click.echo(str(out))
