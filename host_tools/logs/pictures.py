"""Pictures of logs: signals over time, and a navigation without a truth to measure it by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from host_tools.logs.errors import RecordError
from host_tools.logs.mf4 import is_simulated
from host_tools.logs.series import Contents, Series
from host_tools.results import east_north_m

_STYLES: tuple[dict[str, Any], ...] = (
    {"color": "#0b5394", "linestyle": "-", "linewidth": 1.2},
    {"color": "#d2691e", "linestyle": (0, (5, 2)), "linewidth": 1.2},
    {"color": "#000000", "linestyle": (0, (1, 1.5)), "linewidth": 1.4},
    {"color": "#6a9a3b", "linestyle": (0, (7, 2, 1.5, 2)), "linewidth": 1.4},
    {"color": "#8e6bb0", "linestyle": "-", "linewidth": 2.2, "alpha": 0.55},
    {"color": "#555555", "linestyle": (0, (3, 1.2)), "linewidth": 2.0, "alpha": 0.7},
)
_PREFIXED = ("rad", "m/s", "m", "s")
_PREFIXES = ((2e3, 1e-3, "k"), (0.2, 1.0, ""), (2e-4, 1e3, "m"), (2e-7, 1e6, "µ"), (0.0, 1e9, "n"))
_MANY_DIGITS = 1e6  # from which on a number is shown by a power of ten
_NARROW = 1e-3  # range over size, from which on the size is taken off
_SHOWN = {"deg": "°", "deg/s": "°/s", "us": "µs"}
_PANEL_INCHES = 2.1
_MOST_NAMES = 12
_LEGEND_LETTERS = 105
_SHARE_WITHIN = 20.0  # times the narrowest range of the signals of a panel


def _figure(panels: Sequence[float], title: str) -> tuple[Figure, list[Any]]:
    height = _PANEL_INCHES * sum(panels) + 0.9
    figure = Figure(figsize=(9.0, height), layout="constrained", dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=panels)
    figure.suptitle(title, fontsize="medium")
    return figure, [row[0] for row in axes]


def _dress(axes: Any, ylabel: str) -> None:
    axes.set_ylabel(ylabel)
    axes.grid(True, color="0.88", linewidth=0.6)
    axes.margins(x=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _legend(axes: Any) -> None:
    """Put the legend above the panel, where no line is, in as many columns as fit."""
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
    """Return whether a signal can share a panel: of one unit, and none would be a flat line."""
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
    """Return what shares a panel."""
    panels: list[list[Series]] = []
    for one in series:
        for panel in panels:
            if _fits(panel, one):
                panel.append(one)
                break
        else:
            panels.append([one])
    return panels


def _draw_named(axes: Any, one: Series) -> None:
    """Draw a value with names as steps, on a scale of the names that come."""
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
    axes.step(time_s, rank, where="post", label=one.signal.full_name, **_STYLES[0])
    _dress(axes, "")
    _legend(axes)


@dataclass(frozen=True)
class _Scale:
    """How the values of a panel are shown: what is taken off, by what the rest is multiplied."""

    base: float
    factor: float
    label: str


def _scale_of(unit: str, lines: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> _Scale:
    """Return a scale whose numbers are short."""
    shown = _SHOWN.get(unit, unit)
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


def _draw_numbers(axes: Any, panel: Sequence[Series]) -> None:
    lines = [one.kept.line() for one in panel]
    scale = _scale_of(panel[0].signal.unit, lines)
    for k, (one, (time_s, values)) in enumerate(zip(panel, lines, strict=True)):
        style = _STYLES[k % len(_STYLES)]
        shown = (values - scale.base) * scale.factor
        if one.is_stepped:
            axes.step(time_s, shown, where="post", label=one.signal.full_name, **style)
        else:
            axes.plot(time_s, shown, label=one.signal.full_name, **style)
    if scale.factor == 1 and all(one.is_stepped for one in panel):
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        low, high = axes.get_ylim()
        if high - low < 1:  # it never changes
            axes.set_ylim(low - 0.8, high + 0.8)
    _dress(axes, scale.label)
    axes.ticklabel_format(axis="y", style="plain", useOffset=False)
    _legend(axes)


def draw_series(series: Sequence[Series], contents: Contents, title: str) -> Figure:
    """Return signals over time: a panel for each unit, names as steps."""
    panels = _panels(series)
    figure, axes = _figure([1.0] * len(panels), title)
    for panel, own in zip(panels, axes, strict=True):
        if panel[0].signal.choices:
            _draw_named(own, panel[0])
        else:
            _draw_numbers(own, panel)
    axes[-1].set_xlabel(_time_label(contents))
    return figure


def _time_label(contents: Contents) -> str:
    if is_simulated(contents.first_s):
        begun = "" if contents.first_s == 0 else f", which is at {contents.first_s:g} s"
        return f"time since the log's first frame{begun} / s"
    begun_at = datetime.fromtimestamp(contents.first_s, tz=UTC)
    return f"time since {begun_at:%Y-%m-%d %H:%M:%S} UTC / s"


def draw_navigation(rows: NDArray[Any], rate_hz: int, title: str) -> Figure:
    """Return what the firmware navigated: the way from its start, velocity, height, attitude.

    Parameters
    ----------
    rows : array of dtype `firmware_py.memory.NAVIGATION`
    """
    time_s = (rows["epoch"] - rows["epoch"][0]) / rate_hz
    east, north = east_north_m(
        rows["latitude"],
        rows["longitude"],
        rows["latitude"][0],
        rows["longitude"][0],
        rows["height"][0],
    )
    figure, axes = _figure([1.0] * 4, title)
    velocity = rows["velocity_n"]
    heading = np.degrees(np.unwrap(rows["heading"]))
    panels: tuple[tuple[str, str, tuple[tuple[str, Any], ...]], ...] = (
        (
            "way from start",
            "m",
            (("east", east), ("north", north), ("up", rows["height"] - rows["height"][0])),
        ),
        (
            "velocity",
            "m/s",
            tuple((name, velocity[:, k]) for k, name in enumerate(("east", "north", "up"))),
        ),
        (
            "attitude",
            "deg",
            (("roll", np.degrees(rows["roll"])), ("pitch", np.degrees(rows["pitch"]))),
        ),
        ("heading", "deg", (("heading, counted on over 360°", heading),)),
    )
    for own, (what, unit, lines) in zip(axes, panels, strict=True):
        scale = _scale_of(unit, [(time_s, values) for _, values in lines])
        for style, (name, values) in zip(_STYLES, lines, strict=False):
            own.plot(time_s, (values - scale.base) * scale.factor, label=name, **style)
        _dress(own, f"{what}\n/ {scale.label}")
        own.ticklabel_format(axis="y", style="plain", useOffset=False)
        _legend(own)
    axes[-1].set_xlabel("time since navigation began / s")
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a picture so that it is there whole or not at all.

    Raises
    ------
    RecordError
        When it cannot be written, or its ending is of no kind of picture.
    """
    part = path.with_name(f".part-{path.name}")
    try:
        figure.savefig(part)
        part.replace(path)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else " ".join(str(error).split())
        raise RecordError(f"{path}: cannot be written: {why}") from error
    finally:
        part.unlink(missing_ok=True)
