"""Before and after: what the sensors measured less what was expected of them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.host_tools.calibration.estimation import Estimate
from rrins.host_tools.drawing.style import LINES, finish, give_title, new_figure, quantity


def residuals_figure(found: Estimate) -> Figure:
    """Return the picture: gyros to the left, accelerometers to the right, before above after."""
    figure = new_figure(9.6, 6.4)
    give_title(figure, "Measured less expected, means of 10 s: before and after")
    panels = figure.subplots(2, 2, sharex=True)
    minutes = np.cumsum(found.seconds.duration_s) / 60.0
    for column, (name, one, unit, text) in enumerate(
        (("gyro", found.gyros, DPH, "°/h"), ("accelerometer", found.accelerometers, UG, "µg"))
    ):
        for row, (values, when) in enumerate(((one.before, "before"), (one.after, "after"))):
            axes = panels[row, column]
            _lines(axes, minutes, values / unit)
            give_title(axes, f"{name}s, {when}", "small")
            finish(axes, quantity("residual", text).replace("\n", " "), zero_line=True)
        panels[1, column].set_xlabel("time on the table / min")
    panels[0, 0].legend(loc="best", frameon=False, fontsize="small", ncols=2)
    return figure


def _lines(axes: Axes, minutes: Floats, values: Floats) -> None:
    for k in range(values.shape[1]):
        count = len(values) // 10
        means = np.nanmean(values[: 10 * count, k].reshape(count, 10), axis=1)
        axes.plot(minutes[9 : 10 * count : 10], means, label=f"{k + 1}", **LINES[k % len(LINES)])
