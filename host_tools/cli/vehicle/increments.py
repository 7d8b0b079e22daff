"""`rrins increments`: fused increments with truth, for other navigators."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.log.files import log_channel_option, print_reading
from rrins.host_tools.cli.options import FOLDER, POSITIVE, json_option, option
from rrins.host_tools.cli.output import counting, print_note, print_results
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.vehicle.navigator_files import Written


@click.command()
@click.argument("source", metavar="SCENARIO|LOG", shell_complete=complete_scenarios)
@click.argument("folder", metavar="OUT_DIR", type=FOLDER)
@option(
    "--format kind",
    "Tables in this project's frames, or the files of a navigator.",
    ("csv", "parquet", "pyins", "kf-gins", "psins"),
    "csv",
)
@option(
    "--frame",
    "Axes: b of the body, the table's turning removed; s of the sensors, with table angles.",
    ("b", "s"),
    "b",
)
@option(
    "--duration duration_s", "Length of the navigation, s.  [default: as in the scenario]", POSITIVE
)
@option("--scenario name", "Scenario of a LOG whose note names none.", metavar="NAME")
@log_channel_option
@json_option
def increments(
    source: str,
    duration_s: float | None,
    name: str | None,
    log_channel: str | None,
    as_json: bool,
    **target: Any,
) -> None:
    """Write the firmware's fused increments, with truth, to OUT_DIR for other navigators.

    SCENARIO is run without a bus; a LOG of a rehearsal is navigated again.
    """
    heed_sigterm()
    path = Path(source)
    if path.is_file() and path.suffix.lower() != ".toml":
        if duration_s is not None:
            raise click.UsageError("--duration is for a scenario; a log has its own")
        written = _of_log(path, name, log_channel, target, as_json)
    else:
        if name is not None or log_channel is not None:
            raise click.UsageError("--scenario and --log-channel are for a log")
        written = _of_scenario(source, duration_s, target, as_json)
    summary = {
        "files": [str(path) for path in written.files],
        "rows": written.rows,
        "bridged": written.bridged,
        "has_truth": written.has_truth,
        "begins_s": written.begins_s,
        "ends_s": written.ends_s,
    }
    bridged = f", {written.bridged} of them bridged" if written.bridged else ""
    span = f"{written.rows} epochs, {written.begins_s:g} s to {written.ends_s:g} s{bridged}"
    print_results(as_json, summary, [*map(str, written.files), span])


def _of_scenario(
    source: str, duration_s: float | None, target: dict[str, Any], as_json: bool
) -> Written:
    from rrins.host_tools.scenario.scenario import load
    from rrins.host_tools.vehicle.fused import fused_of_scenario
    from rrins.host_tools.vehicle.navigator_files import write

    scenario = load(source)
    if duration_s is not None:
        scenario = scenario.varied(duration_s=duration_s)
    with counting("navigating", scenario.epochs, as_json) as on_rows:
        tracks = fused_of_scenario(scenario)
        return write(tracks, scenario.period_ns, **target, on_rows=on_rows)


def _of_log(
    path: Path, name: str | None, log_channel: str | None, target: dict[str, Any], as_json: bool
) -> Written:
    from rrins.host_tools.cli.log.replay import scenario_of
    from rrins.host_tools.logs.fused_log import FusedLog
    from rrins.host_tools.logs.reader import Log
    from rrins.host_tools.vehicle.navigator_files import write

    log = Log(path, log_channel)
    _, scenario = scenario_of(log, name, f"rrins increments {path} OUT_DIR --scenario SCENARIO")
    with counting("navigating", log.size, as_json) as on_progress:
        source = FusedLog(log, scenario, on_progress)
        written = write(source.tracks(), scenario.period_ns, **target)
    print_reading(log)
    if source.why_no_truth is not None:
        print_note(f"{path}: without truth: {source.why_no_truth}")
    return written
