"""Delay over fault: a panel for each kind of sensors, a line for each set of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from rrins.host_tools.drawing.style import LINES, finish, give_title, new_figure
from rrins.host_tools.redundancy.monte_carlo import PATIENCE_S
from rrins.host_tools.redundancy.survey import Group, Set, Survey
from rrins.host_tools.redundancy.theory import HALF, MOST
from rrins.host_tools.rounding import labelled

MARKERS = ("o", "s", "^", "D", "v", "P")
"""Of the runs of the first, second, … line."""

_TITLES = {
    "alarm": "known that one fails, by the parity alone",
    "standing": "known which one, at standstill",
}
_SHORTEST_S = 0.004


def label_of(survey: Survey, one: Set, group: Group) -> str:
    """Return the name of a line: the candidate's, and the sensors' where they differ."""
    name = survey.candidate.name
    return name if len(one.groups) == 1 else f"{name}, {one.kind.one} {group.words}"


def delays_figure(surveys: Sequence[Survey]) -> Figure:
    """Return the picture: gyros to the left, accelerometers to the right."""
    figure = new_figure(9.6, 8.0)
    give_title(figure, "Delay until a step of the bias is found")
    panels = figure.subplots(2, 2, sharex="col", sharey=True)
    for row, way in zip(panels, _TITLES, strict=True):
        for column, axes in enumerate(row):
            _panel(axes, surveys, column, way)
    for axes, one in zip(panels[-1], surveys[0].sets, strict=True):
        axes.set_xlabel(labelled(f"step of one of the {one.kind.name}", one.kind.unit))
    for axes in panels[:, 0]:
        finish(axes, "delay / s")
    panels[0, 0].legend(loc="upper right", frameon=False, fontsize="small")
    return figure


def _panel(axes: Axes, surveys: Sequence[Survey], column: int, way: str) -> None:
    lines = [
        (survey, survey.sets[column], group)
        for survey in surveys
        for group in survey.sets[column].groups
    ]
    for number, (survey, one, group) in enumerate(lines):
        style, marker = LINES[number % len(LINES)], MARKERS[number % len(MARKERS)]
        delays = np.where(np.isfinite(group.delays[way]), group.delays[way], np.nan)
        axes.plot(group.sizes, delays[:, 0], label=label_of(survey, one, group), **style)
        _points(axes, survey, one, group, way, style["color"], marker)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(min(group.sizes[0] for *_, group in lines), None)
    axes.set_ylim(_SHORTEST_S, 2 * PATIENCE_S)
    give_title(axes, f"{surveys[0].sets[column].kind.name}: {_TITLES[way]}", "small")
    finish(axes, "")
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_major_formatter(plain)
    axes.yaxis.set_major_formatter(plain)


def _points(
    axes: Axes, survey: Survey, one: Set, group: Group, way: str, colour: str, marker: str
) -> None:
    """Draw what the runs gave: a marker at the median, a bar up to 95 %."""
    found = []
    for size in group.sizes:
        tried = survey.tried(one, group, float(size))
        if tried is not None and np.isfinite(tried.quantile(way, HALF)):
            half, most = (tried.quantile(way, p) for p in (HALF, MOST))
            found.append((size, half, min(most, 2 * PATIENCE_S)))
    if not found:
        return
    x, half, most = np.array(found).T
    half = np.maximum(half, _SHORTEST_S)
    bar = np.vstack([np.zeros(len(x)), np.maximum(most - half, 0.0)])
    axes.errorbar(
        x, half, bar, fmt=marker, color=colour, markersize=4, linewidth=0.8, capsize=2, alpha=0.9
    )
