"""`rrins allocate`: the tolerances of least cost that meet a requirement."""

from __future__ import annotations

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
from rrins.host_tools.cli.output import counting, print_results, stopping

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.campaigns.allocation import Allocation
    from rrins.host_tools.campaigns.store import Store


@click.command()
@click.argument("source")
@duration_option
@option("--confirm runs", "Run a campaign of so many units.", click.IntRange(20, 1_000_000))
@workers_option
@option("--out", "Folder of that campaign.  [default: out/allocated/NAME]", FOLDER)
@json_option
def allocate(
    source: str,
    duration_s: float | None,
    runs: int | None,
    workers: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find the tolerances of least cost that meet a requirement.

    SOURCE is a campaign's TOML file with a table [allocate]: the requirement, and for each
    tolerance its cost and limits. The linear covariance analysis tells what each contributes;
    --confirm checks the result with runs.
    """
    from rrins.host_tools.campaigns.allocation import allocate as allocated
    from rrins.host_tools.campaigns.allocation import confirmed
    from rrins.host_tools.campaigns.definition import Wishes
    from rrins.host_tools.campaigns.store import Store
    from rrins.host_tools.campaigns.summary import interval, shown, value

    found = allocated(source, Wishes(duration_s=duration_s))
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
    print_results(as_json, result, [_table(found), *lines])


def _run(store: Store, workers: int | None) -> None:
    from rrins.host_tools.campaigns import running

    with stopping() as stop, counting("campaign", store.definition.runs) as on_progress:
        running.run(
            store,
            running.Workers.of(workers),
            on_progress=lambda progress: on_progress(progress.stored),
            stop=stop,
        )


def _table(found: Allocation) -> Table:
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.terminal import new_table

    heads = ("tolerance, 1 σ of a sensor", "σ", "cost", "share of the variance", "at its limit")
    table = new_table("Tolerances of least cost", *heads)
    for one in found.chosen:
        table.add_row(one.key, shown(one.sigma), shown(one.cost), f"{one.share:.1%}", one.limit)
    table.add_section()
    table.add_row("all else", "", "", f"{found.other_share:.1%}", "")
    table.add_row("all", "", shown(found.cost), "100.0%", "")
    return table
