"""Cost against error: for each set of choices the least cost of each limit, and the best of all."""

from __future__ import annotations

import csv
import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.least_cost import InfeasibleError, Problem
from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.files import make_folder, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPAN = 4.0
"""From the required limit to the farthest one."""
_LIMITS = 25
_ALIKE = 1e-3
"""Share by which a better point is better: the solver meets a limit to 1e-4."""


@dataclass(frozen=True)
class Point:
    """A price, and the error it buys.

    Attributes
    ----------
    choices : mapping
        Key and value of each.
    sigmas : mapping
        σ of each tolerance, in its key's unit.
    predicted_m : float
        The percentile.
    cost : float
    is_best : bool
        Whether no other point is as good for less, or better for as much.
    """

    choices: Mapping[str, Any]
    sigmas: Mapping[str, float]
    predicted_m: float
    cost: float
    is_best: bool


def front(candidates: Sequence[Problem]) -> list[Point]:
    """Return the points of all sets of choices, for limits around the required one, by cost."""
    found: list[tuple[float, float, Problem, Floats]] = []
    for one in candidates:
        required_m, last_m = one.requirement.limit_m, 0.0
        for limit_m in np.geomspace(required_m / _SPAN, required_m * _SPAN, _LIMITS):
            try:
                sigmas = one.within(float(limit_m)).solve()
            except InfeasibleError:
                continue
            if (predicted_m := one.percentile(sigmas)) > last_m:  # less is not to be had for less
                found.append((one.cost(sigmas), predicted_m, one, sigmas))
            last_m = predicted_m
    points, least_m = list[Point](), np.inf
    for cost, predicted_m, one, sigmas in sorted(found, key=lambda point: point[:2]):
        chosen = {key.key: float(sigma) for key, sigma in zip(one.tolerances, sigmas, strict=True)}
        is_best = bool(predicted_m < least_m * (1.0 - _ALIKE))
        points.append(Point(one.choices, chosen, predicted_m, cost, is_best))
        least_m = min(least_m, predicted_m)
    return points


def words(choices: Mapping[str, Any]) -> str:
    """Return a set of choices as a reader names it."""
    return ", ".join(str(value) for value in choices.values()) or "as it is"


def write(candidates: Sequence[Problem], points: Sequence[Point], folder: Path) -> list[Path]:
    """Write `front.csv` and `front.png` into a folder; return their paths."""
    make_folder(folder)
    write_whole(folder / "front.csv", lambda file: _write_rows(file, points))
    pictures = write_pictures(folder, {"front": draw(candidates, points)})
    return [folder / "front.csv", *pictures]


def _write_rows(file: IO[str], points: Sequence[Point]) -> None:
    writer = csv.writer(file)
    first = points[0] if points else Point({}, {}, 0.0, 0.0, is_best=False)
    writer.writerow([*first.choices, *first.sigmas, "predicted_m", "cost", "is_best"])
    for one in points:
        sigmas = [f"{sigma:.6g}" for sigma in one.sigmas.values()]
        figures = [f"{one.predicted_m:.6g}", f"{one.cost:.6g}", int(one.is_best)]
        writer.writerow([*one.choices.values(), *sigmas, *figures])


def draw(candidates: Sequence[Problem], points: Sequence[Point]) -> Figure:
    """Draw cost against error: a line for each set of choices, the least of all broad."""
    from matplotlib.ticker import LogLocator

    from rrins.host_tools.drawing.style import LINES, finish, new_figure

    requirement = candidates[0].requirement
    figure = new_figure(8.0, 5.0)
    axes = figure.subplots()
    best = [(one.predicted_m, one.cost) for one in points if one.is_best]
    if best:
        axes.plot(*zip(*best, strict=True), color="0.8", linewidth=7.0, label="least cost of all")
    lines: defaultdict[str, list[tuple[float, float]]] = defaultdict(list)
    for p in points:
        lines[words(p.choices)].append((p.predicted_m, p.cost))
    styles = [dict(style) | {"marker": mark} for mark in "os^Dv" for style in LINES]
    for (name, own), style in zip(lines.items(), itertools.cycle(styles)):
        axes.plot(*zip(*own, strict=True), **style, markersize=4.0, label=name)
    axes.axvline(requirement.limit_m, color="0.4", linestyle=":", linewidth=1.0, label="required")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
    finish(axes, "cost, in the unit of the file", zero_line=False)
    axes.margins(x=0.02)
    axes.set_xlabel(f"{requirement.percent:g} % of the units stay below this horizontal error / m")
    axes.legend(frameon=False, fontsize="small")
    return figure
