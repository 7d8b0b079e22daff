"""The lines and panels of all pictures; lines differ by dash too, so grey tells them apart."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator, NullFormatter

from rrins.compiled.record import Floats
from rrins.host_tools.rounding import labelled

LineStyle = dict[str, Any]
"""Keywords of matplotlib for a line."""

LINES: Final[tuple[LineStyle, ...]] = (
    {"color": "#0b5394", "linestyle": "-", "linewidth": 1.2},
    {"color": "#d2691e", "linestyle": (0, (5, 2)), "linewidth": 1.2},
    {"color": "#000000", "linestyle": (0, (1, 1.5)), "linewidth": 1.4},
    {"color": "#6a9a3b", "linestyle": (0, (7, 2, 1.5, 2)), "linewidth": 1.4},
    {"color": "#8e6bb0", "linestyle": "-", "linewidth": 2.2, "alpha": 0.55},
    {"color": "#555555", "linestyle": (0, (3, 1.2)), "linewidth": 2.0, "alpha": 0.7},
)
"""Styles of the first, second, … line of a panel."""

EAST, NORTH = LINES[:2]
"""Styles of what belongs to the east and to the north."""

SINCE_NAVIGATION: Final = "time since navigation began"
"""The time axis of whatever is compared with the truth."""

POINTS: Final = 4000
"""Points of a line that the eye can tell apart."""

DPI: Final = 200
"""Of pictures in files."""

_HOURS_FROM_S = 10_800.0
_GRID = "0.88"


def new_figure(width: float, height: float) -> Figure:
    """Return an empty picture, its size in inches."""
    figure = Figure(figsize=(width, height), layout="constrained", dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def give_title(to: Figure | Axes, text: str, fontsize: str = "medium") -> None:
    """Give a picture or a panel its title: any text, such as a file name, drawn as it stands.

    Dollar signs do not make it mathematics. What the font cannot draw becomes a replacement
    character: control characters, bytes of a name that are not UTF-8.
    """
    shown = "".join(
        c if c == "\n" or _can_draw(ord(c)) else "\N{REPLACEMENT CHARACTER}" for c in text
    )
    set_title = to.suptitle if isinstance(to, Figure) else to.set_title
    set_title(shown, fontsize=fontsize, parse_math=False)


@cache
def _can_draw(code: int) -> bool:
    """Return whether the font of all pictures has a character."""
    return get_font(findfont(FontProperties())).get_char_index(code) != 0


def quantity(what: str, unit: str) -> str:
    """Return the label of an axis, such as ``speed / (m/s)``; without a unit, `what` alone."""
    return labelled(what, unit, "\n")


def thinned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a line of at most about `POINTS`: the lowest and the highest of equally many each.

    Peaks stay, however long the line is, and so do gaps (NaN).
    """
    size = -(-2 * len(x) // POINTS)
    if size <= 2:
        return x, y
    groups = y[: len(y) // size * size].reshape(-1, size)
    is_gap = np.isnan(groups)
    lowest = np.where(is_gap, np.inf, groups).argmin(axis=1)
    ends = np.stack([lowest, np.where(is_gap, -np.inf, groups).argmax(axis=1)], axis=1)
    kept = np.sort(ends, axis=1) + size * np.arange(len(groups))[:, None]
    at = np.r_[0, kept.ravel(), len(y) - 1]
    return x[at], y[at]


def draw_line(axes: Axes, x: Floats, y: Floats, **style: Any) -> None:
    """Draw a line of any length, `thinned`; `style` as for matplotlib."""
    axes.plot(*thinned(x, y), **style)


def draw_track(axes: Axes, east: Floats, north: Floats, begin: str, end: str) -> None:
    """Draw a way seen from above, its begin and its end marked and named."""
    every = slice(None, None, max(1, len(east) // (4 * POINTS)))
    axes.plot(east[every], north[every], **EAST)
    axes.plot(east[:1], north[:1], "o", color="black", markersize=6, label=begin)
    hollow: LineStyle = {"markerfacecolor": "white", "markeredgecolor": "black", "markersize": 7}
    axes.plot(east[-1:], north[-1:], "s", label=end, **hollow)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(True, color=_GRID, linewidth=0.6)
    axes.legend(loc="best", frameon=False, fontsize="small")


def legend_above(axes: Axes, columns: int = 2, room: float = 0.2) -> None:
    """Put a legend where no curve is: above them all, in so much more of the panel."""
    axes.legend(loc="upper left", frameon=False, ncols=columns, fontsize="small")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + room * (high - low))


def strips(axes: Axes, names: Sequence[str], limit: float) -> list[float]:
    """Divide a panel into strips, one below the other, each from -`limit` to `limit`.

    Returns their middles. Lines that would cover each other are told apart so, by name.
    """
    steps = np.array(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]).tick_values(0, limit))
    step = float(steps[steps <= 0.75 * limit].max())
    middles = [-2 * limit * row for row in range(len(names))]
    ticks: dict[float, str] = {}
    for middle, name in zip(middles, names, strict=True):
        ticks |= {middle + step: f"{step:g}", middle: f"{name}    0", middle - step: f"−{step:g}"}
        axes.axhline(middle, color="0.5", linewidth=0.6, zorder=0)
        axes.axhline(middle - limit, color="0.5", linewidth=0.6)
    axes.set_yticks(list(ticks), list(ticks.values()), fontsize="small")
    axes.set_ylim(middles[-1] - limit, limit)
    return middles


def time_axis(axes: Axes, since: str = SINCE_NAVIGATION) -> None:
    """Label the axis of times in s, when all is drawn: in hours, if they are many."""
    low, high = axes.get_xlim()
    if high - low <= _HOURS_FROM_S:
        axes.set_xlabel(f"{since} / s")
        return
    ticks = MaxNLocator(steps=[1, 2, 5, 10]).tick_values(low / 3600, high / 3600)
    axes.xaxis.set_major_locator(MultipleLocator(3600 * float(ticks[1] - ticks[0])))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda time_s, _: f"{time_s / 3600:g}"))
    axes.set_xlabel(f"{since} / h")


def finish(axes: Axes, ylabel: str, zero_line: bool = False) -> None:
    """Give a panel its label and grid, and a line at zero if wanted; call it after its scales."""
    axes.set_ylabel(ylabel)
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "linear":
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
    axes.grid(True, color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0)
    if zero_line:
        axes.axhline(0.0, color="0.5", linewidth=0.6, zorder=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
