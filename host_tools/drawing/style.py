"""The lines and panels of all pictures; lines differ by dash too, so grey tells them apart."""

from __future__ import annotations

from functools import cache
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

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

SINCE_NAVIGATION: Final = "time since navigation began / s"
"""The time axis of whatever is compared with the truth."""

_DPI = 110


def new_figure(width: float, height: float) -> Figure:
    """Return an empty picture, its size in inches."""
    figure = Figure(figsize=(width, height), layout="constrained", dpi=_DPI)
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
    if not unit:
        return what
    return f"{what}\n/ {f'({unit})' if '/' in unit else unit}"


def finish(axes: Axes, ylabel: str, zero_line: bool = False) -> None:
    """Give a panel its label and grid, and a line at zero if wanted."""
    axes.set_ylabel(ylabel)
    axes.grid(True, color="0.88", linewidth=0.6)
    axes.margins(x=0)
    if zero_line:
        axes.axhline(0.0, color="0.5", linewidth=0.6, zorder=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
