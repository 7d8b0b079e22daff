"""`rrins campaign FOLDER`: report, sensitivity and comparison of stored runs."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from rrins.host_tools.campaigns import report, sensitivity
from rrins.host_tools.campaigns.comparison import Comparison, compare
from rrins.host_tools.campaigns.row import MAIN
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import interval, shown, value, with_interval
from rrins.host_tools.cli.output import print_results
from rrins.host_tools.rounding import rounded
from rrins.host_tools.terminal import new_table

_COMPARED = (MAIN, "max_horizontal_error_m", "rms_horizontal_error_m")
_CHANCE = 0.05


def write_report(store: Store, out: Path | None, as_json: bool) -> None:
    """Write the report of what is stored; print where it is."""
    paths = [str(path) for path in report.write(store, out)]
    print_results(as_json, {"report": paths[0], "pictures": paths[1:]}, paths)


def show_sensitivity(store: Store, as_json: bool) -> None:
    """Print which input matters how much."""
    shares = {name: sensitivity.linear_shares(store, name) for name in sensitivity.LINEAR_OUTPUTS}
    is_saltelli = store.definition.design == "saltelli"
    indices = sensitivity.sobol_indices(store, MAIN) if is_saltelli else []
    linear = {
        name: [
            {"input": one.name, "share": one.share.values(), "sigma": one.sigma} for one in found
        ]
        for name, found in shares.items()
    }
    sobol = [
        {"input": one.name, "first": one.first.values(), "total": one.total.values()}
        for one in indices
    ]
    parts: list[Table | str] = []
    for name, found in shares.items():
        table = new_table(f"Linear shares in the variance of {name}", "input", "share", "alone, σ")
        for one in found:
            table.add_row(one.name, on_one_line(one.share), shown(one.sigma))
        parts.append(table if found else f"{name}: too few runs, or nothing varies")
    if indices:
        table = new_table(f"Sobol's indices of {MAIN}", "input", "alone", "with interactions")
        for index in indices:
            table.add_row(index.name, on_one_line(index.first), on_one_line(index.total))
        parts.append(table)
    print_results(as_json, {"linear": linear, "sobol": sobol}, parts)


def on_one_line(one: Estimate) -> str:
    """Return a figure with its interval in brackets."""
    return f"{value(one)} ({interval(one) or '–'})"


def show_comparison(first: Store, other: Path, as_json: bool) -> None:
    """Print how two campaigns differ."""
    second = Store.open(other)
    found = [compare(first, second, name) for name in _COMPARED]
    names = {"first": str(first.folder), "second": str(second.folder)}
    title = f"{first.folder}, {second.folder}"
    table = new_table(title, "", "first", "second", "second / first", show_lines=True)
    for one in found:
        for percent in one.ratio:
            cells = (one.first[percent], one.second[percent], one.ratio[percent])
            table.add_row(f"{percent} of {one.output}", *(with_interval(cell) for cell in cells))
    result = names | {"outputs": [one.values() for one in found]}
    print_results(as_json, result, [table, *map(_verdict, found)])


def _verdict(one: Comparison) -> str:
    how = "Wilcoxon, pairs of one seed" if one.is_paired else "Mann-Whitney"
    differ = one.p_value < _CHANCE
    words = "differ" if differ else "may be the same: the difference may be chance"
    chance = f"p = {rounded(one.p_value, 2)}" if one.p_value >= 1e-4 else "p < 0.0001"
    runs = f"{one.runs[0]} and {one.runs[1]} runs"
    return f"{one.output}: the campaigns {words} ({chance}, {how}, {runs})"
