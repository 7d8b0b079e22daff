"""`rrins allocate`: the tolerances of least cost that meet a requirement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.options import (
    FOLDER,
    duration_option,
    json_option,
    option,
    workers_option,
)
from rrins.host_tools.cli.output import counting, print_results, stepping, stopping

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.campaigns.allocation import Allocation
    from rrins.host_tools.campaigns.least_cost import Combination, Problem
    from rrins.host_tools.campaigns.store import Store


@click.command()
@click.argument("source")
@duration_option
@option("--confirm runs", "Run a campaign of so many units.", click.IntRange(20, 1_000_000))
@workers_option
@option("--out", "Folder of that campaign.  [default: out/allocated/NAME]", FOLDER)
@option("--front", "Folder for cost against error, as picture and CSV.", FOLDER)
@json_option
def allocate(
    source: str,
    duration_s: float | None,
    runs: int | None,
    workers: int | None,
    out: Path | None,
    front: Path | None,
    as_json: bool,
) -> None:
    """Find the tolerances of least cost that meet a requirement.

    SOURCE is a campaign's TOML file with a table [allocate]: the requirement, for each tolerance
    its cost and limits, and choices such as schemes or geometries with theirs. The linear
    covariance analysis tells what each contributes; --confirm checks the result with runs.
    """
    from rrins.host_tools.campaigns.allocation import confirmed
    from rrins.host_tools.campaigns.definition import Wishes
    from rrins.host_tools.campaigns.least_cost import best, problems
    from rrins.host_tools.campaigns.store import Store
    from rrins.host_tools.campaigns.summary import interval, shown, value

    candidates = problems(source, Wishes(duration_s=duration_s), _counted)
    paths = [] if front is None else _front(candidates, front)
    found = best(candidates)
    requirement = found.requirement
    lines = [
        f"p{requirement.percent:g} of the horizontal error after "
        f"{found.definition.scenario.duration_s:g} s: {shown(found.predicted_m)} m predicted, "
        f"{shown(requirement.limit_m)} m required"
    ]
    result = found.values()
    if runs is not None:
        folder = out if out is not None else Path("out/allocated") / found.definition.name
        store = Store.create(folder, found.definition.with_runs(runs))
        _run(store, workers)
        measured = confirmed(store, requirement)
        lines.append(f"{runs} runs: {value(measured)} m ({interval(measured)})")
        lines += [found.verdict(measured), str(folder)]
        result |= {"runs": runs, "measured_m": measured.values(), "folder": str(folder)}
    tables = [_choices(candidates), _table(found)] if found.choices else [_table(found)]
    if front is not None:
        result["files"] = paths
    print_results(as_json, result, [*tables, *lines, *paths])


def _counted(combinations: list[Combination]) -> Iterator[Combination]:
    with stepping("combinations", len(combinations)) as step:
        for one in combinations:
            yield one
            step()


def _front(candidates: Sequence[Problem], folder: Path) -> list[str]:
    from rrins.host_tools.campaigns import front

    return [str(path) for path in front.write(candidates, front.front(candidates), folder)]


def _run(store: Store, workers: int | None) -> None:
    from rrins.host_tools.campaigns import running

    with stopping() as stop, counting("campaign", store.definition.runs) as on_progress:
        running.run(
            store,
            running.Workers.of(workers),
            on_progress=lambda progress: on_progress(progress.stored),
            stop=stop,
        )


def _choices(candidates: Sequence[Problem]) -> Table:
    from rrins.host_tools.campaigns.least_cost import InfeasibleError
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.terminal import new_table

    percent = candidates[0].requirement.percent
    table = new_table("Choices", *candidates[0].choices, "least cost", f"p{percent:g} / m")
    for one in candidates:
        values = map(str, one.choices.values())
        try:
            sigmas = one.solve()
        except InfeasibleError as error:
            table.add_row(*values, "not for any", f"{shown(error.best_m)} at best")
        else:
            table.add_row(*values, shown(one.cost(sigmas)), shown(one.percentile(sigmas)))
    return table


def _table(found: Allocation) -> Table:
    from rrins.host_tools.campaigns.front import words
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.terminal import new_table

    heads = ("tolerance, 1 σ of a sensor", "σ", "cost", "share of the variance", "at its limit")
    table = new_table("Tolerances of least cost", *heads)
    if found.choices:
        table.add_row(words(found.choices), "", shown(found.base), "", "")
        table.add_section()
    for one in found.chosen:
        table.add_row(one.key, shown(one.sigma), shown(one.cost), f"{one.share:.1%}", one.limit)
    table.add_section()
    table.add_row("all else", "", "", f"{found.other_share:.1%}", "")
    table.add_row("all", "", shown(found.cost), "100.0%", "")
    return table
