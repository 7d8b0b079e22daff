"""`rrins campaign`: thousands of runs, and what they come to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import json_option

if TYPE_CHECKING:
    from rrins.host_tools.campaigns.definition import Wishes
    from rrins.host_tools.campaigns.store import Store
    from rrins.host_tools.campaigns.until import Until


_NOT_SAME = "NOT as in the table of runs: other sources, libraries or another processor made that"


@click.command()
@click.argument("source")
@click.argument("action", nargs=-1, metavar="[rerun RUN|report|sensitivity|compare FOLDER]")
@click.option("--runs", type=click.IntRange(1, 100_000_000), help="Number of runs.  [default: 100]")
@click.option("--seed", type=click.IntRange(0), help="Root seed of all draws.  [default: 1]")
@click.option(
    "--vary",
    metavar="'KEY=DISTRIBUTION'",
    multiple=True,
    help="Draw a key of the scenario from this distribution; repeatable.",
)
@click.option("--set", "fixed", metavar="KEY=VALUE", multiple=True, help="Set a key in all runs.")
@click.option(
    "--fault",
    "faults",
    metavar="'KEY=VALUE, …'",
    multiple=True,
    help="Fault in every run; values may be distributions; `size` fits every kind of fault.",
)
@click.option(
    "--correlate", metavar="'KEY, KEY = ρ'", multiple=True, help="Correlation of two inputs."
)
@click.option(
    "--design",
    type=click.Choice(["random", "lhs", "sobol", "saltelli", "grid", "one-at-a-time"]),
    help="Design of the sample.  [default: random]",
)
@click.option(
    "--duration",
    "duration_s",
    type=NumberRange(0, min_open=True),
    help="Navigate for this many seconds.",
)
@click.option(
    "--until",
    metavar="CRITERION",
    help='Stop early, e.g. at "p95 of horizontal_error_m within 10 %".',
)
@click.option(
    "--workers",
    metavar="N|ADDRESS",
    help="Number of workers, or a Dask scheduler.  [default: processors]",
)
@click.option(
    "--engine", type=click.Choice(["threads", "processes", "dask"]), help="Kind of workers."
)
@click.option(
    "--scheduler-file", type=click.Path(path_type=Path), help="Scheduler file written by Dask."
)
@click.option(
    "--silence",
    "silence_s",
    type=NumberRange(1, 1e6),
    default=600,
    show_default=True,
    help="Give up after this many seconds without a result.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the campaign.  [default: out/campaigns/NAME]",
)
@click.option("--bus", "on_bus", is_flag=True, help="rerun: use two processes on the embedded bus.")
@click.option(
    "--record",
    type=click.Path(dir_okay=False, path_type=Path),
    help="rerun: record the bus to this file.",
)
@json_option
def campaign(
    source: str,
    action: tuple[str, ...],
    fixed: tuple[str, ...],
    vary: tuple[str, ...],
    faults: tuple[str, ...],
    correlate: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    **options: Any,
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
    if is_campaign(folder):
        _refuse_changes(fixed, vary, faults, correlate, options)
        store = Store.open(folder)
        if options["runs"] is not None:
            store = Store(folder, store.definition.with_runs(options["runs"]))
    else:
        store = _new_store(source, fixed, vary, faults, correlate, out, options)
    if not action:
        _run(store, options, as_json)
        return
    if len(action) == 2 and action[0] == "rerun" and action[1].isdecimal():
        _rerun(store, int(action[1]), options, out if is_campaign(folder) else None, as_json)
        return
    from rrins.host_tools.cli import campaign_actions as actions

    match action:
        case ("report",):
            actions.write_report(store, out if is_campaign(folder) else None, as_json)
        case ("sensitivity",):
            actions.show_sensitivity(store, as_json)
        case ("compare", other):
            actions.show_comparison(store, Path(other), as_json)
        case _:
            known = "`rerun RUN`, `report`, `sensitivity` and `compare FOLDER`"
            raise click.UsageError(f"{' '.join(action)!r}: behind SOURCE there are {known}.")


def _refuse_changes(*options: Any) -> None:
    """Refuse options that would make another campaign of one that is stored."""
    *many, named = options
    changed = any(many) or any(named[key] is not None for key in ("seed", "design", "duration_s"))
    if changed:
        raise click.UsageError("A stored campaign goes on as it is; name a scenario or its file.")


def _new_store(
    source: str,
    fixed: tuple[str, ...],
    vary: tuple[str, ...],
    faults: tuple[str, ...],
    correlate: tuple[str, ...],
    out: Path | None,
    options: dict[str, Any],
) -> Store:
    from rrins.host_tools.campaigns.definition import load
    from rrins.host_tools.campaigns.store import Store

    definition = load(source, _wishes(fixed, vary, faults, correlate, options))
    folder = out if out is not None else Path("out/campaigns") / definition.name
    return Store(folder, definition)


def _wishes(
    fixed: tuple[str, ...],
    vary: tuple[str, ...],
    faults: tuple[str, ...],
    correlate: tuple[str, ...],
    options: dict[str, Any],
) -> Wishes:
    from rrins.host_tools.campaigns import words
    from rrins.host_tools.campaigns.definition import Wishes

    return Wishes(
        runs=options["runs"],
        seed=options["seed"],
        design=options["design"],
        duration_s=options["duration_s"],
        set=words.settings_of(fixed),
        vary=words.variations_of(vary),
        correlate=[words.correlation_of(text) for text in correlate],
        faults=[words.fault_of(text) for text in faults],
    )


def _until(options: dict[str, Any]) -> Until | None:
    from rrins.host_tools.campaigns.until import Until

    return None if options["until"] is None else Until.parse(options["until"])


def _run(store: Store, options: dict[str, Any], as_json: bool) -> None:
    from rrins.host_tools.campaigns import running, summary
    from rrins.host_tools.campaigns.conduct import Progress
    from rrins.host_tools.campaigns.store import Store
    from rrins.host_tools.interruption import as_event
    from rrins.host_tools.terminal import new_console, print_table, progress_line

    until = _until(options)
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
            state = [f"{progress.stored} of {progress.planned}", f"{progress.rate:.3g} runs/s"]
            if figures is not None:
                state.append("p50 {} p95 {}{}".format(*map(summary.shown, figures), unit))
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
    if as_json:
        speed = {"run_now": run_now, "wall_s": progress.wall_s, "runs_per_s": progress.rate}
        lost = {"lost_chunks": progress.lost}
        click.echo(json.dumps(summary.values_of(store) | speed | lost))
        return
    shown = new_console()
    print_table(summary.table_of(store), shown)
    for text in summary.lines_of(store):
        shown.print(text, highlight=False, soft_wrap=True)
    if store.stopped_at is not None and until is not None:
        text = f"{until.text}: after {store.stopped_at} runs"
        shown.print(text, highlight=False, soft_wrap=True)
    shown.print(str(store.folder), highlight=False, soft_wrap=True)
    text = f"{run_now} runs in {progress.wall_s:.1f} s, {progress.rate:.3g} runs/s"
    console.print(text, highlight=False, soft_wrap=True)


def _rerun(
    store: Store, run: int, options: dict[str, Any], folder: Path | None, as_json: bool
) -> None:
    from rrins.host_tools.campaigns.rerun import rerun
    from rrins.host_tools.runs.display import RunDisplay
    from rrins.host_tools.runs.results.summary import lines_of, table_of
    from rrins.host_tools.terminal import new_console, print_table

    console = new_console(stderr=True)
    again = rerun(
        store,
        run,
        lambda scenario: RunDisplay(scenario, console),
        options["on_bus"],
        options["record"],
        folder,
    )
    if as_json:
        more = {"run": run, "folder": str(again.folder), "same_as_row": again.is_same}
        click.echo(json.dumps(again.result.summary | more))
        return
    shown = new_console()
    print_table(table_of(again.result.summary), shown)
    lines = lines_of(again.result.summary)
    if again.is_same is not None:
        lines.append("as in the table of runs, to the bit" if again.is_same else _NOT_SAME)
    for text in (*lines, str(again.folder)):
        shown.print(text, highlight=False, soft_wrap=True)
