"""Finds impossible samples in a recorded motion and drops them or refuses the file."""

from __future__ import annotations

from bisect import bisect_left
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats
from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.jumps import find_jumps
from rrins.host_tools.motion.recording import Irregularity, Recording
from rrins.host_tools.scenario.motion import Motion

LEAST_SAMPLES = 8
LEAST_SPAN_S = 2.0
LONGEST_SPAN_S = 43_200.0
LONGEST_GAP_S = 600.0
LONGEST_INTERVAL_S = 10.0
_STRAY = 5  # samples: at most this many beyond a gap count as a clock error
_LEAST_SHARE = 1 / 3  # share of the lines that must be usable


def _increasing(times: Floats) -> NDArray[np.bool_]:
    """Return which samples to keep so that times increase and as few as possible are lost.

    The longest strictly increasing subsequence, by patience sorting.
    """
    if (np.diff(times) > 0).all():
        return np.ones(len(times), dtype=bool)
    ends: list[float] = []  # the smallest final time of a subsequence of each length
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
    """Drop lines whose time does not increase."""
    times, lines = recording.time_s, recording.line
    kept = _increasing(times)
    places = np.flatnonzero(kept)
    for k in np.flatnonzero(~kept).tolist():
        at = int(np.searchsorted(places, k))
        around = places[max(at - 1, 0) : at + 1]
        if (times[around] == times[k]).any():
            recording.report(k, "repeated_time", "duplicate time")
        elif at and times[k] < times[around[0]]:
            text = f"{times[around[0]] - times[k]:.6g} s before that of line {lines[around[0]]}"
            recording.report(k, "backward_time", f"time is {text}")
        else:
            text = f"{times[k] - times[around[-1]]:.6g} s after that of line {lines[around[-1]]}"
            recording.report(k, "backward_time", f"time is {text}")
    recording.keep(kept)


def _cut(recording: Recording, duration_s: float) -> None:
    """Keep only the beginning of the file; what comes after it neither counts nor is reported."""
    kept = recording.time_s <= recording.time_s[0] + duration_s
    if kept.all():
        return
    after = int(recording.line[~kept].min())
    beyond = {i.line for i in recording.irregularities if i.line >= after}
    beyond.difference_update(recording.line.tolist())  # only their velocity or attitude is bad
    recording.lines -= len(beyond) + int((~kept).sum())
    recording.irregularities[:] = [i for i in recording.irregularities if i.line < after]
    recording.keep(kept)


def _stray(recording: Recording) -> None:
    """Drop the few stray samples beyond a gap too long to bridge, or give up."""
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
        recording.report(k, "gap", f"time is more than {LONGEST_GAP_S:g} s away from the others")
    recording.keep(kept)


def _gaps(recording: Recording, interval_s: float) -> None:
    """Report where samples are missing, unless dropped lines explain it."""
    times = recording.time_s
    reported = np.unique([irregular.line for irregular in recording.irregularities])
    for k in np.flatnonzero(np.diff(times) > 1.5 * interval_s).tolist():
        gap = times[k + 1] - times[k]
        # An adjacent dropped line may have belonged in between.
        between = (recording.line[k] - 1, recording.line[k + 1] + 2)
        first, last = np.searchsorted(reported, between)
        if round(gap / interval_s) - 1 > last - first:
            text = f"gap of {gap:.6g} s instead of {interval_s:.6g} s"
            recording.report(k + 1, "gap", text, "bridged")


def _check_size(recording: Recording) -> None:
    """Raise unless enough of the file is left for a motion."""
    count = len(recording)
    bad = sorted(recording.irregularities, key=lambda irregular: irregular.line)
    first = f"; line {bad[0].line}: {bad[0].text}" if bad else ""
    if count < LEAST_SAMPLES:
        raise recording.fail(f"{count} samples, at least {LEAST_SAMPLES} needed{first}")
    if count < _LEAST_SHARE * recording.lines:
        raise recording.fail(f"only {count} of {recording.lines} lines can be used{first}")
    span = float(recording.time_s[-1] - recording.time_s[0])
    if span < LEAST_SPAN_S:
        raise recording.fail(f"spans {span:.3g} s, at least {LEAST_SPAN_S:g} s needed")
    if span > LONGEST_SPAN_S:
        raise recording.fail(
            f"spans {span:.6g} s, at most {LONGEST_SPAN_S:g} s allowed; limit it by duration_s"
        )
    interval = interval_of(recording)
    if interval > LONGEST_INTERVAL_S:
        raise recording.fail(
            f"a position every {interval:.3g} s; at least one every {LONGEST_INTERVAL_S:g} s needed"
        )


def interval_of(recording: Recording) -> float:
    """Return the typical interval between samples, s."""
    return float(np.median(np.diff(recording.time_s)))


def mend(recording: Recording, motion: Motion) -> None:
    """Drop impossible samples; report each in `Recording.irregularities`, in line order.

    Parameters
    ----------
    recording : Recording
        Changed in place: afterwards its times increase and its positions are drivable.
    motion : Motion
        Sets the speed limit, and how much of the file to use.

    Raises
    ------
    MotionError
        If the remainder is not a motion.
    """
    if len(recording):
        _order(recording)
        if motion.duration_s is not None:
            _cut(recording, motion.duration_s)
        _stray(recording)
    _check_size(recording)
    _gaps(recording, interval_of(recording))
    find_jumps(recording, motion.speed_limit_mps)
    _check_size(recording)
    recording.irregularities.sort(key=lambda irregular: irregular.line)


def refusal(irregularities: list[Irregularity], path: object) -> MotionError | None:
    """Return the error for a file to refuse; None if nothing is wrong with it."""
    if not irregularities:
        return None
    first = irregularities[0]
    others = len(irregularities) - 1
    more = f" (and {others} more)" if others else ""
    return MotionError(
        f"motion {path}: line {first.line}: {first.text}{more}; "
        'set `irregularities = "mend"` to accept it'
    )
