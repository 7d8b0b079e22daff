"""The picture of what was estimated of each sensor: beside the truth, inside three times sigma."""

from __future__ import annotations

from matplotlib.figure import Figure

from rrins.host_tools.drawing.style import LINES, finish, give_title, new_figure, quantity
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.results.sensor_errors import CONSTANTS, KINDS, estimated

_SIGMAS = 3.0


def draw_constants(estimator: JsonObject, title: str) -> Figure:
    """Return bias, scale factors and installation errors of each sensor: estimated, and true.

    Parameters
    ----------
    estimator : dict
        Key `estimator` of a run's summary, with constants; the truth is left out where it is null.
    """
    figure = new_figure(9.0, 8.6)
    panels = figure.subplots(1 + len(CONSTANTS), len(KINDS), squeeze=False)
    give_title(figure, f"{title}\nestimated with ±3σ (bars) and true (crosses)")
    for column, kind in enumerate(KINDS):
        for row, found in enumerate(estimated(kind, estimator["sensors"][kind])):
            error, values, sigma, true = found
            axes = panels[row, column]
            numbers = range(1, len(values) + 1)
            spread = [_SIGMAS * one for one in sigma]
            axes.errorbar(numbers, values, spread, fmt="o", markersize=3.5, capsize=4, **_colour(0))
            if true is not None:
                axes.plot(numbers, true, "x", markersize=8, **_colour(1))
            finish(axes, quantity(error.label, error.unit), zero_line=True)
            axes.set_xlim(0.5, len(values) + 0.5)
            axes.set_xticks(list(numbers))
        panels[0, column].set_title(kind, fontsize="medium")
        panels[-1, column].set_xlabel("sensor")
    figure.align_ylabels()
    return figure


def _colour(line: int) -> dict[str, str]:
    return {"color": str(LINES[line]["color"])}
