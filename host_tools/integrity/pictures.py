"""The Stanford diagram as a picture: a panel for each bound."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from rrins.host_tools.drawing.style import LINES, finish, give_title, new_figure
from rrins.host_tools.integrity.stanford import SCALES, Counts, Scale


def stanford_figure(counts: Counts, alerts: Sequence[float]) -> Figure:
    """Return the picture.

    Parameters
    ----------
    counts : array
        As of `stanford.counts_of`.
    alerts : sequence of float
        Alert limit of each bound, in the unit of its scale.
    """
    figure = new_figure(12.0, 4.6)
    give_title(figure, "Error against protection level: seconds")
    panels = figure.subplots(1, len(SCALES))
    norm = LogNorm(1, max(10, int(counts.max(initial=0))))
    for axes, scale, of_scale, alert in zip(panels, SCALES, counts, alerts, strict=True):
        edges = scale.edges
        shown = np.ma.masked_equal(of_scale.T, 0)
        axes.pcolormesh(edges, edges, shown, cmap="Greys", norm=norm)
        _finish(axes, scale, alert)
    figure.colorbar(ScalarMappable(norm, "Greys"), ax=panels, label="seconds", fraction=0.03)
    return figure


def _finish(axes: Axes, scale: Scale, alert: float) -> None:
    ends = scale.edges[0], scale.edges[-1]
    axes.plot(ends, ends, label="error = level", **LINES[1])
    limit = LINES[0] | {"label": f"alert limit, {alert:g} {scale.unit}"}
    axes.axhline(alert, **limit)
    axes.axvline(alert, **(LINES[0] | {"linewidth": 0.7}))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(ends)
    axes.set_ylim(ends)
    axes.set_xlabel(f"error / {scale.unit}")
    finish(axes, f"protection level / {scale.unit}")
    axes.text(0.97, 0.03, "misleading", transform=axes.transAxes, ha="right", fontsize="small")
    axes.text(0.03, 0.9, "not available", transform=axes.transAxes, fontsize="small")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.08), fontsize="x-small")
    give_title(axes, scale.name, "small")
