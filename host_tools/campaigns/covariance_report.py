"""A covariance analysis beside the runs of a campaign, as a table and a picture."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.statistics import Estimate
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import Outcomes, shown, with_interval
from rrins.host_tools.covariance.analysis import Analysis
from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.files import JsonObject, make_folder, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrins.compiled.record import Floats

_COLUMNS = ("position_east_m", "position_north_m")
_SIDES = ("east", "north")
_MOST_SOURCES = 5


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
    return [folder / "covariance.csv", *write_pictures(folder, drawn)]


def _write_rows(file: IO[str], analysis: Analysis) -> None:
    writer = csv.writer(file)
    names = ["all", *(one.name for one in analysis.sources)]
    writer.writerow(["time_s", *(f"{name}, {side} / m" for name in names for side in _SIDES)])
    columns = [analysis.sigma, *(one.sigma for one in analysis.sources)]
    for k, time_s in enumerate(analysis.times_s):
        cells = (f"{value:.6g}" for column in columns for value in column[k])
        writer.writerow([f"{time_s:g}", *cells])


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
