"""Before and after: what the sensors measured less what was expected of them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rrins.compiled.record import Floats
from rrins.host_tools.calibration.estimation import Estimate
from rrins.host_tools.calibration.file import both
from rrins.host_tools.drawing.style import (
    LINES,
    finish,
    give_title,
    legend_above,
    new_figure,
    strips,
)
from rrins.host_tools.rounding import labelled
from rrins.host_tools.runs.results.sensor_errors import KINDS

_MEAN_OF = 10


def residuals_figure(found: Estimate) -> Figure:
    """Return the picture: gyros to the left, accelerometers to the right, before above after."""
    figure = new_figure(10.4, 7.6)
    give_title(figure, "Measured less expected, means of 10 s: before and after the calibration")
    panels = figure.subplots(2, 2, sharex=True)
    minutes = _means(np.cumsum(found.seconds.duration_s)[:, None])[:, 0] / 60.0
    for column, (kind, one, units) in enumerate(both(found)):
        name, unit = kind.removesuffix("s"), KINDS[kind].unit
        before, after = (_means(values / units[0]).T for values in (one.before, one.after))
        names = [f"{name} {k + 1}" for k in range(len(before))]
        _draw_before(panels[0, column], minutes, before, names)
        limit = 1.2 * float(np.nanmax(np.abs(after), initial=1e-9))
        middles = strips(panels[1, column], names, limit)
        for middle, values in zip(middles, after, strict=True):
            panels[1, column].plot(minutes, middle + values, **LINES[0])
        for axes, when in zip(panels[:, column], ("before", "after"), strict=True):
            give_title(axes, f"{kind}, {when}", "small")
            finish(axes, labelled("residual", unit))
        panels[0, column].axhline(0.0, color="0.5", linewidth=0.6, zorder=0)
        panels[1, column].grid(visible=False, axis="y")
        panels[1, column].set_xlabel("time on the table / min")
    return figure


def _means(values: Floats) -> Floats:
    """Return the means of each `_MEAN_OF` rows."""
    count = len(values) // _MEAN_OF
    grouped = values[: _MEAN_OF * count].reshape(count, _MEAN_OF, -1)
    return np.asarray(np.nanmean(grouped, axis=1))


def _draw_before(axes: Axes, minutes: Floats, lines: Floats, names: list[str]) -> None:
    for k, (values, name) in enumerate(zip(lines, names, strict=True)):
        axes.plot(minutes, values, label=name, **LINES[k % len(LINES)])
    legend_above(axes)
