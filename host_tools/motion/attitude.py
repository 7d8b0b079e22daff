"""Attitude of a recorded vehicle: from its file, or along the track.

Along the track, heading is the direction of motion and pitch its climb angle; roll is zero. Below
1 m/s the direction is unobservable, and in a gap of the file the path is made up: heading and pitch
are held while the vehicle is at rest, and blend into those of the next motion over the distance
covered. Before and after the file they are held, as are the angles of a file that has them. If
the direction of motion turns by more than 120° across a stop, the vehicle has changed between
forward and reverse; of the two interpretations, the one with the shorter distance in reverse is
used.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.host_tools.motion.bridges import covered, held_angles
from rrins.host_tools.motion.local import Local
from rrins.host_tools.motion.recording import Recording
from rrins.host_tools.motion.spline import Fit, Grid, Observations, evaluate

_ANGLE_DENSITY = 1.0  # rad/s³/√Hz, of angles from a file
_HEADING_DENSITY = 0.3  # along a track
_PITCH_DENSITY = 0.02
_SLOW = 1.0  # m/s
_STANDING = 0.1  # m/s
_FLIP = math.radians(120)
_PER_PIECE = 2  # points of the track
_VELOCITY_DEVIATION = 0.03  # m/s, across the track
_HELD_DEVIATION = 0.02  # rad


def fit_angles(grid: Grid, times: Floats, recording: Recording) -> Floats:
    """Return the coefficients of roll, pitch and heading (rad) from the file.

    `times` are those of the recording in the trajectory, s.
    """
    given = np.isfinite(recording.attitude).all(axis=1)
    columns = []
    for axis in range(3):
        fit = Fit(grid, _ANGLE_DENSITY)
        held = held_angles(
            times[given], recording.attitude[given, axis], grid.pieces * grid.step_s, grid.step_s
        )
        fit.add(held)
        fit.add(
            Observations(
                times[given] / grid.step_s,
                recording.attitude[given, axis],
                recording.attitude_deviation[given, axis],
            )
        )
        columns.append(fit.solve())
    return np.stack(columns, axis=1)


def _spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the bounds (end excluded) of each run of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _wrapped(angle: Floats) -> Floats:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _reversing(
    moving: list[tuple[int, int]], course: Floats, speed: Floats, seen: NDArray[np.bool_]
) -> list[bool]:
    """Return whether each span of motion is driven in reverse; in a gap it may have turned."""
    flags = [False]
    for (_, end), (begin, _) in pairwise(moving):
        turned = abs(float(_wrapped(course[begin] - course[end - 1])))
        flags.append(flags[-1] != (turned > _FLIP and bool(seen[end:begin].all())))
    way = [float(speed[first:last].sum()) for first, last in moving]
    backwards = sum(w for w, flag in zip(way, flags, strict=True) if flag)
    return [not flag for flag in flags] if backwards > sum(way) / 2 else flags


def _held(angle: Floats, speed: Floats, moving: list[tuple[int, int]]) -> None:
    """Fill in an angle where it is unobservable, in place, by the distance crept."""
    angle[: moving[0][0]] = angle[moving[0][0]]
    angle[moving[-1][1] :] = angle[moving[-1][1] - 1]
    for (_, end), (begin, _) in pairwise(moving):
        crept = np.cumsum(np.maximum(speed[end:begin] - _STANDING, 0.0))
        share = crept / crept[-1] if len(crept) and crept[-1] > 0 else np.zeros_like(crept)
        angle[end:begin] = angle[end - 1] + share * (angle[begin] - angle[end - 1])


def track_attitude(
    grid: Grid, local: Local, path: Floats, times: Floats
) -> tuple[Floats, list[str]]:
    """Return coefficients of roll, pitch and heading (rad) along a path, and notes.

    Parameters
    ----------
    grid : Grid
    local : Local
    path : array, shape (pieces + 5, 3)
        Coefficients of east, north, up in m.
    times : array, shape (m,)
        Of the file's positions, s.
    """
    at = np.arange(grid.pieces * _PER_PIECE + 1) / _PER_PIECE
    offsets = evaluate(path, at)
    slopes = evaluate(path, at, grid.step_s, 1)
    velocity = slopes * local.stretch(offsets)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    coefficients = np.zeros((len(path), 3))
    seen = covered(times, at * grid.step_s)
    moving = _spans((speed > _SLOW) & seen)
    if not moving:
        return coefficients, ["never faster than 1 m/s: heading, pitch and roll are 0"]

    course = np.arctan2(velocity[:, 0], velocity[:, 1])
    backwards = _reversing(moving, course, speed, seen)
    heading, pitch = course.copy(), np.arctan2(velocity[:, 2], speed)
    for (first, last), flag in zip(moving, backwards, strict=True):
        if flag:
            heading[first:last] += math.pi
            pitch[first:last] *= -1
    known = np.concatenate([np.arange(first, last) for first, last in moving])
    heading[known] = np.unwrap(heading[known])
    _held(heading, speed, moving)
    _held(pitch, speed, moving)
    deviation = np.where(
        (speed > _SLOW) & seen,
        _VELOCITY_DEVIATION / np.maximum(speed, _SLOW),
        _HELD_DEVIATION,
    )
    for column, angle, density in ((1, pitch, _PITCH_DENSITY), (2, heading, _HEADING_DENSITY)):
        fit = Fit(grid, density)
        fit.add(Observations(at, angle, deviation))
        coefficients[:, column] = fit.solve()
    notes = ["the file has no attitude: heading and pitch follow the track, roll is 0"]
    spans = [span for span, flag in zip(moving, backwards, strict=True) if flag]
    if spans:
        begin, end = (at[k] * grid.step_s for k in (spans[0][0], spans[0][1] - 1))
        more = f", {len(spans)} times in total" if len(spans) > 1 else ""
        notes.append(f"assumed to be reversing from {begin:.0f} s to {end:.0f} s{more}")
    return coefficients, notes
