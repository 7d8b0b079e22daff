"""The picture of parity and residuals of redundant sensors, with their thresholds."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.redundancy_records import ParitySecond
from rrins.host_tools.drawing import style
from rrins.host_tools.runs.results.seconds_log import Parities
from rrins.host_tools.runs.results.sensor_errors import KINDS

_LEAST_RATIO = 0.01
_MOST_WITHIN = 95.0  # percent of the residuals that the scale must show
_PARITY, _SENSOR = 2.0, 0.75  # inches
_LINE = style.LINES[0] | {"linewidth": 0.9}

_Vector = NDArray[np.float64]
_Flags = NDArray[np.bool_]


def draw_parity(parities: Parities, begin_epoch: float, rate_hz: int, title: str) -> Figure:
    """Return the parity over its threshold and each sensor's residual over time, for each kind.

    Where nothing can be compared there is a gap, with the words why.

    Parameters
    ----------
    parities : dict
        Seconds of each kind; not empty.
    begin_epoch : float
        When navigation began.
    """
    used = {kind: _sensors_of(seconds) for kind, seconds in parities.items()}
    heights = [h for sensors in used.values() for h in (_PARITY, _SENSOR * len(sensors))]
    figure = style.new_figure(9.0, sum(heights) + 1.2)
    rows = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    panels = iter(rows[:, 0])
    style.give_title(
        figure,
        f"{title}\nresiduals of 1 s (line), their thresholds (band); triangles: beyond the scale",
    )
    for kind, seconds in parities.items():
        time_s = (seconds["epoch"] - begin_epoch) / rate_hz
        compared: _Flags = np.any(seconds["threshold"], axis=1)
        _draw_ratio(next(panels), kind, time_s, seconds, compared)
        _draw_residuals(next(panels), kind, time_s, seconds, compared, used[kind])
    rows[-1, 0].set_xlim(time_s[0], time_s[-1])
    style.time_axis(rows[-1, 0])
    figure.align_ylabels()
    return figure


def _one(kind: str) -> str:
    return kind.removesuffix("s")


def _sensors_of(seconds: Records[ParitySecond]) -> list[int]:
    """Return the sensors that were ever in use, from 0."""
    bits = int(np.bitwise_or.reduce(seconds["sensors"]))
    return [k for k in range(bits.bit_length()) if bits >> k & 1]


def _draw_ratio(
    axes: Axes, kind: str, time_s: _Vector, seconds: Records[ParitySecond], compared: _Flags
) -> None:
    ratio = np.where(compared, np.maximum(seconds["ratio"], _LEAST_RATIO), np.nan)
    style.draw_line(axes, time_s, ratio, **style.LINES[0])
    axes.axhline(1.0, color="black", linestyle="--", linewidth=1.0)
    axes.annotate(
        "threshold", (0.006, 1.0), xycoords=axes.get_yaxis_transform(), xytext=(0, 2),
        textcoords="offset points", va="bottom", fontsize="small",
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_ylim(_LEAST_RATIO, 5 * max(3.0, 1.5 * float(np.nanmax(ratio, initial=1.0))))
    _shade(axes, time_s, ~compared, "no redundancy left" if compared.any() else "not compared")
    for number, (time, words) in enumerate(_changes(_one(kind), time_s, seconds["sensors"])):
        axes.axvline(time, color="0.35", linestyle=":", linewidth=1.2)
        is_late = time > time_s[0] + 0.85 * (time_s[-1] - time_s[0])
        axes.annotate(
            words,
            (time, 0.97 - 0.2 * (number % 2)),
            xycoords=("data", "axes fraction"),
            xytext=(-3 if is_late else 3, 0),
            textcoords="offset points",
            ha="right" if is_late else "left",
            va="top",
            fontsize="small",
        )
    style.finish(axes, f"{_one(kind)} parity\n/ threshold")


def _changes(one: str, time_s: _Vector, sensors: NDArray[np.int64]) -> list[tuple[float, str]]:
    """Return when sensors were left out or came back, and words for it."""
    found = []
    for k in np.flatnonzero(np.diff(sensors)) + 1:
        before, after = int(sensors[k - 1]), int(sensors[k])
        for bit in range((before | after).bit_length()):
            if (before ^ after) >> bit & 1 and before:
                outcome = "in use again" if after >> bit & 1 else "left out"
                found.append((float(time_s[k]), f"{one} {bit + 1} {outcome}"))
    return found


def _draw_residuals(
    axes: Axes,
    kind: str,
    time_s: _Vector,
    seconds: Records[ParitySecond],
    compared: _Flags,
    sensors: list[int],
) -> None:
    """Draw a strip for each sensor, one below the other, all with one scale."""
    size, unit = KINDS[kind].size, KINDS[kind].unit
    is_in_use = (seconds["sensors"][:, None] >> np.array(sensors) & 1).astype(bool)
    is_shown = is_in_use & compared[:, None]
    residual, threshold = (
        np.where(is_shown, seconds[name][:, sensors] / size, np.nan)
        for name in ("residual", "threshold")
    )
    limit = _limit(residual, threshold)
    names = [f"{_one(kind)} {sensor + 1}" for sensor in sensors]
    for row, middle in enumerate(style.strips(axes, names, limit)):
        strip = (middle - limit, middle + limit)
        _draw_residual(axes, time_s, residual[:, row], threshold[:, row], middle, limit)
        _shade(axes, time_s, ~is_in_use[:, row], "left out", strip)
        _shade(axes, time_s, is_in_use[:, row] & ~compared, "", strip)
    style.finish(axes, style.quantity(f"{_one(kind)} residuals", unit))
    axes.grid(visible=False, axis="y")


def _limit(residual: _Vector, threshold: _Vector) -> float:
    """Return what the scale must reach: not for a first second, or the last before an exclusion."""
    if not np.isfinite(threshold).any():
        return 1.0
    most = float(np.nanpercentile(np.abs(residual), _MOST_WITHIN))
    return 1.8 * max(float(np.nanmedian(threshold)), most)


def _draw_residual(
    axes: Axes, time_s: _Vector, residual: _Vector, threshold: _Vector, middle: float, limit: float
) -> None:
    every, band = style.thinned(time_s, np.minimum(threshold, limit))
    axes.fill_between(every, middle - band, middle + band, color="0.85", linewidth=0)
    style.draw_line(axes, time_s, middle + np.clip(residual, -limit, limit), **_LINE)
    for sign, marker in ((1, "^"), (-1, "v")):
        is_beyond = sign * residual > limit
        beyond = time_s[is_beyond & ~np.r_[False, is_beyond[:-1]]]  # the first of several
        at = np.full(len(beyond), middle + 0.88 * sign * limit)
        axes.plot(beyond, at, marker, color="black", markersize=3.5)


def _shade(
    axes: Axes, time_s: _Vector, where: _Flags, words: str, strip: tuple[float, float] | None = None
) -> None:
    """Hatch the spans of time with nothing to show; say why where there is room."""
    transform = axes.get_xaxis_transform() if strip is None else axes.transData
    low, high = (0.0, 1.0) if strip is None else strip
    edges = np.flatnonzero(np.diff(np.r_[False, where, False]))
    for first, end in edges.reshape(-1, 2):
        begin_s, end_s = float(time_s[first]), float(time_s[min(end, len(time_s) - 1)])
        axes.add_patch(
            Rectangle(
                (begin_s, low), end_s - begin_s, high - low, transform=transform,
                facecolor="none", edgecolor="0.75", hatch="////", linewidth=0,
            )
        )  # fmt: skip
        if words and end_s - begin_s > 0.2 * (time_s[-1] - time_s[0]):
            axes.text(
                (begin_s + end_s) / 2, (low + high) / 2, words, transform=transform,
                ha="center", va="center", fontsize="small",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )  # fmt: skip
