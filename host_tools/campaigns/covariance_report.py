"""A covariance analysis beside the runs of a campaign, as a table and a picture."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from rrins.host_tools.campaigns.definition import Definition, Wishes, load
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import Outcomes, shown, with_interval
from rrins.host_tools.covariance.analysis import QUANTITIES, Analysis, analyse
from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.files import JsonObject, make_folder, write_whole
from rrins.host_tools.rounding import labelled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrins.compiled.record import Floats

_COLUMNS = ("position_east_m", "position_north_m")
_SIDES = ("east", "north")
_MOST_SOURCES = 5
_TRUE_TABLES = ("gyros", "accelerometers", "thermal", "gnss", "odometer", "altimeter")
_WORDS = {
    "position_east_m": ("position, east", "m"),
    "position_north_m": ("position, north", "m"),
    "height_m": ("height", "m"),
    "velocity_east_mps": ("velocity, east", "m/s"),
    "velocity_north_mps": ("velocity, north", "m/s"),
    "velocity_up_mps": ("velocity, up", "m/s"),
    "tilt_east_arcsec": ("tilt about east", "″"),
    "tilt_north_arcsec": ("tilt about north", "″"),
    "heading_arcsec": ("heading", "″"),
}
"""Names and units of the quantities, as tables and pictures show them."""

_TOO_SURE, _TOO_UNSURE = 1.1, 1 / 1.1
"""Ratio of true to told σ beyond which a filter is called over- or under-confident."""


@dataclass(frozen=True)
class Beside:
    """σ of the runs of a campaign.

    Attributes
    ----------
    east, north : Estimate
        m.
    """

    runs: int
    east: Estimate
    north: Estimate
    times_s: Floats  #: shape (n,)
    sigma: Floats  #: shape (n, 2); over time, m

    def values(self) -> JsonObject:
        """Return it as plain values."""
        pair = {"east_m": self.east.values(), "north_m": self.north.values()}
        return {"runs": self.runs} | pair

    def cells(self) -> list[str]:
        """Return its row of the table."""
        pair = map(with_interval, self.both)
        return [f"{self.runs} runs, 95 % interval", *pair, shown(float(self.sigma.max())), ""]

    @property
    def both(self) -> tuple[Estimate, Estimate]:
        """East and north."""
        return self.east, self.north

    def agrees(self, analysis: Analysis) -> bool:
        """Return whether the analysis lies in the intervals of the runs."""
        pairs = zip(self.both, analysis.sigma[-1], strict=True)
        return all(one.low <= value <= one.high for one, value in pairs)

    def words(self, analysis: Analysis) -> str:
        """Return whether they agree, as a line."""
        verb = "lies" if self.agrees(analysis) else "does NOT lie"
        return f"the analysis {verb} in the intervals of the {self.runs} runs"


def analysis_of(definition: Definition, true: Mapping[str, Any] | None = None) -> Analysis:
    """Return the analysis of a campaign's scenario.

    Parameters
    ----------
    definition : Definition
    true : mapping, optional
        Keys of sensors and aids as they are, where the scenario has what the firmware's filter is
        told of them.

    Raises
    ------
    CampaignError
        When one of the keys is another's.
    RehearsalError
        When the analysis does not cover the scenario.
    """
    scenario = definition.scenario
    if not true:
        return analyse(scenario, definition.varied())
    for key in true:
        if key.partition(".")[0] not in _TRUE_TABLES:
            raise CampaignError(f"--true {key}: is for keys of {', '.join(_TRUE_TABLES)}")
    return analyse(scenario, definition.varied(), load(scenario, Wishes(set=true)).scenario)


def quantity_rows(analysis: Analysis) -> list[list[str]]:
    """Return a row for each quantity: σ at the end, the filter's, their ratio and its limits.

    Of an analysis with a filter.
    """
    rows = []
    for name, found in analysis.told().items():
        words, unit = _WORDS[name]
        figures = [shown(found[key]) for key in ("sigma", "filter_sigma", "ratio")]
        limits = " … ".join(shown(found[key]) for key in ("least_ratio", "largest_ratio"))
        rows.append([labelled(words, unit), *figures, limits])
    return rows


def confidence(analysis: Analysis) -> str:
    """Return where the filter believes too much or too little of itself at the end, as a line."""
    if analysis.filter_sigmas is None:
        return ""
    ratios = {
        _WORDS[name][0].replace(",", ""): found["ratio"] for name, found in analysis.told().items()
    }
    sure = [name for name, ratio in ratios.items() if ratio is not None and ratio > _TOO_SURE]
    unsure = [name for name, ratio in ratios.items() if ratio is not None and ratio < _TOO_UNSURE]
    lines = [
        f"{word} in {'all' if len(names) == len(ratios) else ', '.join(names)}"
        for word, names in (("over-confident", sure), ("under-confident", unsure))
        if names
    ]
    return "the filter at the end: " + ("; ".join(lines) or "its σ is within 10 % of the true one")


def beside_runs(store: Store) -> Beside:
    """Return σ of a campaign's runs.

    Raises
    ------
    CampaignError
        When they are too few.
    """
    from rrins.host_tools.campaigns.pictures import series_of

    outcomes = Outcomes(store, _COLUMNS)
    east, north = (outcomes.sample(name).sigma() for name in _COLUMNS)
    if not np.isfinite(east.half_width):
        raise CampaignError(f"{store.folder}: {len(outcomes[_COLUMNS[0]])} runs are too few")
    times, *pair = series_of(store)
    spread = np.column_stack([np.nanstd(one, axis=0, ddof=1) for one in pair])
    return Beside(len(outcomes[_COLUMNS[0]]), east, north, times, spread)


def write(analysis: Analysis, folder: Path, beside: Beside | None = None) -> list[Path]:
    """Write σ over time as a table and a picture into a folder; return their paths.

    Raises
    ------
    RehearsalError
        When they cannot be written.
    """
    make_folder(folder)
    write_whole(folder / "covariance.csv", lambda file: _write_rows(file, analysis))
    drawn = {"covariance": draw(analysis, beside)}
    if analysis.filter_sigmas is not None:
        drawn["covariance_filter"] = draw_filter(analysis)
    return [folder / "covariance.csv", *write_pictures(folder, drawn)]


def _write_rows(file: IO[str], analysis: Analysis) -> None:
    writer = csv.writer(file)
    names = ["all", *(one.name for one in analysis.sources)]
    pairs = {name: analysis.quantity(name) for name in list(QUANTITIES)[2:]}
    quantities = {name: true for name, (true, _) in pairs.items() if true.any()}
    for name in QUANTITIES if analysis.filter_sigmas is not None else ():
        told = analysis.quantity(name)[1]
        if told is not None and told.any():
            quantities[f"filter: {name}"] = told
    heads = [f"{name}, {side} / m" for name in names for side in _SIDES]
    writer.writerow(["time_s", *heads, *quantities])
    columns = [analysis.sigma, *(one.sigma for one in analysis.sources)]
    table = np.hstack([*columns, *(one[:, None] for one in quantities.values())])
    for time_s, row in zip(analysis.times_s, table, strict=True):
        writer.writerow([f"{time_s:g}", *(f"{value:.6g}" for value in row)])


def draw(analysis: Analysis, beside: Beside | None = None) -> Figure:
    """Draw σ over time: of all, of the largest sources, and of the runs."""
    from rrins.host_tools.campaigns.labels import words_of
    from rrins.host_tools.drawing.style import LINES, finish, new_figure, time_axis

    source_lines = [line for line in LINES if line["color"] != "#000000"]
    figure = new_figure(8.0, 6.0)
    panels = figure.subplots(2, 1, sharex=True)
    for side, axes in enumerate(panels):
        axes.plot(
            analysis.times_s, analysis.sigma[:, side], "k-", lw=1.6, label="analysis: all sources"
        )
        if beside is not None:
            label = f"{beside.runs} runs"
            axes.plot(beside.times_s, beside.sigma[:, side], "ko", ms=4, mfc="white", label=label)
        for one, line in zip(analysis.sources[:_MOST_SOURCES], source_lines, strict=False):
            axes.plot(analysis.times_s, one.sigma[:, side], **line, label=words_of(one.name))
        finish(axes, f"σ of the position, {_SIDES[side]}\n/ m")
        axes.set_ylim(bottom=0)
    lines, names = panels[0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside upper left", ncols=2, frameon=False, fontsize="small")
    time_axis(panels[1])
    return figure


_PANELS = (
    ("position, horizontal", "m", ("position_east_m", "position_north_m")),
    ("height", "m", ("height_m",)),
    ("velocity, horizontal", "m/s", ("velocity_east_mps", "velocity_north_mps")),
    ("velocity, up", "m/s", ("velocity_up_mps",)),
    ("tilt", "″", ("tilt_east_arcsec", "tilt_north_arcsec")),
    ("heading", "″", ("heading_arcsec",)),
)
"""Panels of the filter's picture: what, unit, and quantities whose squares are summed."""


def draw_filter(analysis: Analysis) -> Figure:
    """Draw σ over time as it is and as the filter has it, and below the ratio of both."""
    from rrins.host_tools.drawing.style import (
        EAST,
        LINES,
        finish,
        new_figure,
        quantity,
        time_axis,
    )

    figure = new_figure(8.0, 9.0)
    grid = figure.add_gridspec(4, 2)
    ratio_axes = figure.add_subplot(grid[3, :])
    styles = iter(LINES)  # one for each panel
    for number, (words, unit, names) in enumerate(_PANELS):
        axes = figure.add_subplot(grid[number // 2, number % 2], sharex=ratio_axes)
        axes.tick_params(labelbottom=number >= len(_PANELS) - 2)  # the ratio's axis is wider
        pairs = [analysis.quantity(name) for name in names]
        true = np.sqrt(sum((one**2 for one, _ in pairs), np.zeros(len(analysis.times_s))))
        told = np.sqrt(sum((one**2 for _, one in pairs if one is not None), np.zeros(len(true))))
        axes.plot(analysis.times_s, true, "k-", lw=1.6, label="σ of the true errors")
        axes.plot(
            analysis.times_s, told, **EAST | {"linestyle": (0, (5, 2))}, label="the filter's σ"
        )
        finish(axes, quantity(f"σ of the {words}", unit))
        axes.set_ylim(bottom=0)
        if told.any():
            share = np.divide(true, told, out=np.full(len(true), np.nan), where=told > 0)
            ratio_axes.plot(analysis.times_s, share, **next(styles), label=words)
    ratio_axes.axhline(1.0, color="0.6", lw=0.8)
    finish(ratio_axes, "true σ / filter's σ")
    time_axis(ratio_axes)
    lines, labels = figure.axes[1].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper left", ncols=2, frameon=False, fontsize="small")
    ratio_axes.legend(ncols=3, frameon=False, fontsize="small")
    return figure
