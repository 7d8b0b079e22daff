"""Pictures of a campaign."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.distributions import cumulative_normal
from rrins.host_tools.campaigns.labels import label_of, words_of
from rrins.host_tools.campaigns.manifest import read_manifest
from rrins.host_tools.campaigns.row import MAIN, OK, SERIES
from rrins.host_tools.campaigns.sensitivity import Index, Share
from rrins.host_tools.campaigns.statistics import Estimate, Sample
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.campaigns.summary import shown
from rrins.host_tools.drawing.style import EAST, LINES, finish, new_figure, time_axis

_BANDS = ((5.0, 95.0, 0.18), (25.0, 75.0, 0.35))
_MOST_POINTS = 4000
_MOST_BARS = 20
_MOST_INPUTS = 12
_LONGEST_NAME = 34


def series_of(store: Store) -> tuple[Floats, Floats, Floats]:
    """Return the instants (s), and the east and north errors of all runs there (m, a row a run)."""
    table = store.table(["status", *SERIES])
    is_ok = [status == OK for status in table["status"].to_pylist()]
    times = np.array(read_manifest(store.folder).times_s)
    pair = [
        np.array([row for row, ok in zip(table[name].to_pylist(), is_ok, strict=True) if ok], float)
        for name in SERIES
    ]
    east, north = (one.reshape(-1, len(times)) for one in pair)
    return times, east, north


def draw_bands(times: Floats, east: Floats, north: Floats) -> Figure:
    """Draw percentiles of the errors over time: horizontal, east, north."""
    figure = new_figure(8.0, 6.5)
    panels = figure.subplots(3, 1, sharex=True)
    radial = np.hypot(east, north)
    titles = ("horizontal error\n/ m", "error, east\n/ m", "error, north\n/ m")
    for axes, values, label in zip(panels, (radial, east, north), titles, strict=True):
        for low, high, alpha in _BANDS:
            below, above = np.nanpercentile(values, (low, high), axis=0)
            name = f"{low:g} to {high:g} %"
            axes.fill_between(
                times, below, above, color=EAST["color"], alpha=alpha, label=name, lw=0
            )
        axes.plot(times, np.nanmedian(values, axis=0), **EAST, label="median")
        finish(axes, label, zero_line=axes is not panels[0])
    panels[0].set_ylim(bottom=0)
    panels[0].legend(loc="upper left", frameon=False, fontsize="small", ncols=3)
    time_axis(panels[-1])
    return figure


def draw_distribution(radial: Sample) -> Figure:
    """Draw the distribution function of the horizontal error at the end."""
    figure = new_figure(6.0, 4.0)
    axes = figure.subplots()
    values = np.sort(radial.values)
    axes.step(values, np.arange(1, len(values) + 1) / len(values), where="post", **EAST)
    for percent, line in ((50.0, LINES[1]), (95.0, LINES[2])):
        one = radial.percentile(percent)
        axes.plot([0, one.value], [percent / 100] * 2, **line)
        axes.plot(
            [one.value] * 2,
            [0, percent / 100],
            **line,
            label=f"{percent:g} % of the runs: {shown(one.value)} m",
        )
        if np.isfinite(one.half_width):
            axes.axvspan(one.low, one.high, color=line["color"], alpha=0.12, lw=0)
    finish(axes, "share of the runs")
    axes.set_xlim(left=0)
    axes.set_ylim(0, 1)
    axes.set_xlabel("horizontal error at the end / m; shaded: 95 % intervals")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False)
    return figure


def draw_ends(east: Floats, north: Floats) -> Figure:
    """Draw where the runs end, with CEP50 and R95 about the truth."""
    figure = new_figure(5.0, 5.0)
    axes = figure.subplots()
    axes.plot(east[:_MOST_POINTS], north[:_MOST_POINTS], ".", ms=3, color=EAST["color"], alpha=0.5)
    radial = Sample(np.hypot(east, north))
    for name, percent, line in (("CEP50", 50.0, LINES[1]), ("R95", 95.0, LINES[2])):
        radius = radial.percentile(percent)
        turn = np.linspace(0.0, 2 * np.pi, 361)
        at = radius.value * np.cos(turn), radius.value * np.sin(turn)
        axes.plot(*at, label=f"{name}: {shown(radius.value)} m", **line)
    finish(axes, "position error, north / m", zero_line=True)
    axes.axvline(0.0, color="0.5", linewidth=0.6, zorder=0)
    axes.margins(0.05)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("position error, east / m")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False, fontsize="small")
    return figure


def draw_shares(shares: dict[str, list[Share]]) -> Figure:
    """Draw the linear shares of the inputs in some outputs."""
    most = max(len(found) for found in shares.values())
    figure = new_figure(8.0, 1.3 + 0.32 * min(most, _MOST_BARS) * len(shares))
    for axes, (output, found) in zip(_panels(figure, len(shares)), shares.items(), strict=True):
        kept = [*found[: _MOST_BARS - 1], found[-1]] if len(found) > _MOST_BARS else found
        _bars(axes, [one.name for one in kept], [[one.share for one in kept]], [""])
        axes.set_xlabel(f"share in the variance of the {words_of(output)}, with 95 % interval")
    return figure


def draw_indices(indices: list[Index]) -> Figure:
    """Draw Sobol's indices."""
    kept = indices[:_MOST_BARS]
    figure = new_figure(8.0, 1.3 + 0.4 * len(kept))
    axes = figure.subplots()
    pair = [[one.first for one in kept], [one.total for one in kept]]
    _bars(axes, [one.name for one in kept], pair, ["alone", "with interactions"])
    axes.set_xlabel(f"Sobol's index of the {words_of(MAIN)}, with 95 % interval")
    axes.legend(loc="lower right", frameon=False)
    return figure


def _wrapped(name: str) -> str:
    return textwrap.fill(words_of(name), _LONGEST_NAME)


def _panels(figure: Figure, count: int) -> list[Axes]:
    panels = figure.subplots(count, 1, squeeze=False)
    return [row[0] for row in panels]


def _bars(axes: Axes, names: list[str], groups: list[list[Estimate]], labels: list[str]) -> None:
    height = 0.8 / len(groups)
    for number, (group, label) in enumerate(zip(groups, labels, strict=True)):
        at = np.arange(len(names)) + (number - (len(groups) - 1) / 2) * height
        values = np.array([one.value for one in group])
        spans = np.array([[one.value - one.low, one.high - one.value] for one in group]).T
        colour = LINES[number]["color"]
        style = {"color": colour, "alpha": 0.75, "label": label or None}
        axes.barh(at, values, height * 0.9, xerr=np.clip(spans, 0, None), ecolor="0.3", **style)
    axes.set_yticks(np.arange(len(names)), [_wrapped(name) for name in names])
    axes.invert_yaxis()
    finish(axes, "")
    ends = [end for group in groups for one in group for end in (one.value, one.low, one.high)]
    known = [end for end in ends if np.isfinite(end)]
    axes.set_xlim(min(0.0, *known), 1.04 * max(0.1, *known))
    axes.axvline(0.0, color="0.5", linewidth=0.6)


def draw_inputs(store: Store) -> Figure | None:
    """Draw what the inputs were, of the first few, beside what they are drawn from."""
    inputs = [one for one in store.definition.plan.inputs if one.distribution.is_numeric]
    inputs = inputs[:_MOST_INPUTS]
    if not inputs:
        return None
    table = store.table([one.column for one in inputs])
    columns = min(len(inputs), 4)
    rows = -(-len(inputs) // columns)
    figure = new_figure(2.9 * columns, 2.1 * rows + 0.3)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for number, (axes, one) in enumerate(zip(panels, inputs, strict=False)):
        values = table[one.column].to_numpy().astype(float)
        _, edges, _ = axes.hist(values, bins=24, color=EAST["color"], alpha=0.5)
        if one.distribution.kind == "normal" and len(values):
            mean, spread = one.distribution.moments
            expected = np.diff([cumulative_normal((edge - mean) / spread) for edge in edges])
            axes.plot((edges[1:] + edges[:-1]) / 2, len(values) * expected, **LINES[2])
        finish(axes, "" if number % columns else "runs")
        axes.set_xlabel(label_of(one.column), fontsize="small")
        axes.tick_params(labelsize="small")
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in panels[len(inputs) :]:
        axes.set_visible(False)
    return figure
