"""What `rrins campaign FOLDER` does with runs that are stored: report, sensitivity, comparison."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.table import Table

from rrins.host_tools.campaigns import report, sensitivity
from rrins.host_tools.campaigns.comparison import compare
from rrins.host_tools.campaigns.row import MAIN
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import shown, with_interval
from rrins.host_tools.terminal import new_console, print_table

_COMPARED = (MAIN, "max_horizontal_error_m", "rms_horizontal_error_m")
_CHANCE = 0.05


def write_report(store: Store, out: Path | None, as_json: bool) -> None:
    """Write the report of what is stored; print where it is."""
    paths = report.write(store, out)
    if as_json:
        click.echo(json.dumps({"report": str(paths[0]), "pictures": [str(p) for p in paths[1:]]}))
        return
    for path in paths:
        click.echo(path)


def show_sensitivity(store: Store, as_json: bool) -> None:
    """Print which input matters how much."""
    shares = {name: sensitivity.linear_shares(store, name) for name in sensitivity.LINEAR_OUTPUTS}
    is_saltelli = store.definition.design == "saltelli"
    indices = sensitivity.sobol_indices(store, MAIN) if is_saltelli else []
    if as_json:
        linear = {
            name: [
                {"input": one.name, "share": one.share.values(), "sigma": one.sigma}
                for one in found
            ]
            for name, found in shares.items()
        }
        sobol = [
            {"input": one.name, "first": one.first.values(), "total": one.total.values()}
            for one in indices
        ]
        click.echo(json.dumps({"linear": linear, "sobol": sobol}))
        return
    console = new_console()
    for name, found in shares.items():
        table = Table(title=f"Linear shares in the variance of {name}", title_justify="left")
        table.add_column("input", no_wrap=True)
        table.add_column("share", justify="right")
        table.add_column("alone, σ", justify="right")
        for one in found:
            table.add_row(one.name, on_one_line(one.share), shown(one.sigma))
        if found:
            print_table(table, console)
        else:
            console.print(f"{name}: too few runs, or nothing varies", highlight=False)
    if indices:
        table = Table(title=f"Sobol's indices of {MAIN}", title_justify="left")
        table.add_column("input", no_wrap=True)
        table.add_column("alone", justify="right")
        table.add_column("with interactions", justify="right")
        for index in indices:
            table.add_row(index.name, on_one_line(index.first), on_one_line(index.total))
        print_table(table, console)


def on_one_line(one: Estimate) -> str:
    """Return a figure with its interval in brackets."""
    return f"{shown(one.value)} ({shown(one.low)} … {shown(one.high)})"


def show_comparison(first: Store, other: Path, as_json: bool) -> None:
    """Print how two campaigns differ."""
    second = Store.open(other)
    found = [compare(first, second, name) for name in _COMPARED]
    if as_json:
        folders = {"first": str(first.folder), "second": str(second.folder)}
        click.echo(json.dumps(folders | {"outputs": [one.values() for one in found]}))
        return
    table = Table(title=f"{first.folder}, {second.folder}", title_justify="left", show_lines=True)
    table.add_column("", no_wrap=True)
    for name in ("first", "second", "second / first"):
        table.add_column(name, justify="right")
    for one in found:
        for percent in one.ratio:
            cells = (one.first[percent], one.second[percent], one.ratio[percent])
            table.add_row(f"{percent} of {one.output}", *(with_interval(cell) for cell in cells))
    console = new_console()
    print_table(table, console)
    for one in found:
        how = "Wilcoxon, pairs of one seed" if one.is_paired else "Mann-Whitney"
        words = (
            "differ" if one.p_value < _CHANCE else "may be the same: the difference may be chance"
        )
        console.print(
            f"{one.output}: the campaigns {words} ({_probability(one.p_value)}, {how}, "
            f"{one.runs[0]} and {one.runs[1]} runs)",
            highlight=False,
            soft_wrap=True,
        )


def _probability(value: float) -> str:
    return f"p = {value:.2g}" if value >= 1e-4 else "p < 0.0001"
