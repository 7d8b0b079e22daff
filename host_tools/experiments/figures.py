"""Plots of the experiments, modelled on the paper's figures 9, 10, 12 and 15."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from rrins.compiled.record import Floats
from rrins.host_tools.drawing.style import (
    EAST,
    LINES,
    NORTH,
    POINTS,
    draw_line,
    finish,
    legend_above,
    new_figure,
    quantity,
    time_axis,
)
from rrins.host_tools.experiments.sections import Distribution
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.results.plots import scale_of
from rrins.host_tools.runs.results.results import Errors


def _panel(axes: Axes, time_s: Floats, pairs: tuple[Floats, Floats], label: str, unit: str) -> None:
    factor, prefix = scale_of(*pairs)
    for values, style, name in zip(pairs, (EAST, NORTH), ("east", "north"), strict=True):
        largest = float(np.max(np.abs(values))) * factor
        text = f"{name} (largest {rounded(largest)} {prefix}{unit})"
        draw_line(axes, time_s, values * factor, label=text, **style)
    finish(axes, quantity(label, f"{prefix}{unit}"), zero_line=True)
    legend_above(axes)


def draw_pair(left: tuple[Errors, str], right: tuple[Errors, str]) -> Figure:
    """Plot velocity and position errors of two runs in adjacent columns."""
    figure = new_figure(10.0, 5.0)
    panels = figure.subplots(2, 2, sharex="col")
    for column, (errors, title) in enumerate((left, right)):
        velocity = (errors.velocity_east_mps, errors.velocity_north_mps)
        position = (errors.position_east_m, errors.position_north_m)
        _panel(panels[0, column], errors.time_s, velocity, "velocity error", "m/s")
        _panel(panels[1, column], errors.time_s, position, "position error", "m")
        panels[0, column].set_title(title, fontsize="medium")
        time_axis(panels[1, column])
    figure.align_ylabels()
    return figure


def draw_bands(
    cases: dict[str, tuple[Distribution, Distribution]], labels: tuple[str, str], title: str
) -> Figure:
    """Plot the spread of two quantities for each case: band, median, the paper's figure.

    Parameters
    ----------
    cases : dict
        Both distributions by the words of a case.
    labels : tuple of str
        What either quantity is, with its unit.
    title : str
    """
    figure = new_figure(9.0, 1.0 + 0.5 * len(cases))
    panels = figure.subplots(1, 2, sharey=True)
    for panel, side, style in zip(panels, (0, 1), LINES, strict=False):
        for row, pair in enumerate(cases.values()):
            one = pair[side]
            panel.plot(
                one.spread, [row, row], color=style["color"], linewidth=5,
                alpha=0.45, solid_capstyle="butt",
            )  # fmt: skip
            panel.plot(one.values, [row] * len(one.values), "|", color="0.25", markersize=7)
            panel.plot([one.median], [row], "o", color="black", markersize=6)
            if one.paper is not None:
                panel.plot(
                    [one.paper], [row], "D", markerfacecolor="white", markeredgecolor="black",
                    markersize=7,
                )  # fmt: skip
        panel.set_xscale("log")
        low, high = panel.get_xlim()
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,)))
        panel.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_xlabel(labels[side])
        panel.grid(True, axis="x", which="both", color="0.9", linewidth=0.6)
    panels[0].set_yticks(range(len(cases)), list(cases))
    panels[0].invert_yaxis()
    spread = next(iter(cases.values()))[0].spread_words
    figure.suptitle(
        f"{title}\nbar: {spread}, ticks: seeds, dot: median, diamond: the paper", fontsize="small"
    )
    return figure


def draw_track(true_east_m: Floats, true_north_m: Floats, tracks: Mapping[str, Errors]) -> Figure:
    """Plot the vehicle's track, and the position errors of several runs over time."""
    figure = new_figure(10.0, 4.4)
    way, over_time = figure.subplots(1, 2)
    way.plot(true_east_m / 1e3, true_north_m / 1e3, color="0.55", linewidth=2.5, label="truth")
    for (name, errors), style in zip(tracks.items(), (NORTH, EAST), strict=False):
        thin = slice(None, None, max(1, len(errors) // (4 * POINTS)))
        east = true_east_m + errors.position_east_m
        north = true_north_m + errors.position_north_m
        way.plot(east[thin] / 1e3, north[thin] / 1e3, label=name, **style)
        distance = np.hypot(errors.position_east_m, errors.position_north_m)
        label = f"{name}, {rounded(distance[-1])} m at the end"
        draw_line(over_time, errors.time_s, distance, label=label, **style)
    way.plot(true_east_m[:1] / 1e3, true_north_m[:1] / 1e3, "o", color="black", label="start")
    way.set_aspect("equal", adjustable="datalim")
    way.set_xlabel("east / km")
    way.set_ylabel("north / km")
    way.grid(True, color="0.88", linewidth=0.6)
    way.legend(frameon=False, fontsize="small")
    way.set_title("track", fontsize="medium")
    over_time.set_title("distance from the truth", fontsize="medium")
    finish(over_time, "horizontal position error / m", zero_line=True)
    time_axis(over_time)
    over_time.legend(frameon=False, fontsize="small", loc="upper left")
    return figure
