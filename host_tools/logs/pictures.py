"""Plots of logs: signals over time, and navigation without a reference truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.drawing.style import (
    LINES,
    draw_line,
    finish,
    give_title,
    new_figure,
    quantity,
    time_axis,
)
from rrins.host_tools.logs.series import Contents, Series
from rrins.host_tools.logs.signals import Numbers
from rrins.host_tools.recording.mf4 import is_simulated
from rrins.host_tools.rounding import unit_words
from rrins.host_tools.runs.results.results import east_north_m

_PREFIXED = ("rad", "m/s", "m", "s")
_PREFIXES = ((2e3, 1e-3, "k"), (0.2, 1.0, ""), (2e-4, 1e3, "m"), (2e-7, 1e6, "µ"), (0.0, 1e9, "n"))
_MANY_DIGITS = 1e6  # larger numbers are shown with a power of ten
_NARROW = 1e-3  # range over magnitude; below this an offset is subtracted
_QUANTITIES = {
    "deg": "angle",
    "rad": "angle",
    "deg/s": "rate",
    "m": "distance",
    "m/s": "velocity",
    "%": "share",
}
_WHAT_LETTERS = 26
_PANEL_INCHES = 2.1
_MOST_NAMES = 12
_LEGEND_LETTERS = 105
_SHARE_WITHIN = 20.0  # times the narrowest signal range in a panel


def _figure(panels: Sequence[float], title: str) -> tuple[Figure, list[Axes]]:
    height = _PANEL_INCHES * sum(panels) + 0.9
    figure = new_figure(9.0, height)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=panels)
    give_title(figure, title)
    return figure, [row[0] for row in axes]


def _legend(axes: Axes) -> None:
    """Put the legend above the panel, clear of the lines, in as many columns as fit."""
    names = axes.get_legend_handles_labels()[1]
    columns = max(1, _LEGEND_LETTERS // (max(map(len, names)) + 8))
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.1,
        frameon=False,
        ncols=min(len(names), columns),
        fontsize="small",
    )


def _span(one: Series) -> tuple[float, float]:
    values = one.kept.line()[1]
    return float(np.min(values)), float(np.max(values))


def _fits(panel: Sequence[Series], one: Series) -> bool:
    """Return whether a signal can share a panel: same unit, and no signal would look flat."""
    signal = one.signal
    if signal.choices or panel[0].signal.choices or panel[0].signal.unit != signal.unit:
        return False
    if any(signal.name == other.signal.name for other in panel):
        return True
    if not signal.unit and signal.is_whole:
        return False
    if any(signal.message == other.signal.message for other in panel):
        return True
    spans = [_span(other) for other in (*panel, one)]
    widths = [high - low for low, high in spans if high > low]
    together = max(high for _, high in spans) - min(low for low, _ in spans)
    return bool(widths) and together <= _SHARE_WITHIN * min(widths)


def _panels(series: Sequence[Series]) -> list[list[Series]]:
    """Group the signals that share a panel."""
    panels: list[list[Series]] = []
    for one in series:
        for panel in panels:
            if _fits(panel, one):
                panel.append(one)
                break
        else:
            panels.append([one])
    return panels


def _draw_named(axes: Axes, one: Series) -> None:
    """Draw a signal with named values as steps, on a scale of the names that occur."""
    time_s, raw = one.kept.line()
    values = np.unique(raw).astype(int)
    if len(values) > _MOST_NAMES:
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        rank = raw
    else:
        rank = np.searchsorted(values, raw)
        names = [f"{one.signal.choices.get(int(v), 'no name')} ({v})" for v in values]
        axes.set_yticks(range(len(values)), names, fontsize="small")
        axes.set_ylim(-0.5, len(values) - 0.5)
    axes.step(time_s, rank, where="post", label=one.signal.full_name, **LINES[0])
    finish(axes, _what([one]))
    _legend(axes)


@dataclass(frozen=True)
class _Scale:
    """How the values of a panel are shown: offset to subtract, factor to multiply by."""

    base: float
    factor: float
    label: str


def _scale_of(unit: str, lines: Sequence[tuple[Floats, Numbers]]) -> _Scale:
    """Return a scale that keeps the tick labels short."""
    shown = unit_words(unit)
    low = min(float(np.min(values)) for _, values in lines)
    high = max(float(np.max(values)) for _, values in lines)
    base, label = 0.0, shown
    if 0 < high - low < _NARROW * max(abs(low), abs(high)):
        base = round(low, max(0, 1 - math.floor(math.log10(high - low))) - 1)
        label = f"{shown}\nabove {base:.12g}{'' if shown == '°' else ' '}{shown}"
    largest = max(abs(low - base), abs(high - base))
    if unit in _PREFIXED and largest:
        factor, prefix = next((f, p) for above, f, p in _PREFIXES if largest > above)
        return _Scale(base, factor, f"{prefix}{label}")
    if 0 < largest < 1e-2 or largest >= _MANY_DIGITS:
        power = 3 * math.floor(math.log10(largest) / 3)
        return _Scale(base, 10.0**-power, f"$10^{{{power}}}$ {label}".rstrip())
    return _Scale(base, 1.0, label)


def _what(panel: Sequence[Series]) -> str:
    """Return what a panel shows: the signals' names without their units, or the unit's quantity."""
    signals = [one.signal for one in panel]
    names = list(dict.fromkeys(signal.name_without_unit.replace("_", " ") for signal in signals))
    text = ", ".join(names)
    return text if len(text) <= _WHAT_LETTERS else _QUANTITIES.get(signals[0].unit, "value")


def _draw_numbers(axes: Axes, panel: Sequence[Series]) -> None:
    lines = [one.kept.line() for one in panel]
    scale = _scale_of(panel[0].signal.unit, lines)
    for k, (one, (time_s, values)) in enumerate(zip(panel, lines, strict=True)):
        style = LINES[k % len(LINES)]
        shown = (values - scale.base) * scale.factor
        if one.is_stepped:
            axes.step(time_s, shown, where="post", label=one.signal.full_name, **style)
        else:
            axes.plot(time_s, shown, label=one.signal.full_name, **style)
    if scale.factor == 1 and all(one.is_stepped for one in panel):
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    low, high = axes.dataLim.intervaly
    if high == low:
        axes.set_ylim(low - 0.8, high + 0.8)
    finish(axes, quantity(_what(panel), scale.label))
    axes.ticklabel_format(axis="y", style="plain", useOffset=False)
    _legend(axes)


_SAID = (("tool", ">"), ("computer", "o"), ("refused", "X"))  # and the marks


def _draw_diagnosis(axes: Axes, contents: Contents) -> None:
    """Draw a mark for each diagnostic message, on a scale of the names that occur."""
    said = contents.diagnosis
    names = list(dict.fromkeys(message.words.name for _, message in said))
    by_service = len(names) > _MOST_NAMES
    if by_service:
        names = list(dict.fromkeys(message.words.service for _, message in said))
    for style, (who, marker) in zip(LINES, _SAID, strict=False):
        found = [
            (time_s, names.index(message.words.service if by_service else message.words.name))
            for time_s, message in said
            if who == ("refused" if message.is_warning else message.sender.split()[0])
        ]
        if found:
            colour, inside = style["color"], "none" if marker == "o" else style["color"]
            points = zip(*found, strict=True)
            axes.plot(*points, marker, label=who, color=colour, markerfacecolor=inside)
    axes.set_yticks(range(len(names)), names, fontsize="small")
    axes.set_ylim(len(names) - 0.5, -0.5)
    finish(axes, "diagnosis")
    _legend(axes)


def draw_series(
    series: Sequence[Series], contents: Contents, title: str, has_diagnosis: bool = False
) -> Figure:
    """Plot signals over time: a panel for each unit, named values as steps; and the diagnosis."""
    panels = _panels(series)
    figure, axes = _figure([1.0] * len(panels) + [1.5] * has_diagnosis, title)
    if has_diagnosis:
        _draw_diagnosis(axes[-1], contents)
    for panel, panel_axes in zip(panels, axes, strict=False):
        if panel[0].signal.choices:
            _draw_named(panel_axes, panel[0])
        else:
            _draw_numbers(panel_axes, panel)
    time_axis(axes[-1], _since(contents))
    return figure


def _since(contents: Contents) -> str:
    if is_simulated(contents.first_s):
        begun = "" if contents.first_s == 0 else f", at {contents.first_s:g} s"
        return f"time since the log's first frame{begun}"
    begun_at = datetime.fromtimestamp(contents.first_s, tz=UTC)
    return f"time since {begun_at:%Y-%m-%d %H:%M:%S} UTC"


def draw_navigation(navigation: Records[NavigationOutput], rate_hz: int, title: str) -> Figure:
    """Plot the firmware's navigation: distance from the start, velocity, height and attitude.

    Parameters
    ----------
    navigation : array of NavigationOutput
    """
    time_s = (navigation["epoch"] - navigation["epoch"][0]) / rate_hz
    east, north = east_north_m(
        navigation["latitude"],
        navigation["longitude"],
        navigation["latitude"][0],
        navigation["longitude"][0],
        navigation["height"][0],
    )
    figure, axes = _figure([1.0] * 4, title)
    height, velocity = navigation["height"], navigation["velocity_n"]
    heading = np.degrees(np.unwrap(navigation["heading"]))
    panels: tuple[tuple[str, str, tuple[tuple[str, Floats], ...]], ...] = (
        (
            "distance from\nthe start",
            "m",
            (("east", east), ("north", north), ("up", height - height[0])),
        ),
        (
            "velocity",
            "m/s",
            tuple((name, velocity[:, k]) for k, name in enumerate(("east", "north", "up"))),
        ),
        (
            "attitude",
            "deg",
            (("roll", np.degrees(navigation["roll"])), ("pitch", np.degrees(navigation["pitch"]))),
        ),
        ("heading", "deg", (("heading, unwrapped", heading),)),
    )
    for panel_axes, (what, unit, lines) in zip(axes, panels, strict=True):
        scale = _scale_of(unit, [(time_s, values) for _, values in lines])
        for style, (name, values) in zip(LINES, lines, strict=False):
            shown = (values - scale.base) * scale.factor
            draw_line(panel_axes, time_s, shown, label=name, **style)
        finish(panel_axes, quantity(what, scale.label))
        panel_axes.ticklabel_format(axis="y", style="plain", useOffset=False)
        _legend(panel_axes)
    time_axis(axes[-1])
    figure.align_ylabels()
    return figure
