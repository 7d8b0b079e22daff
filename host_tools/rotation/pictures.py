"""Figures 7 and 8 of the paper: the integrated errors of one sensor over a cycle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rrins.compiled.record import Floats
from rrins.host_tools.drawing.saving import write_pictures
from rrins.host_tools.drawing.style import LINES, give_title, new_figure
from rrins.host_tools.rotation.analysis import Integrals, Variation
from rrins.host_tools.rotation.errors import ERRORS
from rrins.host_tools.rounding import labelled

_TITLES = {
    "bias": "bias",
    "MESSF": "symmetric scale factor error (MESSF)",
    "MEASF": "asymmetric scale factor error (MEASF)",
    "MEIE": "installation error (MEIE)",
}
_LABELS = {"gyro": "angle error", "accelerometer": "velocity error"}
_SCALES = ((2.0, 1.0, ""), (2e-3, 1e3, "m"), (2e-6, 1e6, "µ"), (0.0, 1e9, "n"))


def draw(variation: Variation, integrals: Integrals, sensor: int, title: str) -> Figure:
    """Return a figure with a panel for each error of one sensor.

    Parameters
    ----------
    variation : Variation
    integrals : Integrals
        Its gyros or its accelerometers.
    sensor : int
        From 1.
    title : str
    """
    figure = new_figure(9.6, 6.0)
    give_title(figure, title)
    panels = figure.subplots(2, 2, sharex=True)
    for k, (error, axes) in enumerate(zip(ERRORS, panels.flat, strict=True)):
        _panel(axes, variation, integrals.running[:, sensor - 1, k], integrals)
        axes.set_title(_TITLES[error], fontsize="small")
    for axes in panels[1]:
        axes.set_xlabel("time in the cycle / s")
    return figure


def _panel(axes: Axes, variation: Variation, running: Floats, integrals: Integrals) -> None:
    largest = float(np.max(np.abs(running)))
    factor, prefix = next((f, p) for above, f, p in _SCALES if largest > above or above == 0.0)
    for end_s in _position_ends(variation):
        axes.axvline(end_s, color="0.92", linewidth=0.6, zorder=0)
    for j, (axis, line) in enumerate(zip("xyz", LINES, strict=False)):
        axes.plot(variation.time_s, running[:, j] * factor, label=f"${axis}_b$", **line)
    axes.axhline(0.0, color="0.5", linewidth=0.6, zorder=0)
    axes.margins(x=0)
    unit = f"{prefix}{integrals.sensors.unit}"
    axes.set_ylabel(labelled(_LABELS[integrals.sensors.kind], unit))
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.16 * (high - low))
    axes.legend(loc="upper right", frameon=False, ncols=3, fontsize="small", borderaxespad=0.1)


def _position_ends(variation: Variation) -> list[float]:
    ends: dict[int, float] = {}
    time_s = 0.0
    for leg in variation.legs:
        time_s += leg.duration_s
        ends[leg.position] = time_s
    return list(ends.values())[:-1]


def write(
    folder: Path, variation: Variation, sensor: int, scheme: str, geometry: str
) -> list[Path]:
    """Write both figures of one sensor to a folder; return their paths."""
    drawn = {}
    for name, integrals, figure in (
        ("gyro_errors", variation.gyros, 7),
        ("accelerometer_errors", variation.accelerometers, 8),
    ):
        if sensor > len(integrals.sensors):
            continue
        kind = integrals.sensors.kind
        title = (
            f"{kind.capitalize()} {sensor} of the {geometry}, scheme {scheme}, in the body frame"
        )
        title += f" (as the paper's figure {figure})"
        drawn[name] = draw(variation, integrals, sensor, title)
    return write_pictures(folder, drawn)
