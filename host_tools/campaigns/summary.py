"""Results of a campaign: the number of runs, and figures of its outputs with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from rich.table import Table

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.row import OK
from rrins.host_tools.campaigns.statistics import (
    PERCENTILES,
    Estimate,
    mean,
    percentile,
    sigma,
)
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.files import JsonObject
from rrins.host_tools.terminal import figure, rounded_by

SHOWN: Final = (
    "horizontal_error_m",
    "max_horizontal_error_m",
    "position_east_m",
    "position_north_m",
    "height_error_m",
    "velocity_east_mps",
    "velocity_north_mps",
    "heading_error_arcsec",
    "gyro_left_out_s",
    "accelerometer_left_out_s",
)
"""Outputs of the tables; all are in the files."""


class Outcomes:
    """The outputs of a campaign's runs that came to their end, by column.

    Parameters
    ----------
    store : Store
    columns : sequence of str
    """

    def __init__(self, store: Store, columns: Sequence[str] = SHOWN) -> None:
        names = ["status", *columns]
        table = store.table(names)
        statuses = np.array(table["status"].to_pylist(), dtype=object)
        self.stored = len(statuses)
        self.is_ok = statuses == OK
        self._columns: dict[str, Floats] = {
            name: table[name].to_numpy().astype(float)[self.is_ok] for name in columns
        }

    @property
    def failed(self) -> int:
        """Runs that did not come to their end."""
        return int(self.stored - self.is_ok.sum())

    def __getitem__(self, column: str) -> Floats:
        return self._columns[column]

    def known(self) -> list[str]:
        """Return the columns that have a value and are not 0 in all runs."""
        return [
            name
            for name, values in self._columns.items()
            if np.isfinite(values).any() and np.nanmax(np.abs(values)) > 0.0
        ]


def figures_of(values: Floats) -> dict[str, Estimate]:
    """Return mean, standard deviation and percentiles of a column."""
    named = {f"p{percent:g}": percentile(values, percent) for percent in PERCENTILES}
    return {"mean": mean(values), "sigma": sigma(values)} | named


def shown_figures(values: Floats) -> tuple[Estimate, ...]:
    """Return what tables show of a column: mean, standard deviation, median, 95th percentile."""
    return mean(values), sigma(values), percentile(values, 50.0), percentile(values, 95.0)


def circles(outcomes: Outcomes) -> dict[str, Estimate]:
    """Return CEP50 and R95, m: radii about the truth that 50 and 95 % of the runs end within."""
    radial = outcomes["horizontal_error_m"]
    return {"cep50_m": percentile(radial, 50.0), "r95_m": percentile(radial, 95.0)}


def values_of(store: Store) -> JsonObject:
    """Return the results of a campaign, as plain values."""
    outcomes = Outcomes(store)
    return {
        "folder": str(store.folder),
        "title": store.definition.title,
        "planned": store.definition.runs,
        "stopped_at": store.stopped_at,
        "stored": outcomes.stored,
        "failed": outcomes.failed,
        "errors": reasons(store),
        "figures": {
            name: {key: one.values() for key, one in figures_of(outcomes[name]).items()}
            for name in outcomes.known()
        },
        "circles": {name: one.values() for name, one in circles(outcomes).items()},
    }


def reasons(store: Store) -> dict[str, int]:
    """Return why runs did not come to their end, and how many for each reason."""
    found: dict[str, int] = {}
    for text in store.table(["error"])["error"].to_pylist():
        if text is not None:
            found[text] = found.get(text, 0) + 1
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def shown(value: float) -> str:
    """Return a figure with three digits."""
    return figure(value)


def with_interval(one: Estimate) -> str:
    """Return a figure and its interval."""
    if not np.isfinite(one.half_width):
        return shown(one.value)
    value, low, high = rounded_by(one.half_width, one.value, one.low, one.high)
    return f"{value}\n{low} … {high}"


def table_of(store: Store) -> Table:
    """Return the table that a person sees at the end."""
    outcomes = Outcomes(store)
    title = store.definition.title or store.definition.name
    table = Table(title=f"{title}: {outcomes.stored} runs", title_justify="left", show_lines=True)
    table.add_column("at the end, with 95 % interval", no_wrap=True)
    for name in ("mean", "σ", "median", "p95"):
        table.add_column(name, justify="right")
    for name in outcomes.known():
        table.add_row(name, *map(with_interval, shown_figures(outcomes[name])))
    return table


def lines_of(store: Store) -> list[str]:
    """Return the lines below the table."""
    outcomes = Outcomes(store)
    lines = [
        f"{name}: {shown(one.value)} m"
        + (
            f" ({shown(one.low)} … {shown(one.high)})"
            if np.isfinite(one.half_width)
            else " (too few runs for an interval)"
        )
        for name, one in zip(("CEP50", "R95"), circles(outcomes).values(), strict=True)
    ]
    for text, count in list(reasons(store).items())[:5]:
        lines.append(f"{count} of {outcomes.stored} runs without an end: {text}")
    return lines
