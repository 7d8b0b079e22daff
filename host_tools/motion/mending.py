"""Finds what cannot be in a recorded motion, and leaves it out or refuses it."""

from __future__ import annotations

from bisect import bisect_left
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from host_tools.motion.errors import MotionError
from host_tools.motion.jumps import find_jumps
from host_tools.motion.recording import Irregularity, Recording
from host_tools.motion.settings import Motion
from host_tools.motion.spline import Vector

LEAST_SAMPLES = 8
LEAST_SPAN_S = 2.0
LONGEST_SPAN_S = 43_200.0
LONGEST_GAP_S = 600.0
LONGEST_INTERVAL_S = 10.0
_STRAY = 5  # samples: no more than these beyond a gap are a mistake of the clock
_LEAST_SHARE = 1 / 3  # of the lines that must be of use


def _increasing(times: Vector) -> NDArray[np.bool_]:
    """Return which samples to keep so that times rise and the fewest are lost.

    The longest strictly increasing subsequence, by patience sorting.
    """
    if (np.diff(times) > 0).all():
        return np.ones(len(times), dtype=bool)
    ends: list[float] = []  # the least time that a subsequence of each length ends with
    samples: list[int] = []
    before = np.full(len(times), -1)
    for k, time in enumerate(times.tolist()):
        at = bisect_left(ends, time)
        if at > 0:
            before[k] = samples[at - 1]
        if at == len(ends):
            ends.append(time)
            samples.append(k)
        elif time < ends[at]:
            ends[at], samples[at] = time, k
    kept = np.zeros(len(times), dtype=bool)
    k = samples[-1]
    while k >= 0:
        kept[k] = True
        k = int(before[k])
    return kept


def _order(recording: Recording) -> None:
    """Leave out lines whose time does not rise."""
    times, lines = recording.time_s, recording.line
    kept = _increasing(times)
    places = np.flatnonzero(kept)
    for k in np.flatnonzero(~kept).tolist():
        at = int(np.searchsorted(places, k))
        around = places[max(at - 1, 0) : at + 1]
        if (times[around] == times[k]).any():
            recording.report(k, "repeated_time", "time is there twice")
        elif at and times[k] < times[around[0]]:
            text = f"{times[around[0]] - times[k]:.6g} s before that of line {lines[around[0]]}"
            recording.report(k, "backward_time", f"time is {text}")
        else:
            text = f"{times[k] - times[around[-1]]:.6g} s after that of line {lines[around[-1]]}"
            recording.report(k, "backward_time", f"time is {text}")
    recording.keep(kept)


def _stray(recording: Recording) -> None:
    """Leave out the few samples beyond a gap that nobody waits for, or give up."""
    long = np.flatnonzero(np.diff(recording.time_s) > LONGEST_GAP_S)
    if not len(long):
        return
    count = len(recording)
    bounds = [0, *(long + 1), count]
    first, last = max(pairwise(bounds), key=lambda run: run[1] - run[0])
    if count - (last - first) > _STRAY:
        at = int(long[0])
        gap = recording.time_s[at + 1] - recording.time_s[at]
        raise recording.fail(
            f"gap of {gap:.6g} s, longer than the {LONGEST_GAP_S:g} s that can be bridged",
            int(recording.line[at + 1]),
        )
    kept = np.zeros(count, dtype=bool)
    kept[first:last] = True
    for k in np.flatnonzero(~kept).tolist():
        recording.report(k, "gap", f"time lies more than {LONGEST_GAP_S:g} s off the others")
    recording.keep(kept)


def _gaps(recording: Recording, interval_s: float) -> None:
    """Report where samples are missing, unless by lines that have been left out."""
    times = recording.time_s
    reported = np.unique([irregular.line for irregular in recording.irregularities])
    for k in np.flatnonzero(np.diff(times) > 1.5 * interval_s).tolist():
        gap = times[k + 1] - times[k]
        # A line beside them may have been meant to stand between them.
        between = (recording.line[k] - 1, recording.line[k + 1] + 2)
        first, last = np.searchsorted(reported, between)
        if round(gap / interval_s) - 1 > last - first:
            text = f"gap of {gap:.6g} s, usual are {interval_s:.6g} s"
            recording.report(k + 1, "gap", text, "bridged")


def _check_size(recording: Recording) -> None:
    """Raise unless enough is left of the file to be a motion."""
    count = len(recording)
    bad = sorted(recording.irregularities, key=lambda irregular: irregular.line)
    first = f"; line {bad[0].line}: {bad[0].text}" if bad else ""
    if count < LEAST_SAMPLES:
        raise recording.fail(f"{count} samples, needs {LEAST_SAMPLES}{first}")
    if count < _LEAST_SHARE * recording.lines:
        raise recording.fail(f"only {count} of {recording.lines} lines can be used{first}")
    span = float(recording.time_s[-1] - recording.time_s[0])
    if span < LEAST_SPAN_S:
        raise recording.fail(f"spans {span:.3g} s, needs {LEAST_SPAN_S:g} s")
    if span > LONGEST_SPAN_S:
        raise recording.fail(
            f"spans {span:.6g} s, can be {LONGEST_SPAN_S:g} s; duration_s takes a part of it"
        )
    interval = interval_of(recording)
    if interval > LONGEST_INTERVAL_S:
        raise recording.fail(
            f"a position every {interval:.3g} s; needs one every {LONGEST_INTERVAL_S:g} s"
        )


def interval_of(recording: Recording) -> float:
    """Return the usual interval between samples, s."""
    return float(np.median(np.diff(recording.time_s)))


def mend(recording: Recording, motion: Motion) -> None:
    """Leave out what cannot be; report each in `Recording.irregularities`, in order of lines.

    Parameters
    ----------
    recording : Recording
        Changed in place: afterwards its times rise and its positions can be driven.
    motion : Motion
        Tells the limit of speed, and how much of the file is wanted.

    Raises
    ------
    MotionError
        When what is left is no motion.
    """
    if len(recording):
        _order(recording)
        if motion.duration_s is not None:
            recording.keep(recording.time_s <= recording.time_s[0] + motion.duration_s)
        _stray(recording)
    _check_size(recording)
    _gaps(recording, interval_of(recording))
    find_jumps(recording, motion.speed_limit_mps)
    _check_size(recording)
    recording.irregularities.sort(key=lambda irregular: irregular.line)


def refusal(irregularities: list[Irregularity], path: object) -> MotionError | None:
    """Return the error for a file that is to be refused; None if nothing is wrong with it."""
    if not irregularities:
        return None
    first = irregularities[0]
    others = len(irregularities) - 1
    more = f" (and {others} more)" if others else ""
    return MotionError(
        f"motion {path}: line {first.line}: {first.text}{more}; "
        '`irregularities = "mend"` takes it all the same'
    )
