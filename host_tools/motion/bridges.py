"""Substitutes where a file has no samples: before it, after it, and in its gaps.

The vehicle gathers speed before the file and comes to rest after it along a straight line, at
1 m/s² on average; the velocity is the cubic that begins and ends without acceleration::

    v(τ) = v_0 (1 + 2 u) (1 - u)²,  u = τ / T,  τ: time from the file

Its attitude is held there. In a gap it passes from one end's to the other's without overshoot.
A spline is guided by points of these: alone, it would extrapolate, and be ill-conditioned.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Irregularity, Recording
from rrins.host_tools.motion.spline import Observations
from rrins.host_tools.rounding import rounded

MOVING_MPS = 0.5
"""A file with a higher speed at either end begins or ends in motion."""

ATTITUDE_GAP_S = 3.0
"""Across a longer time without samples, and 1.5 typical intervals, the attitude is held."""

_RUN_UP = 1.0  # m/s², mean
_LEAST_RUN_UP_S = 2.0
_EDGE_S = 1.0  # span over which the speed at an end is measured
_GUIDED_S = 60.0  # positions: longer gaps get guide points
_GUIDE_DEVIATION = 1.0  # m
_LONGEST_CLIMB = 100.0  # m, of a run, unless levelling off at 1 m/s² takes more
_DRIFT = 0.1  # m/s: how fast a run may leave its straight line
_RUN_POINTS = 40  # guide points of a run, where they are neither closer nor farther apart than
_CLOSEST_S, _FARTHEST_S = 1.0, 30.0
_GAP_INTERVALS = 1.5
_MARGIN_S = 1.0  # from the file to the first guide point of an angle
_ANGLE_STEP_S = 0.25
_ANGLE_DEVIATION = 0.02  # rad


def edge_velocities(recording: Recording) -> tuple[Floats, Floats]:
    """Return the velocities at the start and end of the file: east, north, up, m/s."""
    return _edge_velocity(recording, first=True), _edge_velocity(recording, first=False)


def _edge_velocity(recording: Recording, first: bool) -> Floats:
    times = recording.time_s
    edge = times <= times[0] + _EDGE_S if first else times >= times[-1] - _EDGE_S
    if edge.sum() < 3:
        edge = np.zeros(len(times), dtype=bool)
        edge[slice(0, 3) if first else slice(-3, None)] = True
    given = recording.velocity_n[edge]
    given = given[np.isfinite(given).all(axis=1)]
    if len(given):
        return np.asarray(given.mean(axis=0))
    local = Local(*recording.place[0])
    offsets = local.offsets(recording.place[edge])
    slopes = np.polyfit(times[edge] - times[edge][0], offsets, 1)[0]
    return np.asarray(slopes * local.stretch(offsets[-1:])[0])


def run_s(speed: float) -> float:
    """Return how long the vehicle takes to gather a speed, or to come to rest from it."""
    return max(_LEAST_RUN_UP_S, speed / _RUN_UP)


def begins_or_ends_in_motion(recording: Recording) -> list[Irregularity]:
    """Return the irregularities of a file that is not at rest at its ends."""
    found = []
    for at, word, added, velocity in zip(
        (0, -1),
        ("begins", "ends"),
        ("run-up", "run-down"),
        edge_velocities(recording),
        strict=True,
    ):
        speed = float(np.linalg.norm(velocity))
        if speed > MOVING_MPS:
            text = f"{word} in motion, at {rounded(speed)} m/s"
            mended = f"{added} of {rounded(run_s(speed))} s added"
            found.append(Irregularity(int(recording.line[at]), "motion", text, mended))
    return found


def _levelling_s(climb: float) -> float:
    """Return how long a climb or descent takes to level off."""
    return max(run_s(climb), 2 * _LONGEST_CLIMB / climb if climb > 0 else math.inf)


def runs(
    recording: Recording, local: Local, times: Floats, axis: int, step_s: float
) -> Iterator[Observations]:
    """Yield guide points of one axis along the run-up and the run-down, in m.

    A climb of more than 100 m levels off earlier, so that it does not begin far below the ground.
    `times` are those of the file in the trajectory (s), `step_s` is the length of a piece.
    """
    for at, sign, velocity in zip((0, -1), (-1.0, 1.0), edge_velocities(recording), strict=True):
        speed = float(np.linalg.norm(velocity))
        if speed <= MOVING_MPS:
            continue
        length = run_s(speed)
        offset = local.offsets(recording.place[at][None])
        slope = (velocity / local.stretch(offset)[0])[axis]
        own = length if axis < 2 else min(length, _levelling_s(abs(velocity[2])))
        spacing = min(max(length / _RUN_POINTS, _CLOSEST_S), _FARTHEST_S)
        tau = np.linspace(0.0, length, max(2, math.ceil(length / spacing)) + 1)[1:]
        u = np.minimum(tau / own, 1.0)
        way = sign * slope * own * (u - u**3 + u**4 / 2)
        yield Observations(
            (times[at] + sign * tau) / step_s,
            offset[0, axis] + way,
            _GUIDE_DEVIATION + _DRIFT * tau,
        )


def long_gaps(
    times: Floats, values: Floats, slopes: Floats, step_s: float
) -> Iterator[Observations]:
    """Yield points on cubics across long gaps of the positions of one axis, in m."""
    for k in np.flatnonzero(np.diff(times) > _GUIDED_S):
        length = times[k + 1] - times[k]
        u = np.linspace(0, 1, math.ceil(2 * length / _GUIDED_S) + 1)[1:-1]
        cubic = (
            values[k] * (1 + 2 * u) * (1 - u) ** 2
            + values[k + 1] * u**2 * (3 - 2 * u)
            + length * (slopes[k] * u * (1 - u) ** 2 + slopes[k + 1] * u**2 * (u - 1))
        )
        at = (times[k] + u * length) / step_s
        yield Observations(at, cubic, np.full_like(u, _GUIDE_DEVIATION))


def angle_gaps(times: Floats) -> list[tuple[float, float]]:
    """Return the bounds of the spans between samples across which angles are held, s."""
    if len(times) < 2:
        return []
    longest = max(ATTITUDE_GAP_S, _GAP_INTERVALS * float(np.median(np.diff(times))))
    return [(a, b) for a, b in pairwise(times.tolist()) if b - a > longest]


def held_angles(times: Floats, angle: Floats, end_s: float, step_s: float) -> Observations:
    """Return points of an angle (rad) before and after its samples, and in their gaps.

    Parameters
    ----------
    times, angle : array, shape (m,)
        Samples; s in the trajectory, rad.
    end_s : float
        End of the trajectory.
    step_s : float
        Length of a piece.
    """
    at = np.arange(0.0, end_s, _ANGLE_STEP_S)
    value = np.interp(at, times, angle)
    guided = (at < times[0] - _MARGIN_S) | (at > times[-1] + _MARGIN_S)
    for begin, end in angle_gaps(times):
        inside = (at > begin + _MARGIN_S) & (at < end - _MARGIN_S)
        first, last = np.interp([begin, end], times, angle)
        u = (at[inside] - begin - _MARGIN_S) / (end - begin - 2 * _MARGIN_S)
        value[inside] = first + (last - first) * u**3 * (10 + u * (6 * u - 15))
        guided |= inside
    deviation = np.full(guided.sum(), _ANGLE_DEVIATION)
    return Observations(at[guided] / step_s, value[guided], deviation)


def covered(times: Floats, at: Floats) -> NDArray[np.bool_]:
    """Return which instants the samples cover: within the file and in none of its gaps."""
    inside = (at >= times[0]) & (at <= times[-1])
    for begin, end in angle_gaps(times):
        inside &= (at <= begin) | (at >= end)
    return np.asarray(inside)
