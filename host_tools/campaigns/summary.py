"""Results of a campaign: the number of runs, and figures of its outputs with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from rich.table import Table

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.row import MAIN, OK
from rrins.host_tools.campaigns.statistics import (
    CONFIDENCE,
    NOTHING,
    PERCENTILES,
    Estimate,
    Sample,
    fewest_runs,
)
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.tail import far_percentile
from rrins.host_tools.campaigns.until import OF_LOOKS
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import limits, rounded

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
        runs = table["run"].to_numpy().astype(np.int64)[self.is_ok]
        self._blocks = store.definition.plan.blocks(runs)
        self._confidence = CONFIDENCE if store.stopped_at is None else OF_LOOKS
        self._columns: dict[str, Floats] = {
            name: table[name].to_numpy().astype(float)[self.is_ok] for name in columns
        }

    @property
    def failed(self) -> int:
        """Runs that did not come to their end."""
        return int(self.stored - self.is_ok.sum())

    def __getitem__(self, column: str) -> Floats:
        return self._columns[column]

    @property
    def has_blocks(self) -> bool:
        """Whether runs of a block have noise in common."""
        return self._blocks is not None

    def sample(self, column: str) -> Sample:
        """Return a column, for its figures."""
        return Sample(self[column], self._blocks, self._confidence)

    def known(self) -> list[str]:
        """Return the columns that have a value and are not 0 in all runs."""
        return [
            name
            for name, values in self._columns.items()
            if np.isfinite(values).any() and np.nanmax(np.abs(values)) > 0.0
        ]


def figures_of(sample: Sample) -> dict[str, Estimate]:
    """Return mean, standard deviation and percentiles of a column."""
    named = {f"p{percent:g}": sample.percentile(percent) for percent in PERCENTILES}
    return {"mean": sample.mean(), "sigma": sample.sigma()} | named


def shown_figures(sample: Sample) -> tuple[Estimate, ...]:
    """Return what tables show of a column: mean, standard deviation, median, 95th percentile."""
    return sample.mean(), sample.sigma(), sample.percentile(50.0), sample.percentile(95.0)


def circles(outcomes: Outcomes) -> dict[str, Estimate]:
    """Return CEP50 and R95, m: radii about the truth that 50 and 95 % of the runs end within."""
    radial = outcomes.sample(MAIN)
    return {"cep50_m": radial.percentile(50.0), "r95_m": radial.percentile(95.0)}


def far(outcomes: Outcomes, output: str = MAIN, percent: float = 99.9) -> Estimate:
    """Return a percentile by a fitted tail; nothing for blocks, whose runs are not independent."""
    return NOTHING if outcomes.has_blocks else far_percentile(outcomes[output], percent)


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
            name: {key: one.values() for key, one in figures_of(outcomes.sample(name)).items()}
            for name in outcomes.known()
        },
        "circles": {name: one.values() for name, one in circles(outcomes).items()},
        "r999_m": far(outcomes).values(),
        "r95_bound_m": bound if np.isfinite(bound := outcomes.sample(MAIN).bound(95.0)) else None,
    }


def reasons(store: Store) -> dict[str, int]:
    """Return why runs did not come to their end, and how many for each reason."""
    found: dict[str, int] = {}
    for text in store.table(["error"])["error"].to_pylist():
        if text is not None:
            found[text] = found.get(text, 0) + 1
    return dict(sorted(found.items(), key=lambda item: -item[1]))


shown: Final = rounded
"""A figure as tables have it."""


def value(one: Estimate) -> str:
    """Return a figure, with the digits that its interval warrants."""
    return limits(one.value, one.low, one.high)[0]


def interval(one: Estimate) -> str:
    """Return the ends of an interval, of which runs may be too few for one or both."""
    _, low, high = limits(one.value, one.low, one.high)
    if low:
        return f"{low} … {high}"
    sides = ((one.low, "≥"), (one.high, "≤"))
    return next((f"{sign} {shown(end)}" for end, sign in sides if np.isfinite(end)), "")


def with_interval(one: Estimate) -> str:
    """Return a figure and its interval."""
    return f"{value(one)}\n{interval(one)}".rstrip()


def table_of(store: Store) -> Table:
    """Return the table that a person sees at the end."""
    outcomes = Outcomes(store)
    title = store.definition.title or store.definition.name
    table = Table(title=f"{title}: {outcomes.stored} runs", title_justify="left", show_lines=True)
    table.add_column("at the end, with 95 % interval", no_wrap=True)
    for name in ("mean", "σ", "median", "p95"):
        table.add_column(name, justify="right")
    for name in outcomes.known():
        table.add_row(name, *map(with_interval, shown_figures(outcomes.sample(name))))
    return table


def bound_of(outcomes: Outcomes) -> str:
    """Return the bound of R95 as a sentence."""
    bound = outcomes.sample(MAIN).bound(95.0)
    unit = "blocks" if outcomes.has_blocks else "runs"
    if not np.isfinite(bound):
        return f"R95: too few {unit} for an upper bound; it takes {fewest_runs(95.0, 0.05)}"
    return f"95 % of the runs end within {shown(bound)} m, with 95 % confidence (Wilks)"


def lines_of(store: Store) -> list[str]:
    """Return the lines below the table."""
    outcomes = Outcomes(store)
    lines = [
        f"{name}: {value(one)} m ({interval(one) or 'too few runs for an interval'})"
        for name, one in zip(("CEP50", "R95"), circles(outcomes).values(), strict=True)
    ]
    lines.append(bound_of(outcomes))
    tail = far(outcomes)
    if np.isfinite(tail.high):
        lines.append(
            f"1 run in 1000 ends beyond {value(tail)} m ({interval(tail)}), "
            "if the tail goes on as the largest tenth"
        )
    for text, count in list(reasons(store).items())[:5]:
        lines.append(f"{count} of {outcomes.stored} runs without an end: {text}")
    return lines
