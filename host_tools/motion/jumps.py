"""Finds positions that the vehicle cannot have reached: dropped, or bridged if the shift persists.

Two samples are consistent if their displacement matches their velocities::

    |Δp - v̄ Δt| <= 6 σ + ½ a Δt τ + 8 median

with a = 15 m/s²; v̄ is the mean of both velocities in the file, and τ = Δt; or, if the file has
none, the median of the velocities between seven neighbouring samples, and τ = 3 Δt. `median` is the
typical size of the left side. In addition, no displacement may exceed what the speed limit allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Recording

_ACCELERATION = 15.0  # m/s²
_NEIGHBOURS = 7
_SHORT = 5  # samples: at most this many are dropped at either end
_AWAY = 20  # samples; and
_AWAY_S = 10.0  # how long positions may be off before they return
_BRIDGED = 2.0  # m/s², largest acceleration while bridging a shift
_LONGEST_BRIDGE_S = 120.0


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

    def pair_fits(self, first: int, last: int) -> bool:
        return bool(self.fits(np.array([first]), np.array([last]))[0])


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
    given = np.isfinite(recording.velocity_n).all(axis=1)
    velocity = _neighbours_velocity(recording.time_s, position)
    from_file = bool(given.all())
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
    """Runs of consistent samples: kept runs, dropped runs, and shifts."""

    motion: _Motion
    kept: list[tuple[int, int]]
    out: list[tuple[int, int]]
    steps: list[tuple[int, int]]


def _returns(motion: _Motion, last: int, runs: list[tuple[int, int]], at: int) -> int | None:
    """Return the run that continues where sample `last` was, the runs in between being off."""
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
    """Drop positions that are inconsistent with the others, and report them.

    If positions shift for good, those around the shift are dropped, for as long as a vehicle needs
    to cover the distance. If they shift too far for that, all but the longest part is dropped.
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
    """Bridge position shifts; return the parts of the file too far from the longest part."""
    cuts = []
    for last, first in steps:
        off = float(motion.misfit(np.array([last]), np.array([first]))[0])
        # A minimum-jerk move from rest to rest accelerates by at most 5.77 d / T².
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
        recording.report(first, "jump", text, f"everything {side} left out")
    return [part for part in parts if part != longest]
