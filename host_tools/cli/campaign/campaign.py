"""`rrins campaign`: thousands of runs, and what they come to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.options import (
    FILE,
    FOLDER,
    PATH,
    Number,
    duration_option,
    flag,
    format_option,
    json_option,
    many,
    option,
)
from rrins.host_tools.cli.output import print_results

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.campaigns.store import Store

_DEFINING = ("set", "vary", "fault", "correlate", "seed", "design", "duration_s")
"""Options that define a campaign."""

_NOT_SAME = (
    "differs from the table of runs: made with other sources, libraries or another processor"
)


@click.command()
@click.argument("source")
@click.argument("action", nargs=-1, metavar="[rerun RUN|report|sensitivity|compare FOLDER]")
@option("--runs", "Number of runs.  [default: 100]", click.IntRange(1, 100_000_000))
@option("--seed", "Root seed of all draws.  [default: 1]", click.IntRange(0))
@many(
    "--vary",
    "Draw a key of the scenario from this distribution; repeatable.",
    "'KEY=DISTRIBUTION'",
)
@many("--set", "Set a key in all runs.", "KEY=VALUE")
@many(
    "--fault",
    "Fault in every run; values may be distributions; `size` fits every kind of fault.",
    "'KEY=VALUE, …'",
)
@many("--correlate", "Correlation of two inputs.", "'KEY, KEY = ρ'")
@option(
    "--design",
    "Design of the sample.  [default: random]",
    ("random", "lhs", "sobol", "saltelli", "grid", "one-at-a-time"),
)
@duration_option
@option(
    "--until", 'Stop early, e.g. at "p95 of horizontal_error_m within 10 %".', metavar="CRITERION"
)
@option(
    "--workers",
    "Number of workers, or a Dask scheduler.  [default: processors]",
    metavar="N|ADDRESS",
)
@option("--engine", "Kind of workers.", ("threads", "processes", "dask"))
@option("--scheduler-file", "Scheduler file written by Dask.", PATH)
@option(
    "--silence silence_s", "Give up after this many seconds without a result.", Number(1, 1e6), 600
)
@option("--out", "Folder of the campaign.  [default: out/campaigns/NAME]", FOLDER)
@format_option
@flag("--bus on_bus", "rerun: use two processes on the embedded bus.")
@option("--record", "rerun: record the bus to this file.", FILE)
@json_option
def campaign(
    source: str, action: tuple[str, ...], out: Path | None, as_json: bool, **options: Any
) -> None:
    """Run a scenario thousands of times, each time with different values.

    SOURCE is a campaign's TOML file, a scenario, or the folder of a campaign to resume. Stored runs
    are not repeated, whatever stopped the campaign.

    `rerun RUN` repeats one run and keeps all its results. `report` writes an HTML page with plots,
    `sensitivity` shows which input matters, `compare FOLDER` tests whether another campaign differs
    significantly.
    """
    from rrins.host_tools.campaigns.store import Store, is_campaign

    folder = Path(source)
    is_stored = is_campaign(folder)
    if is_stored:
        if any(options[key] not in (None, ()) for key in _DEFINING):
            text = "A stored campaign goes on as it is; name a scenario or its file."
            raise click.UsageError(text)
        store = Store.open(folder)
        if options["runs"] is not None:
            store = Store(folder, store.definition.with_runs(options["runs"]))
    else:
        store = _new_store(source, out, options)
    if not action:
        _run(store, options, as_json)
        return
    place = out if is_stored else None
    if len(action) == 2 and action[0] == "rerun" and action[1].isdecimal():
        _rerun(store, int(action[1]), options, place, as_json)
        return
    from rrins.host_tools.cli.campaign import actions

    match action:
        case ("report",):
            actions.write_report(store, place, as_json)
        case ("sensitivity",):
            actions.show_sensitivity(store, as_json)
        case ("compare", other):
            actions.show_comparison(store, Path(other), as_json)
        case _:
            known = "`rerun RUN`, `report`, `sensitivity` and `compare FOLDER`"
            raise click.UsageError(f"{' '.join(action)!r}: behind SOURCE there are {known}.")


def _new_store(source: str, out: Path | None, options: dict[str, Any]) -> Store:
    from rrins.host_tools.campaigns import words
    from rrins.host_tools.campaigns.definition import Wishes, load
    from rrins.host_tools.campaigns.store import Store

    wishes = Wishes(
        runs=options["runs"],
        seed=options["seed"],
        design=options["design"],
        duration_s=options["duration_s"],
        set=words.settings_of(options["set"]),
        vary=words.variations_of(options["vary"]),
        correlate=[words.correlation_of(text) for text in options["correlate"]],
        faults=[words.fault_of(text) for text in options["fault"]],
    )
    definition = load(source, wishes)
    folder = out if out is not None else Path("out/campaigns") / definition.name
    return Store(folder, definition)


def _run(store: Store, options: dict[str, Any], as_json: bool) -> None:
    from rrins.host_tools.campaigns import running, summary
    from rrins.host_tools.campaigns.conduct import Progress
    from rrins.host_tools.campaigns.store import Store
    from rrins.host_tools.campaigns.until import Until
    from rrins.host_tools.interruption import as_event
    from rrins.host_tools.rounding import rounded
    from rrins.host_tools.terminal import new_console, progress_line

    until = None if options["until"] is None else Until.parse(options["until"])
    workers = running.Workers.of(options["workers"], options["engine"], options["scheduler_file"])
    store = Store.create(store.folder, store.definition)
    console = new_console(stderr=True)
    unit = "" if until is None else f" {until.column}"
    with as_event() as stop, progress_line(console, refresh_hz=4) as line:
        task = line.add_task("preparing", total=store.definition.runs, start=False)

        def show(progress: Progress) -> None:
            if not line.tasks[0].started:
                line.start_task(task)
            figures = progress.figures()
            state = [f"{progress.stored} of {progress.planned}", f"{rounded(progress.rate)} runs/s"]
            if figures is not None:
                state.append("p50 {} p95 {}{}".format(*map(summary.shown, figures), unit))
            if progress.workers == 0:
                state.append("no workers yet")
            if progress.failed:
                state.append(f"{progress.failed} without an end")
            line.update(
                task,
                completed=progress.stored,
                total=progress.planned,
                description="campaign",
                state=tuple(state),
            )

        def compiling(functions: int) -> None:
            line.update(task, description=f"compiling functions: {functions}")

        progress = running.run(store, workers, until, options["silence_s"], show, compiling, stop)
    run_now = progress.stored - progress.begun_with
    result = summary.values_of(store) | {
        "run_now": run_now,
        "wall_s": progress.wall_s,
        "runs_per_s": progress.rate,
        "lost_chunks": progress.lost,
    }
    parts: list[Table | str] = [summary.table_of(store), *summary.lines_of(store)]
    if store.stopped_at is not None and until is not None:
        parts.append(f"{until.text}: after {store.stopped_at} runs")
    print_results(as_json, result, [*parts, str(store.folder)])
    if not as_json:
        text = f"{run_now} runs in {progress.wall_s:.1f} s, {rounded(progress.rate)} runs/s"
        click.echo(text, err=True)


def _rerun(
    store: Store, run: int, options: dict[str, Any], folder: Path | None, as_json: bool
) -> None:
    from rrins.host_tools.campaigns.rerun import rerun
    from rrins.host_tools.runs.display import RunDisplay
    from rrins.host_tools.runs.results.summary import lines_of, table_of
    from rrins.host_tools.terminal import new_console

    console = new_console(stderr=True)
    again = rerun(
        store,
        run,
        lambda scenario: RunDisplay(scenario, console),
        options["on_bus"],
        options["record"],
        folder,
    )
    summary = again.result.summary
    parts: list[Table | str] = [table_of(summary), *lines_of(summary)]
    if again.is_same is not None:
        parts.append("as in the table of runs, to the bit" if again.is_same else _NOT_SAME)
    more = {"run": run, "folder": str(again.folder), "same_as_row": again.is_same}
    print_results(as_json, {**summary, **more}, [*parts, str(again.folder)])
