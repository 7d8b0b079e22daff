"""Plots of a motion; lines differ in dash as well as colour, so they remain distinct in grey."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rrins.compiled.record import Floats
from rrins.host_tools.drawing.style import LINES, finish, give_title, new_figure, quantity
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.smoothing import Smoothed
from rrins.host_tools.motion.trajectory import ATTITUDE, PLACE, VELOCITY_N, Trajectory

_DrawPanel = Callable[[Axes, Floats, Floats], None]

_FIRST, _SECOND, _THIRD = LINES[:3]
_POINTS = 5000
_SINCE_MOTION = "time since the motion began / s"
_PREFIXES = ((0.2, 1.0, ""), (2e-4, 1e3, "m"), (0.0, 1e6, "µ"))


def _legend(axes: Axes, columns: int) -> None:
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.22 * (high - low))
    axes.legend(loc="upper left", frameon=False, ncols=columns, fontsize="small")


def _over_ground(state: Floats) -> Floats:
    """Return east, north, up in m from the start."""
    local = Local(*state[0, PLACE])
    offsets = local.offsets(state[:, PLACE])
    return np.asarray(offsets * local.stretch(offsets / 2))


def _track(axes: Axes, ground: Floats) -> None:
    factor, unit = (1e-3, "km") if np.ptp(ground[:, :2], axis=0).max() > 3000 else (1.0, "m")
    east, north = ground[:, 0] * factor, ground[:, 1] * factor
    axes.plot(east, north, color=_FIRST["color"], linewidth=1.0)
    axes.plot(east[:1], north[:1], "o", color="black", markersize=6, label="begin")
    axes.plot(
        east[-1:],
        north[-1:],
        "s",
        markerfacecolor="white",
        markeredgecolor="black",
        markersize=7,
        label="end",
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"east / {unit}")
    axes.set_ylabel(f"north / {unit}")
    axes.grid(True, color="0.88", linewidth=0.6)
    axes.legend(loc="best", frameon=False, fontsize="small")


def _speed(axes: Axes, times: Floats, state: Floats) -> None:
    axes.plot(times, np.linalg.norm(state[:, VELOCITY_N], axis=1), **_FIRST)
    finish(axes, quantity("speed", "m/s"))


def _height(axes: Axes, times: Floats, state: Floats) -> None:
    axes.plot(times, state[:, PLACE][:, 2], **_FIRST)
    finish(axes, quantity("height", "m"))


def _roll_and_pitch(axes: Axes, times: Floats, state: Floats) -> None:
    angles = np.degrees(state[:, ATTITUDE])
    axes.plot(times, angles[:, 1], label="pitch", **_FIRST)
    axes.plot(times, angles[:, 0], label="roll", **_SECOND)
    finish(axes, quantity("roll, pitch", "°"))
    _legend(axes, 2)


def _heading(axes: Axes, times: Floats, state: Floats) -> None:
    axes.plot(times, np.degrees(state[:, ATTITUDE][:, 2]), **_FIRST)
    finish(axes, quantity("heading", "°"))


def _offsets(axes: Axes, times: Floats, state: Floats) -> None:
    ground = _over_ground(state)
    for column, name, style in zip(ground.T, ("east", "north", "up"), _STYLES, strict=True):
        axes.plot(times, column, label=name, **style)
    finish(axes, quantity("from calm water", "m"))
    _legend(axes, 3)


_STYLES = (_FIRST, _SECOND, _THIRD)


def _sampled(trajectory: Trajectory, end_s: float) -> tuple[Floats, Floats]:
    times = np.linspace(0.0, end_s, min(_POINTS, int(end_s * 20) + 2))
    return times, trajectory.at(times)


def _draw_panels(
    trajectory: Trajectory, end_s: float, title: str, draw: Sequence[_DrawPanel]
) -> Figure:
    times, state = _sampled(trajectory, end_s)
    figure = new_figure(9.0, 1.9 * len(draw))
    give_title(figure, title)
    panels = figure.subplots(len(draw), 1, sharex=True)
    for axes, draw_panel in zip(panels, draw, strict=True):
        draw_panel(axes, times, state)
    panels[-1].set_xlabel(_SINCE_MOTION)
    figure.align_ylabels()
    return figure


def draw_motion(trajectory: Trajectory, title: str) -> Figure:
    """Plot track, speed, height and attitude over time; for sway, the first five minutes."""
    if trajectory.loop_from is not None:
        end_s = min(trajectory.duration_s, 300.0)
        return _draw_panels(trajectory, end_s, title, (_offsets, _roll_and_pitch, _heading))
    times, state = _sampled(trajectory, trajectory.duration_s)
    figure = new_figure(11.0, 7.0)
    give_title(figure, title)
    grid = figure.add_gridspec(4, 2, width_ratios=(4, 6))
    _track(figure.add_subplot(grid[:, 0]), _over_ground(state))
    panel = None
    for k, draw in enumerate((_speed, _height, _roll_and_pitch, _heading)):
        panel = figure.add_subplot(grid[k, 1], sharex=panel)
        draw(panel, times, state)
        panel.tick_params(labelbottom=k == 3)
    assert panel is not None
    panel.set_xlabel(_SINCE_MOTION)
    return figure


def draw_check(recording: Recording, smoothed: Smoothed) -> Figure:
    """Plot track, speed, height and attitude of a smoothed recording, and the residuals."""
    trajectory, residuals = smoothed.trajectory, smoothed.residuals
    times, state = _sampled(trajectory, trajectory.duration_s)
    figure = new_figure(11.0, 11.0)
    give_title(figure, f"Motion recorded in {recording.path.name}, smoothed")
    grid = figure.add_gridspec(6, 2, width_ratios=(4, 6))
    _track(figure.add_subplot(grid[:, 0]), _over_ground(state))
    panels = [figure.add_subplot(grid[k, 1]) for k in range(6)]
    for axes, draw in zip(panels, (_speed, _height, _roll_and_pitch, _heading), strict=False):
        draw(axes, times, state)
    speed, position, velocity = panels[0], panels[4], panels[5]
    names = ("east", "north", "up")
    for axes, values, what, unit in (
        (position, residuals.position, "position,\nsmoothed - file", "m"),
        (velocity, residuals.velocity, "velocity,\nsmoothed - file", "m/s"),
    ):
        largest = float(np.max(np.abs(values), initial=0.0))
        factor, prefix = next((f, p) for above, f, p in _PREFIXES if largest >= above)
        for column, name, style in zip(values.T, names, _STYLES, strict=True):
            rms = float(np.sqrt(np.mean(np.square(column)))) * factor if len(column) else 0.0
            label = f"{name} (rms {rms:.2g} {prefix}{unit})"
            thin = style | {"linewidth": 0.6}
            axes.plot(residuals.time_s, column * factor, label=label, **thin)
        finish(axes, quantity(what, f"{prefix}{unit}"))
        _legend(axes, 3)
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
        _legend(speed, 1)
    velocity.set_xlabel(_SINCE_MOTION)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, atomically.

    Raises
    ------
    MotionError
        If it cannot be written.
    """
    part = path.with_name(f".{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(part, format="png")
        part.replace(path)
    except OSError as error:
        raise MotionError(f"motion {path}: cannot be written: {error.strerror}") from error
