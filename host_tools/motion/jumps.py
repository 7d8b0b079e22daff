"""Positions that the vehicle cannot have gone to: left out, or bridged where they stay.

Two samples fit together if the way between them is that of their velocities::

    |Δp - v̄ Δt| <= 6 σ + ½ a Δt τ + 8 median

with a = 15 m/s²; v̄ is the mean of both velocities in the file, and τ = Δt; or, where the file has
none, the median of the velocities between seven neighbouring samples, and τ = 3 Δt. `median` is the
usual size of the left side. And no way may be longer than the limit of speed permits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from host_tools.motion.local import Local
from host_tools.motion.recording import Recording
from host_tools.motion.spline import Vector

_ACCELERATION = 15.0  # m/s²
_NEIGHBOURS = 7
_SHORT = 5  # samples: no more than these are left out at either end
_AWAY = 20  # samples; and
_AWAY_S = 10.0  # how long positions may be off and come back
_BRIDGED = 2.0  # m/s², largest acceleration on the way to where positions have shifted to
_LONGEST_BRIDGE_S = 120.0


@dataclass(frozen=True)
class _Motion:
    """Positions over ground in m and what is needed to compare them."""

    time_s: Vector
    position: Vector
    velocity: Vector
    deviation: Vector
    slack: float
    from_file: bool
    speed_limit: float

    def misfit(self, first: NDArray[np.int64], last: NDArray[np.int64]) -> Vector:
        """Return how far samples lie from where their velocities lead to, m."""
        dt = self.time_s[last] - self.time_s[first]
        mean = (self.velocity[first] + self.velocity[last]) / 2
        way = self.position[last] - self.position[first]
        return np.asarray(np.linalg.norm(way - mean * dt[:, None], axis=1))

    def fits(self, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether pairs of samples fit together."""
        dt = self.time_s[last] - self.time_s[first]
        noise = 6 * np.hypot(self.deviation[first], self.deviation[last])
        reach = dt if self.from_file else 3 * dt
        limit = noise + 0.5 * _ACCELERATION * dt * reach + 8 * self.slack
        way = np.linalg.norm(self.position[last] - self.position[first], axis=1)
        return np.asarray(
            (self.misfit(first, last) <= limit) & (way <= noise + self.speed_limit * dt)
        )

    def pair_fits(self, first: int, last: int) -> bool:
        return bool(self.fits(np.array([first]), np.array([last]))[0])


def _neighbours_velocity(time_s: Vector, position: Vector) -> Vector:
    """Return for each sample the median velocity about it, each component for itself."""
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
    told = np.isfinite(recording.velocity_n).all(axis=1)
    velocity = _neighbours_velocity(recording.time_s, position)
    from_file = bool(told.all())
    if from_file:
        velocity = recording.velocity_n
    every = np.arange(len(recording))
    motion = _Motion(
        recording.time_s,
        position,
        velocity,
        np.linalg.norm(recording.place_deviation, axis=1),
        0.0,
        from_file,
        speed_limit,
    )
    slack = float(np.median(motion.misfit(every[:-1], every[1:])))
    return replace(motion, slack=slack)


@dataclass
class _Sorting:
    """Runs of samples that fit together: what is kept, what is left out, where it steps."""

    motion: _Motion
    kept: list[tuple[int, int]]
    out: list[tuple[int, int]]
    steps: list[tuple[int, int]]


def _returns(motion: _Motion, last: int, runs: list[tuple[int, int]], at: int) -> int | None:
    """Return the run that goes on where sample `last` was, those before it being off."""
    for k in range(at + 1, len(runs)):
        begin = runs[k][0]
        too_long = motion.time_s[begin] - motion.time_s[last] > _AWAY_S
        if begin - runs[at][0] > _AWAY or too_long:
            return None
        if motion.pair_fits(last, begin):
            return k
    return None


def _sort(motion: _Motion, runs: list[tuple[int, int]]) -> _Sorting:
    sorting = _Sorting(motion, [runs[0]], [], [])
    at = 1
    while at < len(runs):
        last = sorting.kept[-1][1] - 1
        if not motion.pair_fits(last, runs[at][0]):
            back = _returns(motion, last, runs, at)
            if back is not None:
                sorting.out += runs[at:back]
                at = back
            elif len(sorting.kept) == 1 and sorting.kept[0][1] - sorting.kept[0][0] <= _SHORT:
                sorting.out.append(sorting.kept.pop())
            elif at == len(runs) - 1 and runs[at][1] - runs[at][0] <= _SHORT:
                sorting.out.append(runs[at])
                break
            else:
                sorting.steps.append((last, runs[at][0]))
        sorting.kept.append(runs[at])
        at += 1
    return sorting


def find_jumps(recording: Recording, speed_limit: float) -> None:
    """Leave out positions that do not fit the others, and report them.

    Where positions shift and stay, those about the shift are left out, for as long as a vehicle
    needs to get over; where they shift too far for that, all but the longest part.
    """
    motion = _motion_of(recording, speed_limit)
    every = np.arange(len(recording))
    breaks = np.flatnonzero(~motion.fits(every[:-1], every[1:])) + 1
    if not len(breaks):
        return
    bounds = [0, *breaks.tolist(), len(recording)]
    sorting = _sort(motion, list(pairwise(bounds)))
    kept = np.ones(len(recording), dtype=bool)
    for first, last in sorting.out:
        before = first - 1 if first else last
        for k in range(first, last):
            pair = (before, k) if first else (k, before)
            off = float(motion.misfit(np.array(pair[:1]), np.array(pair[1:]))[0])
            recording.report(k, "jump", f"position is {off:.3g} m off")
        kept[first:last] = False
    for first, last in _apart(recording, motion, sorting.steps, kept):
        kept[first:last] = False
    recording.keep(kept)


def _apart(
    recording: Recording,
    motion: _Motion,
    steps: list[tuple[int, int]],
    kept: NDArray[np.bool_],
) -> list[tuple[int, int]]:
    """Bridge shifts of the position; return parts of the file that are too far from the longest."""
    cuts = []
    for last, first in steps:
        off = float(motion.misfit(np.array([last]), np.array([first]))[0])
        # A way of rest to rest with the least jerk takes 5.77 d / T² at most.
        bridge = math.sqrt(5.77 * off / _BRIDGED)
        text = f"position shifts by {off:.3g} m and stays"
        if bridge > _LONGEST_BRIDGE_S:
            cuts.append((first, text))
            continue
        middle = (motion.time_s[last] + motion.time_s[first]) / 2
        kept &= np.abs(motion.time_s - middle) > bridge / 2
        recording.report(first, "jump", text, f"bridged over {bridge:.2g} s")
    parts = list(pairwise([0, *(first for first, _ in cuts), len(recording)]))
    longest = max(parts, key=lambda part: part[1] - part[0])
    for first, text in cuts:
        side = "before" if first <= longest[0] else "from there on"
        recording.report(first, "jump", text, f"all {side} left out")
    return [part for part in parts if part != longest]
