"""`rrins explain`: why the error of a run is what it is at an instant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.options import (
    DEFAULT_SCENARIO,
    NOT_NEGATIVE,
    flag,
    free_duration_option,
    json_option,
    noise_seed_option,
    option,
    results_option,
    workers_option,
)
from rrins.host_tools.cli.output import counting, print_note, print_results, stopping
from rrins.host_tools.errors import RehearsalError

if TYPE_CHECKING:
    from rrins.host_tools.scenario.scenario import Scenario

_OF = ("position", "velocity", "attitude")


@click.command()
@click.argument(
    "scenario",
    default=DEFAULT_SCENARIO,
    metavar="[SCENARIO|LOG]",
    shell_complete=complete_scenarios,
)
@option(
    "--at time_s",
    "The instant, in seconds after navigation began.",
    NOT_NEGATIVE,
    None,
    required=True,
)
@option("--of", "The error that is explained.", _OF, "position")
@option(
    "--by",
    "Parts: each sensor's errors, or all sensors of a kind together, in fewer runs.",
    ("sensor", "source"),
    "sensor",
)
@flag("--check checks", "Compare the parts with the linear error equations, too.")
@free_duration_option
@noise_seed_option
@workers_option
@results_option
@json_option
def explain(
    scenario: str,
    time_s: float,
    of: str,
    by: Literal["sensor", "source"],
    checks: bool,
    duration_s: float | None,
    seed: int | None,
    workers: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Explain an error: what each source contributes to it at an instant.

    Runs SCENARIO again in this process, twice for each source: with this source alone, and without
    it. A LOG is explained through the scenario in its note. Writes explain.csv and explain.png.
    """
    from rrins.compiled.compile_events import compiling_watched
    from rrins.host_tools.explanation import words
    from rrins.host_tools.explanation.check import check
    from rrins.host_tools.explanation.explain import explain as explain_error
    from rrins.host_tools.explanation.explain import runs_of
    from rrins.host_tools.explanation.reruns import StoppedError
    from rrins.host_tools.explanation.results import write
    from rrins.host_tools.rounding import labelled
    from rrins.host_tools.runs.run import folder_of
    from rrins.host_tools.terminal import new_table

    name, loaded = _loaded(scenario, duration_s, seed)
    folder = folder_of(out, name)
    with (
        stopping() as stop,
        counting("running", runs_of(loaded, by), as_json) as on_progress,
        compiling_watched(_say_compiling()),
    ):
        try:
            found = explain_error(loaded, time_s, by, on_progress, stop.is_set, workers or 0)
        except StoppedError:
            return
        checked = check(loaded, found) if checks else None
    title = words.headline(found, name, of)
    paths = [str(path) for path in write(found, folder, title, of)]
    unit, rows = words.table_rows(found, of)
    components = (labelled(side, unit) for side in words.COMPONENTS[of])
    table = new_table(title, "source", *components, "share")
    for number, row in enumerate(rows):
        table.add_row(*row, end_section=number == len(rows) - 2)
    lines = [f"share: of the {words.SHARE_OF[of]} error, along it; opposite ones are negative"]
    lines += [] if checked is None else checked.lines(found)
    values = found.values() | ({} if checked is None else {"check": checked.values()})
    values = {"scenario": name, "of": of} | values | {"files": paths}
    print_results(as_json, values, [table, *lines, *(f"  {path}" for path in paths)])


def _say_compiling() -> Callable[[int], None]:
    """Return what says once that code is compiled first."""
    said: list[int] = []

    def say(functions: int) -> None:
        if not said:
            print_note("compiling; later starts load what is compiled now")
        said.append(functions)

    return say


def _loaded(name: str, duration_s: float | None, seed: int | None) -> tuple[str, Scenario]:
    """Return a scenario and its name, or those of a recording.

    Raises
    ------
    RehearsalError
        When there is none, or a recording says nothing of its scenario.
    """
    from rrins.host_tools.recording.formats import READ, ending_of
    from rrins.host_tools.recording.note import read_note
    from rrins.host_tools.scenario.scenario import load

    path = Path(name)
    if ending_of(path)[0] not in READ:
        return name, load(name, duration_s=duration_s, seed=seed)
    if not path.is_file():
        raise RehearsalError(f"{path}: no such file")
    note = read_note(path)
    recorded = None if note is None else note.loaded_scenario(path)
    if note is None or recorded is None or note.origin is not None:
        raise RehearsalError(
            f"{path}: a recording that says nothing of its scenario cannot be run again; name the "
            "scenario: rrins explain SCENARIO --at T"
        )
    changes = {"duration_s": duration_s, "seed": seed}
    changed = {key: value for key, value in changes.items() if value is not None}
    return note.scenario_name or path.name, recorded.varied(**changed)
