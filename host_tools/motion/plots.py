"""Plots of a motion; lines differ in dash as well as colour, so they remain distinct in grey."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rrins.compiled.record import Floats
from rrins.host_tools.drawing.style import (
    LINES,
    draw_line,
    draw_track,
    finish,
    give_title,
    legend_above,
    new_figure,
    quantity,
    time_axis,
)
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.smoothing import Smoothed
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, VELOCITY_N, Trajectory
from rrins.host_tools.rounding import rounded

_MOST_SAMPLES = 400_000
_SAMPLES_HZ = 20
_SINCE_MOTION = "time since the motion began"
_PREFIXES = ((0.2, 1.0, ""), (2e-4, 1e3, "m"), (0.0, 1e6, "µ"))


def _over_ground(state: Floats) -> Floats:
    """Return east, north, up in m from the start."""
    local = Local(*state[0, PLACE])
    offsets = local.offsets(state[:, PLACE])
    return np.asarray(offsets * local.stretch(offsets / 2))


def _track(axes: Axes, ground: Floats) -> None:
    factor, unit = (1e-3, "km") if np.ptp(ground[:, :2], axis=0).max() > 3000 else (1.0, "m")
    east, north = ground[:, 0] * factor, ground[:, 1] * factor
    draw_track(axes, east, north, "begin", "end")
    axes.set_xlabel(f"east / {unit}")
    axes.set_ylabel(f"north / {unit}")


@dataclass(frozen=True)
class _Panel:
    """Content of a panel: its quantity and unit, its lines' values in columns, their names."""

    what: str
    unit: str
    values: Callable[[Floats], Floats]
    names: tuple[str | None, ...] = (None,)

    def draw(self, axes: Axes, times: Floats, state: Floats) -> None:
        for name, column, style in zip(self.names, self.values(state).T, LINES, strict=False):
            draw_line(axes, times, column, label=name, **style)
        finish(axes, quantity(self.what, self.unit))
        if len(self.names) > 1:
            legend_above(axes, len(self.names))


_AXES = ("east", "north", "up")
_ANGLES = (
    _Panel("roll, pitch", "°", lambda s: np.degrees(s[:, ATTITUDE][:, 1::-1]), ("pitch", "roll")),
    _Panel("heading", "°", lambda s: np.degrees(s[:, ATTITUDE][:, 2:])),
)
_DRIVE = (
    _Panel("speed", "m/s", lambda s: np.linalg.norm(s[:, VELOCITY_N], axis=1)[:, None]),
    _Panel("height", "m", lambda s: s[:, PLACE][:, 2:]),
    *_ANGLES,
)
_SWAY = (_Panel("from calm water", "m", _over_ground, _AXES), *_ANGLES)


def _sampled(trajectory: Trajectory, end_s: float) -> tuple[Floats, Floats]:
    times = np.linspace(0.0, end_s, min(_MOST_SAMPLES, int(end_s * _SAMPLES_HZ) + 2))
    return times, trajectory.at(times)


def _draw_sway(trajectory: Trajectory, end_s: float, title: str) -> Figure:
    times, state = _sampled(trajectory, end_s)
    figure = new_figure(9.0, 1.9 * len(_SWAY))
    give_title(figure, title)
    panels = figure.subplots(len(_SWAY), 1, sharex=True)
    for axes, panel in zip(panels, _SWAY, strict=True):
        panel.draw(axes, times, state)
    time_axis(panels[-1], _SINCE_MOTION)
    figure.align_ylabels()
    return figure


def draw_motion(trajectory: Trajectory, title: str) -> Figure:
    """Plot track, speed, height and attitude over time; for sway, the first five minutes."""
    if trajectory.loop_from is not None:
        return _draw_sway(trajectory, min(trajectory.duration_s, 300.0), title)
    times, state = _sampled(trajectory, trajectory.duration_s)
    figure = new_figure(11.0, 7.0)
    give_title(figure, title)
    grid = figure.add_gridspec(4, 2, width_ratios=(4, 6))
    _track(figure.add_subplot(grid[:, 0]), _over_ground(state))
    axes = None
    for k, panel in enumerate(_DRIVE):
        axes = figure.add_subplot(grid[k, 1], sharex=axes)
        panel.draw(axes, times, state)
        axes.tick_params(labelbottom=k == 3)
    assert axes is not None
    time_axis(axes, _SINCE_MOTION)
    return figure


def draw_check(recording: Recording, smoothed: Smoothed) -> Figure:
    """Plot track, speed, height and attitude of a smoothed recording, and the residuals."""
    trajectory, residuals = smoothed.trajectory, smoothed.residuals
    times, state = _sampled(trajectory, trajectory.duration_s)
    figure = new_figure(11.0, 11.0)
    give_title(figure, f"Motion recorded in {recording.path.name}, smoothed")
    grid = figure.add_gridspec(6, 2, width_ratios=(4, 6))
    _track(figure.add_subplot(grid[:, 0]), _over_ground(state))
    first = figure.add_subplot(grid[0, 1])
    panels = [first, *(figure.add_subplot(grid[k, 1], sharex=first) for k in range(1, 6))]
    for axes, panel in zip(panels, _DRIVE, strict=False):
        panel.draw(axes, times, state)
    speed, position, velocity = panels[0], panels[4], panels[5]
    for axes, values, what, unit in (
        (position, residuals.position, "position,\nsmoothed - file", "m"),
        (velocity, residuals.velocity, "velocity,\nsmoothed - file", "m/s"),
    ):
        largest = float(np.max(np.abs(values), initial=0.0))
        factor, prefix = next((f, p) for above, f, p in _PREFIXES if largest >= above)
        for column, name, style in zip(values.T, _AXES, LINES, strict=False):
            rms = float(np.sqrt(np.mean(np.square(column)))) * factor if len(column) else 0.0
            label = f"{name} (rms {rounded(rms, 2)} {prefix}{unit})"
            thin = style | {"linewidth": 0.6}
            draw_line(axes, residuals.time_s, column * factor, label=label, **thin)
        finish(axes, quantity(what, f"{prefix}{unit}"))
        legend_above(axes, 3)
    if not recording.has_velocity:
        velocity.text(
            0.5, 0.4, "no velocity in the file", ha="center", transform=velocity.transAxes
        )
    lines = {irregular.line for irregular in recording.irregularities}
    marks = residuals.time_s[
        np.searchsorted(residuals.line, sorted(lines)).clip(0, len(residuals.line) - 1)
    ]
    for axes in panels:
        axes.set_xlim(0, trajectory.duration_s)
        axes.tick_params(labelbottom=axes is velocity)
    if lines:
        low = speed.get_ylim()[0]
        speed.plot(
            marks, np.full(len(marks), low), "k|", markersize=9, label="irregularity", clip_on=False
        )
        legend_above(speed, 1)
    time_axis(velocity, _SINCE_MOTION)
    return figure
