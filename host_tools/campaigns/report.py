"""The report of a campaign: one self-contained HTML page, and its pictures beside it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rrins.host_tools.campaigns import covariance_report, sensitivity, summary
from rrins.host_tools.campaigns.covariance_report import Beside
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.labels import label_of, words_of
from rrins.host_tools.campaigns.row import MAIN
from rrins.host_tools.campaigns.store import REPORTS, Store
from rrins.host_tools.covariance.analysis import Analysis
from rrins.host_tools.drawing.page import write_report
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import make_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WORST = 10


def write(store: Store, folder: Path | None = None) -> list[Path]:
    """Write report and pictures of what is stored; return their paths, the report first.

    Raises
    ------
    RehearsalError
        When there is nothing to report, or it cannot be written.
    """
    folder = folder or store.folder / REPORTS
    definition, outcomes = store.definition, summary.Outcomes(store)
    make_folder(folder)
    shares = {
        name: found
        for name in sensitivity.LINEAR_OUTPUTS
        if (found := sensitivity.linear_shares(store, name))
    }
    is_saltelli = definition.design == "saltelli"
    indices = sensitivity.sobol_indices(store, MAIN) if is_saltelli else []
    linear = _linear(store)
    drawn = _drawn(store, outcomes, shares, indices, linear)
    return write_report(
        folder,
        "rrins.host_tools.campaigns",
        {name: picture for name, (_, picture) in drawn.items()},
        filters={
            "shown": summary.shown,
            "value": summary.value,
            "interval": summary.interval,
            "label": label_of,
        },
        captions={name: caption for name, (caption, _) in drawn.items()},
        definition=definition,
        title=definition.title or definition.name,
        stored=outcomes.stored,
        failed=outcomes.failed,
        stopped_at=store.stopped_at,
        reasons=summary.reasons(store),
        figures=[(name, summary.shown_figures(outcomes.sample(name))) for name in outcomes.known()],
        circles=summary.circles(outcomes),
        bound=summary.bound_of(outcomes),
        shares=shares,
        indices=indices,
        linear=linear,
        worst=_worst(store),
        folder=shlex.quote(str(store.folder)),
    )


@dataclass(frozen=True)
class _Linear:
    """The linear covariance analysis of the campaign's scenario, or why there is none."""

    analysis: Analysis | None = None
    beside: Beside | None = None
    why_not: str = ""

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Return the table: source, σ east and north at the end, largest on the way, share."""
        if self.analysis is None:
            return []
        figures = [
            (words_of(one.name), *one.end, one.largest, f"{self.analysis.share(one):.1%}")
            for one in self.analysis.sources
        ]
        east, north = self.analysis.sigma[-1].tolist()
        figures.append(("all", east, north, float(self.analysis.sigma.max()), ""))
        rows = [
            tuple(cell if isinstance(cell, str) else summary.shown(cell) for cell in row)
            for row in figures
        ]
        return rows if self.beside is None else [*rows, tuple(self.beside.cells())]

    @property
    def words(self) -> str:
        """Return whether analysis and runs agree, and what the analysis leaves out."""
        if self.analysis is None:
            return self.why_not
        lines = [] if self.beside is None else [self.beside.words(self.analysis)]
        if self.analysis.left_out:
            lines.append(f"not considered: {', '.join(map(words_of, self.analysis.left_out))}")
        lines += [line for line in (covariance_report.confidence(self.analysis),) if line]
        return "; ".join(lines)


def _linear(store: Store) -> _Linear:
    try:
        analysis = covariance_report.analysis_of(store.definition)
    except RehearsalError as error:
        return _Linear(why_not=str(error))
    try:
        return _Linear(analysis, covariance_report.beside_runs(store))
    except CampaignError:  # too few runs for an interval: the analysis stands alone
        return _Linear(analysis)


def _drawn(
    store: Store,
    outcomes: summary.Outcomes,
    shares: dict[str, list[sensitivity.Share]],
    indices: list[sensitivity.Index],
    linear: _Linear,
) -> dict[str, tuple[str, Figure]]:
    """Return the pictures by name, with their captions."""
    from rrins.host_tools.campaigns import pictures

    drawn: dict[str, tuple[str, Figure]] = {}
    radial = outcomes[MAIN]
    if np.isfinite(radial).any():
        bands = pictures.draw_bands(*pictures.series_of(store))
        drawn["over_time"] = ("Errors over time: percentiles of the runs.", bands)
        caption = "How many of the runs end with at most this horizontal error."
        drawn["distribution"] = (caption, pictures.draw_distribution(outcomes.sample(MAIN)))
        ends = pictures.draw_ends(outcomes["position_east_m"], outcomes["position_north_m"])
        drawn["ends"] = ("Where the runs end.", ends)
    if shares:
        caption = "Linear shares in the variance, with 95 % intervals."
        drawn["shares"] = (caption, pictures.draw_shares(shares))
    if indices:
        drawn["sobol"] = (
            "Sobol's indices of the horizontal error at the end.",
            pictures.draw_indices(indices),
        )
    if linear.analysis is not None:
        caption = "σ of the position: linear covariance analysis, its sources, and the runs."
        drawn["covariance"] = (caption, covariance_report.draw(linear.analysis, linear.beside))
    inputs = pictures.draw_inputs(store)
    if inputs is not None:
        caption = "What the inputs were; dotted: what normal ones are drawn from."
        drawn["inputs"] = (caption, inputs)
    return drawn


def _worst(store: Store) -> list[tuple[int, float]]:
    """Return the runs with the largest horizontal error, and that."""
    found = [(run, value) for run, value in store.values(MAIN).items() if np.isfinite(value)]
    return sorted(found, key=lambda one: -one[1])[:_WORST]
