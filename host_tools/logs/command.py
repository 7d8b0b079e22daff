"""The commands `rrins record`, `replay`, `export` and `plot`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from host_tools.interruption import heed_sigterm

_ITSELF = ":itself"

_bus_options = (
    click.option(
        "--interface", default="rrins", show_default=True, help="python-can interface name."
    ),
    click.option("--channel", help="Channel of the interface.  [default: rrins0]"),
    click.option("--bitrate", type=click.IntRange(1), help="For interfaces that set it."),
)
_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
_log_argument = click.argument("log", metavar="FILE", type=click.Path(path_type=Path))
_log_channel_option = click.option(
    "--log-channel",
    metavar="NAME",
    help="Only the frames of this channel of FILE, as the log names it.  [default: all]",
)


def _with_bus(command: Callable[..., Any]) -> Callable[..., Any]:
    for option in reversed(_bus_options):
        command = option(command)
    return command


@click.command()
@click.argument("path", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path))
@_with_bus
@click.option(
    "--rotate-size",
    "rotate_mb",
    type=click.FloatRange(min=0, min_open=True),
    metavar="MB",
    help="Go on in another file, at the next SYNC, when one has so many megabytes.",
)
@click.option(
    "--for",
    "for_s",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Seconds of the bus's time; without it, until Ctrl-C or the end of the bus.",
)
@click.option(
    "--lossless/--observer",
    default=None,
    help="Whether the embedded bus waits for the recorder.  [default: unless it is in real time]",
)
@_json_option
def record(
    path: Path,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    rotate_mb: float | None,
    for_s: float | None,
    lossless: bool | None,
    as_json: bool,
) -> None:
    """Record a bus to FILE.

    Its ending is the format: .log (candump), .asc, .blf, .mf4, .csv, .trc, .db, .txt; the texts
    with .gz as well. An existing file is replaced.
    """
    from host_tools.logs import jobs

    address = jobs.address_of(interface, channel, bitrate)
    jobs.record(path, address, rotate_mb, for_s, lossless, as_json)


@click.command()
@_log_argument
@click.argument("scenario", required=False)
@_with_bus
@click.option("--speed", default="1", show_default=True, metavar="N|max", help="1 is real time.")
@click.option("--times", type=click.IntRange(1), default=1, show_default=True, help="How often.")
@click.option("--loop", is_flag=True, help="Over and over, until Ctrl-C.")
@click.option(
    "--only",
    multiple=True,
    metavar="WHAT",
    help="hardware, firmware, a message or a pattern such as 'SENSOR_*'; more than once.",
)
@click.option(
    "--firmware",
    "through_firmware",
    is_flag=True,
    help="Through the firmware in lockstep, without a bus.",
)
@click.option(
    "--compare",
    is_flag=False,
    flag_value=_ITSELF,
    metavar="[OTHER]",
    help="Name the first epoch and signal that differ from the recorded ones, or from OTHER.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for what --firmware comes to.  [default: out/FILE]",
)
@_log_channel_option
@_json_option
def replay(
    log: Path,
    scenario: str | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    through_firmware: bool,
    compare: str | None,
    out: Path | None,
    log_channel: str | None,
    as_json: bool,
    **pace: Any,
) -> None:
    """Replay the log FILE onto a bus, or navigate it again.

    With --firmware its frames go through the firmware, set up by SCENARIO, else as it was when
    the log was recorded. `replay FILE --compare OTHER` compares two logs. The exit status is 10
    when something differs.
    """
    from host_tools.logs import jobs

    heed_sigterm()
    other = None if compare in (None, _ITSELF) else Path(str(compare))
    if through_firmware or compare == _ITSELF:
        jobs.navigate_again(log, scenario, out, compare is not None, other, as_json, log_channel)
    elif scenario is not None:
        raise click.UsageError(f"the scenario {scenario} is for --firmware only")
    elif other is not None:
        jobs.compare(log, other, as_json, log_channel)
    else:
        address = jobs.address_of(interface, channel, bitrate)
        jobs.play(log, address, as_json, log_channel=log_channel, **pace)


@click.command()
@_log_argument
@click.argument("folder", metavar="OUT_DIR", type=click.Path(file_okay=False, path_type=Path))
@click.option(
    "--format",
    "kind",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="Of the tables.",
)
@_log_channel_option
@_json_option
def export(log: Path, folder: Path, kind: str, log_channel: str | None, as_json: bool) -> None:
    """Write the log FILE as tables, one for each message, into OUT_DIR."""
    from host_tools.logs import jobs

    heed_sigterm()
    jobs.export(log, folder, kind, as_json, log_channel)


@click.command()
@_log_argument
@click.argument("signals", metavar="SIGNAL...", nargs=-1)
@click.option("--from", "from_s", type=float, metavar="S", help="Seconds after the first frame.")
@click.option("--to", "to_s", type=float, metavar="S", help="Seconds after the first frame.")
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    help="The picture: .png, .svg or .pdf.  [default: FILE's name with .png, here]",
)
@_log_channel_option
@click.option("--list", "as_list", is_flag=True, help="List what the log has instead.")
def plot(
    log: Path,
    signals: tuple[str, ...],
    from_s: float | None,
    to_s: float | None,
    out: Path | None,
    log_channel: str | None,
    as_list: bool,
) -> None:
    """Draw signals of the log FILE over time.

    A SIGNAL is MESSAGE.signal, a signal's name where only one message has it, or a pattern:
    'SENSOR_*.gyro_dtheta', '*.encoder_angle_deg', 'NAV_ATTITUDE.*'.
    """
    from host_tools.logs import jobs

    heed_sigterm()
    if as_list:
        jobs.list_contents(log, log_channel)
        return
    if not signals:
        raise click.UsageError("name a signal, or ask for --list")
    jobs.plot(log, signals, from_s, to_s, out, log_channel)
