"""The picture of parity and residuals of redundant sensors, with their thresholds."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.redundancy_records import ParitySecond
from rrins.host_tools.drawing.style import (
    LINES,
    SINCE_NAVIGATION,
    finish,
    give_title,
    new_figure,
    quantity,
)
from rrins.host_tools.runs.results.seconds_log import Parities
from rrins.host_tools.runs.results.sensor_errors import KINDS

_LEAST_RATIO = 0.01
_MOST_LEGENDS = 8

_Vector = NDArray[np.float64]


def draw_parity(parities: Parities, begin_epoch: float, rate_hz: int, title: str) -> Figure:
    """Return the parity over its threshold and each sensor's residual over time, for each kind.

    Parameters
    ----------
    parities : dict
        Seconds of each kind; not empty.
    begin_epoch : float
        When navigation began.
    """
    figure = new_figure(9.0, 4.6 * len(parities))
    panels = figure.subplots(2 * len(parities), 1, sharex=True, squeeze=False)[:, 0]
    give_title(figure, title)
    for k, (kind, seconds) in enumerate(parities.items()):
        time_s = (seconds["epoch"] - begin_epoch) / rate_hz
        _draw_ratio(panels[2 * k], kind, time_s, seconds)
        _draw_residuals(panels[2 * k + 1], kind, time_s, seconds)
    panels[-1].set_xlabel(SINCE_NAVIGATION)
    figure.align_ylabels()
    return figure


def _draw_ratio(axes: Axes, kind: str, time_s: _Vector, seconds: Records[ParitySecond]) -> None:
    one = kind.removesuffix("s")
    compared = seconds["threshold"].any(axis=1)
    ratio = np.where(compared, np.maximum(seconds["ratio"], 2 * _LEAST_RATIO), np.nan)
    axes.plot(time_s, ratio, label="largest of all windows", **LINES[0])
    axes.axhline(1.0, label="threshold", color="black", linestyle="--", linewidth=1.0)
    axes.set_yscale("log")
    highest = max(3.0, 1.5 * float(np.nanmax(ratio, initial=1.0)))
    axes.set_ylim(_LEAST_RATIO, highest * 5)  # room for words above, and for the legend below
    finish(axes, f"{one} parity\n/ threshold")
    for time, words in _changes(one, time_s, seconds["sensors"]):
        axes.axvline(time, color="0.35", linestyle=":", linewidth=1.2)
        axes.annotate(
            words,
            (time, 0.97),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            va="top",
            fontsize="small",
        )
    axes.legend(loc="lower left", ncols=2, fontsize="small", frameon=False)


def _changes(one: str, time_s: _Vector, sensors: NDArray[np.int64]) -> list[tuple[float, str]]:
    """Return when sensors were left out or came back, and words for it."""
    found = []
    for k in np.flatnonzero(np.diff(sensors)) + 1:
        before, after = int(sensors[k - 1]), int(sensors[k])
        for bit in range((before | after).bit_length()):
            if (before ^ after) >> bit & 1 and before:
                outcome = "in use again" if after >> bit & 1 else "left out"
                found.append((float(time_s[k]), f"{one} {bit + 1}\n{outcome}"))
    return found


def _draw_residuals(axes: Axes, kind: str, time_s: _Vector, seconds: Records[ParitySecond]) -> None:
    one, (_, size, _, unit) = kind.removesuffix("s"), KINDS[kind]
    residual, threshold = seconds["residual"] / size, seconds["threshold"] / size
    used = np.flatnonzero(threshold.any(axis=0))
    residual = np.where(threshold > 0, residual, np.nan)
    threshold = np.where(threshold > 0, threshold, np.nan)
    for k in used:
        style = LINES[k % len(LINES)]
        axes.plot(time_s, residual[:, k], label=f"{one} {k + 1}", **style)
    if len(used):
        largest = np.nanmax(np.nan_to_num(threshold[:, used]), axis=1)
        largest = np.where(largest > 0, largest, np.nan)
        for sign, label in ((1, "threshold of 1 s"), (-1, None)):
            axes.plot(time_s, sign * largest, label=label, color="black", ls="--", lw=1.0)
        settled = float(np.nanmedian(largest))
        within = float(np.nanmax(np.abs(residual), initial=0.0))
        limit = 1.2 * max(2.0 * settled, within)
        axes.set_ylim(-limit, 1.5 * limit)
        axes.legend(loc="upper left", frameon=False, ncols=_MOST_LEGENDS, fontsize="small")
    finish(axes, quantity(f"{one} residuals", unit), zero_line=True)
