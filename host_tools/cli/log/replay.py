"""`rrins replay`: replay a log onto a bus or through the firmware; compare two logs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.log.files import (
    log_argument,
    log_channel_option,
    print_reading,
)
from rrins.host_tools.cli.options import (
    FOLDER,
    Bus,
    Speed,
    bus_option,
    flag,
    format_option,
    json_option,
    many,
    option,
)
from rrins.host_tools.cli.output import counting, print_json, print_note, print_results
from rrins.host_tools.errors import FirmwareFaultError
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.bus.address import Address
    from rrins.host_tools.logs.beside import Navigated
    from rrins.host_tools.logs.comparison import Comparison
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.scenario.scenario import Scenario

_ITSELF = ":itself"


@click.command()
@log_argument
@click.argument("scenario", required=False)
@bus_option
@option("--speed", "1: real time.", Speed(1e-6), "1", metavar="N|max")
@option("--times", "Number of replays.", click.IntRange(1), 1)
@flag("--loop", "Repeat until Ctrl-C.")
@many(
    "--only",
    "Send only hardware, firmware, a message or a pattern such as 'SENSOR_*'; repeatable.",
    "WHAT",
)
@flag("--firmware through_firmware", "Feed the log to the firmware in lockstep, without a bus.")
@many(
    "--set settings",
    "Change a key of the scenario for --firmware, such as estimator.gate=4; repeatable.",
    "KEY=VALUE",
)
@many(
    "--beside",
    "Navigate once more with these settings, for comparison; repeatable.",
    "'KEY=VALUE …'",
)
@click.option(
    "--compare",
    is_flag=False,
    flag_value=_ITSELF,
    metavar="[OTHER]",
    help="Report the first epoch and signal that differ from the recording, or from OTHER.",
)
@format_option
@option("--out", "Folder for the results of --firmware.  [default: out/FILE]", FOLDER)
@log_channel_option
@json_option
def replay(
    log: Path,
    scenario: str | None,
    bus: Bus,
    speed: float | None,
    times: int,
    loop: bool,
    only: tuple[str, ...],
    through_firmware: bool,
    settings: tuple[str, ...],
    beside: tuple[str, ...],
    compare: str | None,
    out: Path | None,
    log_channel: str | None,
    as_json: bool,
) -> None:
    """Replay the log FILE onto a bus, or through the firmware.

    --firmware feeds the recorded frames to the firmware, configured by SCENARIO or, by default, as
    it was during the recording. --set changes keys of the scenario; --beside navigates once more
    with other settings. `replay FILE --compare OTHER` compares two logs. The exit status is 10 if
    they differ.
    """
    heed_sigterm()
    other = None if compare in (None, _ITSELF) else Path(str(compare))
    if through_firmware or compare == _ITSELF:
        comparing = (compare is not None, other)
        _navigate_again(log, scenario, settings, beside, out, comparing, as_json, log_channel)
    elif settings or beside:
        raise click.UsageError("--set and --beside are for --firmware")
    elif scenario is not None:
        raise click.UsageError(f"scenario {scenario}: only --firmware accepts a scenario")
    elif other is not None:
        _compare(log, other, as_json, log_channel)
    else:
        _play(log, bus.address(), as_json, speed, times, loop, only, log_channel)


def _play(
    path: Path,
    address: Address,
    as_json: bool,
    factor: float | None,
    times: int,
    loop: bool,
    only: tuple[str, ...],
    log_channel: str | None,
) -> None:
    """Replay a log onto a bus."""
    from rrins.host_tools.logs.playback import Playback, identifiers_of
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.recording.errors import RecordError

    identifiers = identifiers_of(only)
    log = Log(path, log_channel)
    playback = Playback(address, factor, identifiers)
    pace = "as fast as possible" if factor is None else f"{factor:g} × real time"
    print_note(f"replaying {path} onto {address}, {pace}; Ctrl-C stops")
    turns = 0
    try:
        while loop or turns < times:
            log = Log(path, log_channel) if turns else log
            playback.play(log)
            turns += 1
    finally:
        playback.close()
        played = playback.played
        summary = {
            "frames": played.frames,
            "times": turns,
            "wall_s": round(played.wall_s, 3),
            "latest_ms": round(played.latest_s * 1000, 3),
        }
        text = (
            f"{played.frames} frames sent in {played.wall_s:.1f} s, "
            f"the latest {played.latest_s * 1000:.1f} ms late"
        )
        print_results(as_json, summary, [text])
    print_reading(log)
    if not played.frames:
        raise RecordError(f"{path}: no frame matches --only")


def _navigate_again(
    path: Path,
    name: str | None,
    settings: tuple[str, ...],
    besides: tuple[str, ...],
    out: Path | None,
    comparing: tuple[bool, Path | None],
    as_json: bool,
    log_channel: str | None,
) -> None:
    """Feed the frames of a log to the firmware, and again for each of `besides`."""
    from rrins.host_tools.logs import beside
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.logs.replay import replay
    from rrins.host_tools.logs.replay_results import print_replay, write_replay
    from rrins.host_tools.runs.results.results import write_summary
    from rrins.host_tools.runs.run import folder_of
    from rrins.host_tools.runs.sides.job import prepare_firmware
    from rrins.host_tools.terminal import print_table

    log = Log(path, log_channel)
    name, scenario = scenario_of(log, name, f"rrins replay {path} SCENARIO --firmware")
    scenario = beside.varied(scenario, settings)
    variants = [(text, beside.varied(scenario, text.split())) for text in besides]
    with_comparison, other = comparing
    against = None if other is None else Log(other)
    folder = folder_of(out, path.name)
    prepare_firmware(scenario)
    with counting("navigating", log.size, as_json) as on_progress:
        replayed = replay(log, scenario, folder, with_comparison, against, on_progress)
    print_reading(log)
    first, paths = write_replay(folder, name, scenario, log, replayed, print_note)
    summary = first.summary
    if variants:
        first = replace(first, label=" ".join(settings) or first.label)
        found = [first, *_variants(path, name, variants, folder, as_json, log_channel)]
        title = f"{scenario.title or name}, replayed from {path.name}"
        paths.append(beside.write_picture(found, folder, title))
        summary["beside"] = beside.summary_of(found)
        write_summary(folder / "summary.json", summary)
        if not as_json:
            print_table(beside.table_of(found))
    if as_json:
        print_json(summary)
    else:
        print_replay(summary, paths)
    if replayed.comparison is not None:
        _judge(replayed.comparison, as_json)
    if not summary["firmware"]["epochs_navigated"]:
        raise FirmwareFaultError("the firmware never navigated; is it the log's scenario?")


def _variants(
    path: Path,
    name: str,
    variants: list[tuple[str, Scenario]],
    folder: Path,
    as_json: bool,
    log_channel: str | None,
) -> Iterator[Navigated]:
    """Yield a log navigated with other settings; the results of each go into a folder."""
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.logs.replay import replay
    from rrins.host_tools.logs.replay_results import write_replay
    from rrins.host_tools.runs.sides.job import prepare_firmware

    for number, (label, scenario) in enumerate(variants, 1):
        below = folder / f"beside-{number}"
        below.mkdir(exist_ok=True)
        prepare_firmware(scenario)
        log = Log(path, log_channel)
        with counting(label, log.size, as_json) as on_progress:
            replayed = replay(log, scenario, below, on_progress=on_progress)
        navigated, _ = write_replay(below, name, scenario, log, replayed, print_note)
        yield replace(navigated, label=label)


def scenario_of(log: Log, name: str | None, example: str) -> tuple[str, Scenario]:
    """Return the requested scenario, or the one in the note next to the log.

    Raises
    ------
    RecordError
        When there is neither; the message shows the `example` of a command that names one.
    """
    from rrins.host_tools.recording.errors import RecordError
    from rrins.host_tools.scenario.scenario import load

    if name is not None:
        return name, load(name)
    recorded = None if log.note is None else log.note.loaded_scenario(log.path)
    if log.note is None or recorded is None:
        raise RecordError(f"{log.path}: no note next to it names its scenario; give one: {example}")
    return log.note.scenario_name or log.path.stem, recorded


def _compare(ours: Path, theirs: Path, as_json: bool, log_channel: str | None) -> None:
    """Compare two logs; the channel applies to the first."""
    from rrins.host_tools.logs.alignment import compare_logs
    from rrins.host_tools.logs.reader import Log

    left, right = Log(ours, log_channel), Log(theirs)
    with counting("comparing", left.size + right.size, as_json) as on_progress:
        comparison = compare_logs(left, right, on_progress)
    print_reading(left)
    print_reading(right)
    if as_json:
        print_json(comparison.summary())
    _judge(comparison, as_json)


def _judge(comparison: Comparison, as_json: bool) -> None:
    """Report the differences.

    Raises
    ------
    DifferenceError
        If there are any.
    """
    from rrins.host_tools.recording.errors import DifferenceError

    differs = comparison.first is not None
    if not as_json:
        print_results(False, {}, [_table_of(comparison) if differs else comparison.text()])
    if differs:
        raise DifferenceError(comparison.text())


def _table_of(comparison: Comparison) -> Table:
    from rrins.host_tools.rounding import rounded
    from rrins.host_tools.terminal import new_table

    table = new_table("Differences", "signal", "from epoch", "frames", "max difference")
    for row in comparison.summary()["signals"]:
        apart = "" if row["largest"] is None else f"{rounded(row['largest'])} {row['unit']}"
        epoch = "before SYNC" if row["first_epoch"] is None else str(row["first_epoch"])
        table.add_row(row["signal"], epoch, str(row["frames"]), apart)
    return table
