"""The picture of the integrity: the navigation's errors below their bounds, and what those are."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.estimator_records import EstimatorSecond
from rrins.firmware_py.core.records.integrity_records import (
    HEADING,
    HORIZONTAL,
    VERTICAL,
    IntegrityStatus,
)
from rrins.host_tools.drawing import style
from rrins.host_tools.runs.results.results import Errors

_SHADES = {IntegrityStatus.DEGRADED: "0.85", IntegrityStatus.NOT_AVAILABLE: "0.65"}

_Vector = NDArray[np.float64]


def bounded_errors(errors: Errors) -> tuple[_Vector, _Vector, _Vector]:
    """Return the errors that the bounds are of, horizontal, vertical (m) and heading (°)."""
    level = np.hypot(errors.position_east_m, errors.position_north_m)
    return level, np.abs(errors.height_m), np.abs(errors.turn_up_arcsec) / 3600


def draw_integrity(
    seconds: Records[EstimatorSecond], errors: Errors, begin_epoch: float, rate_hz: int, title: str
) -> Figure:
    """Return the errors over time with their protection levels, shaded where not available.

    Parameters
    ----------
    seconds : array of `EstimatorSecond`
        Not empty.
    begin_epoch : float
        When navigation began.
    """
    time_s = (seconds["epoch"] - begin_epoch) / rate_hz
    found = bounded_errors(errors)
    panels = [
        (HORIZONTAL, "horizontal error", "m", 1.0),
        (VERTICAL, "height error", "m", 1.0),
        (HEADING, "heading error", "°", np.degrees(1.0)),
    ]
    if not seconds["protection"][:, VERTICAL].any():
        del panels[VERTICAL]
    figure = style.new_figure(9.0, 2.0 * len(panels) + 0.8)
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    legend = "error (line), protection level (dashed); shaded: degraded, dark: not available"
    style.give_title(figure, f"{title}\n{legend}")
    for axes, (bound, label, unit, factor) in zip(rows, panels, strict=True):
        _shade(axes, time_s, seconds["integrity"])
        level = seconds["protection"][:, bound] * factor
        level = np.where((level > 0) & np.isfinite(level), level, np.nan)
        style.draw_line(axes, time_s, level, linestyle="--", color="0.2", linewidth=1)
        style.draw_line(axes, errors.time_s, np.maximum(found[bound], 1e-6), **style.LINES[0])
        axes.set_yscale("log")
        if np.isfinite(level).any():
            axes.set_ylim(bottom=1e-3 * float(np.nanmedian(level)))
        style.finish(axes, style.quantity(label, unit))
    style.time_axis(rows[-1])
    figure.align_ylabels()
    return figure


def _shade(axes: Axes, time_s: _Vector, status: NDArray[np.int64]) -> None:
    for one, shade in _SHADES.items():
        axes.fill_between(
            time_s, 0, 1, where=status == one, color=shade, linewidth=0, step="pre",
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
