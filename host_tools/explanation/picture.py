"""The picture of an explanation: the largest sources at the instant, and over time until then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rrins.host_tools.drawing.style import (
    LINES,
    finish,
    give_title,
    legend_above,
    new_figure,
    quantity,
    time_axis,
)
from rrins.host_tools.explanation.explain import OF, Explanation
from rrins.host_tools.explanation.words import COMPONENTS, UNITS, scaled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rrins.compiled.record import Floats

_MOST_BARS: Final = 9
_MOST_LINES: Final = 4
_BARS: Final = ("#0b5394", "#e69f00")


def draw(
    found: Explanation, title: str, of: str = "position", figure: Figure | None = None
) -> Figure:
    """Draw what contributes to the error; `of` is a key of `OF`."""
    groups = [
        (name, np.nansum([one.over_time for one in parts], axis=0)[:, OF[of]])
        for name, parts in found.by_size(of)
    ]
    whole, rest = found.error[:, OF[of]], found.rest[:, OF[of]]
    left = whole - rest - sum((values for _, values in groups), np.zeros_like(whole))
    shown = [1, 2] if of == "attitude" else [0, 1]
    factor, unit = scaled(whole[:, shown], UNITS[of])
    figure = figure or new_figure(9.0, 8.4)
    give_title(figure, title)
    panels = figure.subplots(3, 1, height_ratios=[1.35, 1, 1])
    bars = [*groups[:_MOST_BARS]]
    if others := groups[_MOST_BARS:]:
        bars.append((f"{len(others)} others", sum((v for _, v in others), np.zeros_like(whole))))
    bars += [
        ("a unit without errors", rest),
        ("three or more together", left),
        ("the error", whole),
    ]
    _draw_bars(panels[0], [(n, v[-1, shown] * factor) for n, v in bars], of, unit, shown)
    for axes, component in zip(panels[1:], shown, strict=True):
        label = f"{COMPONENTS[of][component]} {'error' if of != 'attitude' else ''}".strip()
        axes.plot(found.times_s, whole[:, component] * factor, "k-", lw=1.8, label="the error")
        for (name, values), line in zip(groups[:_MOST_LINES], LINES, strict=False):
            style = line | ({"color": "#8e6bb0"} if line["color"] == "#000000" else {})
            axes.plot(found.times_s, values[:, component] * factor, **style, label=name)
        finish(axes, quantity(label, unit), zero_line=True)
    legend_above(panels[1], room=0.45)
    panels[1].sharex(panels[2])
    panels[1].tick_params(labelbottom=False)
    time_axis(panels[2])
    return figure


def _draw_bars(
    axes: Axes, bars: list[tuple[str, Floats]], of: str, unit: str, shown: list[int]
) -> None:
    places = np.arange(len(bars))
    for side, (colour, hatch) in enumerate(zip(_BARS, ("", "////"), strict=True)):
        axes.barh(
            places + 0.2 * (2 * side - 1),
            [values[side] for _, values in bars],
            0.38,
            color=colour,
            hatch=hatch,
            edgecolor="white",
            linewidth=0,
            label=COMPONENTS[of][shown[side]],
        )
    axes.set_yticks(places, [name for name, _ in bars])
    axes.get_yticklabels()[-1].set_fontweight("bold")
    axes.invert_yaxis()
    axes.axvline(0.0, color="0.5", linewidth=0.6)
    axes.grid(True, axis="x", color="0.88", linewidth=0.6)
    axes.set_axisbelow(True)
    for name in ("top", "right"):
        axes.spines[name].set_visible(False)
    axes.set_xlabel(f"contribution / {f'({unit})' if '/' in unit else unit}")
    axes.legend(frameon=False, fontsize="small", loc="center right")  # where bars are short
