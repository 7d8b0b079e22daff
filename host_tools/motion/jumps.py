"""Finds positions that the vehicle cannot have reached: dropped if the others go on without them.

Two samples are consistent if their displacement matches their velocities::

    |Δp - v̄ Δt| <= 6 σ + ½ a Δt τ + 8 median

with a = 15 m/s²; v̄ is the mean of both velocities in the file, and τ = Δt; or, if the file has
none, the median of the velocities between seven neighbouring samples, and τ = 3 Δt. `median` is the
typical size of the left side. In addition, no displacement may exceed what the speed limit allows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.rounding import rounded

_ACCELERATION = 15.0  # m/s²
_NEIGHBOURS = 7
_AWAY = 20  # samples; and
_AWAY_S = 10.0  # how long positions may be off before they return


@dataclass(frozen=True)
class _Motion:
    """Positions over ground in m, with the data needed to compare them."""

    time_s: Floats
    position: Floats
    velocity: Floats
    deviation: Floats
    slack: float
    from_file: bool
    speed_limit: float

    def misfit(self, first: Integers, last: Integers) -> Floats:
        """Return the distance of samples from where their velocities lead, m."""
        dt = self.time_s[last] - self.time_s[first]
        mean = (self.velocity[first] + self.velocity[last]) / 2
        way = self.position[last] - self.position[first]
        return np.asarray(np.linalg.norm(way - mean * dt[:, None], axis=1))

    def fits(self, first: Integers, last: Integers) -> NDArray[np.bool_]:
        """Return whether pairs of samples are consistent."""
        dt = self.time_s[last] - self.time_s[first]
        noise = 6 * np.hypot(self.deviation[first], self.deviation[last])
        reach = dt if self.from_file else 3 * dt
        limit = noise + 0.5 * _ACCELERATION * dt * reach + 8 * self.slack
        way = np.linalg.norm(self.position[last] - self.position[first], axis=1)
        return np.asarray(
            (self.misfit(first, last) <= limit) & (way <= noise + self.speed_limit * dt)
        )

    def goes_on_at(self, first: int, breaks: Integers) -> int | None:
        """Return where the positions go on that are off from sample `first`; None if they do not.

        `breaks` are the later samples at which they jump.
        """
        near = breaks[breaks <= first + _AWAY]
        near = near[self.time_s[near] - self.time_s[first - 1] <= _AWAY_S]
        back = near[self.fits(np.full_like(near, first - 1), near)]
        return int(back[0]) if len(back) else None


def _neighbours_velocity(time_s: Floats, position: Floats) -> Floats:
    """Return the median velocity around each sample, component by component."""
    links = np.diff(position, axis=0) / np.diff(time_s)[:, None]
    half = _NEIGHBOURS // 2
    padded = np.pad(links, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _NEIGHBOURS, axis=0)
    median = np.median(windows, axis=-1)
    return np.concatenate([median[:1], (median[1:] + median[:-1]) / 2, median[-1:]])


def _motion_of(recording: Recording, speed_limit: float) -> _Motion:
    local = Local(*recording.place[0])
    offsets = local.offsets(recording.place)
    position = offsets * local.stretch(offsets)
    position[:, 2] = offsets[:, 2]
    from_file = bool(np.isfinite(recording.velocity_n).all())
    motion = _Motion(
        recording.time_s,
        position,
        recording.velocity_n if from_file else _neighbours_velocity(recording.time_s, position),
        np.linalg.norm(recording.place_deviation, axis=1),
        0.0,
        from_file,
        speed_limit,
    )
    every = np.arange(len(recording))
    return replace(motion, slack=float(np.median(motion.misfit(every[:-1], every[1:]))))


def drop_jumps(recording: Recording, speed_limit: float) -> None:
    """Drop positions that are off for a while, and report them.

    Raises
    ------
    MotionError
        If positions jump and do not return.
    """
    motion = _motion_of(recording, speed_limit)
    every = np.arange(len(recording))
    breaks = np.flatnonzero(~motion.fits(every[:-1], every[1:])) + 1
    kept = np.ones(len(recording), dtype=bool)
    while len(breaks):
        first, breaks = int(breaks[0]), breaks[1:]
        back = motion.goes_on_at(first, breaks)
        last = first + 1 if back is None else back
        off = motion.misfit(np.full(last - first, first - 1), every[first:last])
        if back is None:
            raise recording.fail(
                f"position jumps by {rounded(off[0])} m and does not return; correct it, cut the "
                "file there, or raise speed_limit_mps or position_deviation_m",
                int(recording.line[first]),
            )
        for k in range(first, back):
            recording.report(k, "jump", f"position is {rounded(off[k - first])} m off")
        kept[first:back] = False
        breaks = breaks[breaks > back]
    recording.keep(kept)
