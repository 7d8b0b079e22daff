"""Drops samples that a recorded motion can do without, or refuses the file."""

from __future__ import annotations

import numpy as np

from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.jumps import drop_jumps
from rrins.host_tools.motion.recording import Irregularity, Recording
from rrins.host_tools.rounding import rounded
from rrins.host_tools.scenario.motion import Motion

LEAST_SAMPLES = 8
LEAST_SPAN_S = 2.0
LONGEST_SPAN_S = 43_200.0
LONGEST_GAP_S = 600.0
LONGEST_INTERVAL_S = 10.0
_LEAST_SHARE = 1 / 3  # share of the lines that must be usable


def _cut(recording: Recording, duration_s: float) -> None:
    """Keep only the beginning of the file; what comes after it neither counts nor is reported."""
    within = np.flatnonzero(recording.time_s <= recording.time_s[0] + duration_s)
    count = int(within[-1]) + 1
    if count == len(recording):
        return
    after = int(recording.line[count])
    beyond = {i.line for i in recording.irregularities if i.line >= after}
    beyond.difference_update(recording.line.tolist())  # only their velocity or attitude is bad
    recording.lines -= len(beyond) + len(recording) - count
    recording.irregularities[:] = [i for i in recording.irregularities if i.line < after]
    recording.keep(np.arange(len(recording)) < count)


def _order(recording: Recording) -> None:
    """Drop lines with the time of the line before; raise if a time goes back."""
    steps = np.diff(recording.time_s, prepend=-np.inf)
    for k in np.flatnonzero(steps < 0).tolist():
        raise recording.fail(
            f"time is {rounded(-steps[k])} s before that of line {recording.line[k - 1]}; "
            "correct or delete the wrong one of the two, or sort the lines",
            int(recording.line[k]),
        )
    for k in np.flatnonzero(steps == 0).tolist():
        recording.report(k, "repeated_time", "duplicate time")
    recording.keep(steps > 0)


def _gaps(recording: Recording, interval_s: float) -> None:
    """Report where samples are missing, unless dropped lines explain it; raise if for too long."""
    times = recording.time_s
    longest = int(np.argmax(np.diff(times)))
    if times[longest + 1] - times[longest] > LONGEST_GAP_S:
        raise recording.fail(
            f"gap of {rounded(times[longest + 1] - times[longest], 4)} s, longer than the "
            f"{LONGEST_GAP_S:g} s that can be bridged; delete the lines on one side of it",
            int(recording.line[longest + 1]),
        )
    reported = np.unique([irregular.line for irregular in recording.irregularities])
    for k in np.flatnonzero(np.diff(times) > 1.5 * interval_s).tolist():
        gap = times[k + 1] - times[k]
        # An adjacent dropped line may have belonged in between.
        between = (recording.line[k] - 1, recording.line[k + 1] + 2)
        first, last = np.searchsorted(reported, between)
        if round(gap / interval_s) - 1 > last - first:
            text = f"gap of {rounded(gap)} s instead of {rounded(interval_s)} s"
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
        raise recording.fail(f"spans {rounded(span)} s, at least {LEAST_SPAN_S:g} s needed")
    if span > LONGEST_SPAN_S:
        raise recording.fail(
            f"spans {rounded(span, 6)} s, at most {LONGEST_SPAN_S:,g} s allowed; "
            "limit it by duration_s"
        )
    interval = interval_of(recording)
    if interval > LONGEST_INTERVAL_S:
        raise recording.fail(
            f"a position every {rounded(interval)} s; at least one every "
            f"{LONGEST_INTERVAL_S:g} s needed"
        )


def interval_of(recording: Recording) -> float:
    """Return the typical interval between samples, s."""
    return float(np.median(np.diff(recording.time_s)))


def mend(recording: Recording, motion: Motion) -> None:
    """Drop repeated times and positions that are off for a while.

    Each is reported in `Recording.irregularities`, in line order.

    Parameters
    ----------
    recording : Recording
        Changed in place: afterwards its times increase and its positions are drivable.
    motion : Motion
        Sets the speed limit, and how much of the file to use.

    Raises
    ------
    MotionError
        If times go back, positions jump for good, a gap is too long, or too little is left.
    """
    if len(recording):
        if motion.duration_s is not None:
            _cut(recording, motion.duration_s)
        _order(recording)
    _check_size(recording)
    _gaps(recording, interval_of(recording))
    drop_jumps(recording, motion.speed_limit_mps)
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
