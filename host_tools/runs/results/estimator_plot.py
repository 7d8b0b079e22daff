"""The picture of the estimator: the navigation's errors inside three times what it promises."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.estimator_records import EstimatorSecond
from rrins.host_tools.drawing import style
from rrins.host_tools.runs.results.estimates import BANDS
from rrins.host_tools.runs.results.results import Errors

_SIGMAS = 3.0
_SIDES = ("east", "north", "up")

_Vector = NDArray[np.float64]


def draw_estimates(
    seconds: Records[EstimatorSecond], errors: Errors, begin_epoch: float, rate_hz: int, title: str
) -> Figure:
    """Return errors of attitude, velocity and position in n over time, in bands of ±3σ.

    Before navigation, in the fine alignment, there are bands alone.

    Parameters
    ----------
    seconds : array of `EstimatorSecond`
        Not empty.
    begin_epoch : float
        When navigation began.
    """
    time_s = (seconds["epoch"] - begin_epoch) / rate_hz
    panels: list[tuple[str, str, _Vector, _Vector]] = []
    for band in BANDS:
        sigma = seconds[band.sigma] / band.size * band.factor
        for k, name in enumerate(band.errors):
            if sigma[:, k].any() or k < 2:
                values = getattr(errors, name) * band.factor
                panels.append((band.label.format(_SIDES[k]), band.unit, sigma[:, k], values))
    figure = style.new_figure(9.0, 1.7 * len(panels) + 0.6)
    rows = figure.subplots(len(panels), 1, sharex=True)
    style.give_title(figure, f"{title}\nerrors (line) and ±3σ of the estimator (band)")
    for axes, (label, unit, sigma, values) in zip(rows, panels, strict=True):
        _draw(axes, time_s, sigma, errors, values)
        style.finish(axes, style.quantity(label, unit), zero_line=True)
    style.time_axis(rows[-1])
    figure.align_ylabels()
    return figure


def _draw(axes: Axes, time_s: _Vector, sigma: _Vector, errors: Errors, values: _Vector) -> None:
    times, band = style.thinned(time_s, _SIGMAS * sigma)
    axes.fill_between(times, -band, band, color="0.87", linewidth=0)
    for side in (-band, band):
        axes.plot(times, side, color="0.35", linewidth=0.8)
    style.draw_line(axes, errors.time_s, values, **style.LINES[0])
    in_navigation = band[times >= 0]
    largest = float(np.max(np.abs(values), initial=0.0))
    limit = 1.15 * max(float(np.max(in_navigation, initial=0.0)), largest)
    if limit > 0:  # the fine alignment begins far outside
        axes.set_ylim(-limit, limit)
