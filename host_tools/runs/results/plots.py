"""Pictures of a run; lines differ by dash as well as by colour, so grey tells them apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rrins.host_tools.drawing import style
from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.results.estimator_plot import draw_estimates
from rrins.host_tools.runs.results.integrity_plot import draw_integrity
from rrins.host_tools.runs.results.parity_plot import draw_parity
from rrins.host_tools.runs.results.results import Errors, Vector
from rrins.host_tools.runs.results.seconds_log import Seconds
from rrins.host_tools.runs.results.sensors_plot import draw_constants
from rrins.host_tools.runs.results.summary_types import AnySummary

_SCALES = ((1e3, 1e-3, "k"), (0.1, 1.0, ""), (1e-4, 1e3, "m"), (0.0, 1e6, "µ"))


def scale_of(*values: Vector) -> tuple[float, str]:
    """Return the factor and the prefix that suit the largest value, as in the tables of a run."""
    largest = max(float(np.max(np.abs(value), initial=0.0)) for value in values)
    for above, factor, prefix in _SCALES:
        if largest > above:
            return factor, prefix
    return 1.0, ""


def _pair(axes: Axes, errors: Errors, kind: str, unit: str, label: str) -> None:
    """Draw the east and the north error of a kind over time."""
    east = getattr(errors, f"{kind}_east_{unit}")
    north = getattr(errors, f"{kind}_north_{unit}")
    shown = "m/s" if unit == "mps" else unit
    factor, prefix = scale_of(east, north)
    for values, line, name in ((east, style.EAST, "east"), (north, style.NORTH, "north")):
        largest = float(np.max(np.abs(values))) * factor
        text = f"{name} (largest {rounded(largest)} {prefix}{shown})"
        style.draw_line(axes, errors.time_s, values * factor, label=text, **line)
    style.finish(axes, style.quantity(label, f"{prefix}{shown}"), zero_line=True)
    style.legend_above(axes)


def draw_errors(errors: Errors, title: str, figure: Figure | None = None) -> Figure:
    """Return position and velocity errors over time, and the table's angles if it turned.

    Drawn into `figure` if there is one.
    """
    turned = bool(np.ptp(errors.inner_deg) > 0 or np.ptp(errors.outer_deg) > 0)
    rows = 3 if turned else 2
    figure = figure or style.new_figure(9.0, 2.6 * rows)
    axes = figure.subplots(rows, 1, sharex=True)
    style.give_title(figure, title)
    _pair(axes[0], errors, "position", "m", "position error")
    _pair(axes[1], errors, "velocity", "mps", "velocity error")
    if turned:
        style.draw_line(axes[2], errors.time_s, errors.inner_deg, label="inner axis", **style.EAST)
        style.draw_line(axes[2], errors.time_s, errors.outer_deg, label="outer axis", **style.NORTH)
        style.finish(axes[2], "turntable angle\n/ °", zero_line=True)
        axes[2].set_yticks(np.arange(-180, 721, 180))
        style.legend_above(axes[2])
    style.time_axis(axes[-1])
    figure.align_ylabels()
    return figure


def draw_track(errors: Errors, title: str, axes: Axes | None = None) -> Axes:
    """Draw the horizontal position error as a track seen from above; return its axes."""
    axes = axes or style.new_figure(6.0, 5.6).subplots()
    factor, prefix = scale_of(errors.position_east_m, errors.position_north_m)
    east, north = errors.position_east_m * factor, errors.position_north_m * factor
    off = float(np.hypot(east[-1], north[-1]))
    end = f"end, {rounded(off)} {prefix}m off, after {errors.time_s[-1]:.0f} s"
    style.draw_track(axes, east, north, "start", end)
    axes.set_xlabel(f"position error east / {prefix}m")
    axes.set_ylabel(f"position error north / {prefix}m")
    style.give_title(axes, title)
    return axes


def _track_figure(errors: Errors, title: str) -> Figure:
    figure = style.new_figure(6.0, 5.6)
    draw_track(errors, title, figure.subplots())
    return figure


def write_plots(
    folder: Path, errors: Errors, title: str, rate_hz: int, seconds: Seconds, summary: AnySummary
) -> list[Path]:
    """Write the pictures of a run into a folder; return their paths, none for an empty run.

    Raises
    ------
    RehearsalError
        When one cannot be written.
    """
    if len(errors) < 2:
        return []
    figures = {
        "navigation_errors": draw_errors(errors, title),
        "horizontal_track": _track_figure(errors, title),
    }
    begin_epoch = float(errors.epoch[0]) - float(errors.time_s[0]) * rate_hz
    estimates, estimator = seconds.estimates, summary["estimator"]
    if len(estimates):
        figures["estimator"] = draw_estimates(estimates, errors, begin_epoch, rate_hz, title)
    if len(estimates) and estimates["integrity"].any():
        figures["integrity"] = draw_integrity(estimates, errors, begin_epoch, rate_hz, title)
    if estimator and estimator["sensors"] and estimator["sensors"]["gyros"]["constants"]:
        figures["estimated_sensors"] = draw_constants(estimator, title)
    if seconds.parities:
        figures["parity"] = draw_parity(seconds.parities, begin_epoch, rate_hz, title)
    return write_pictures(folder, figures)
