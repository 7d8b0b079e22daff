"""Puts a recording on the firmware's epochs: increments as whole counts, fixes by epoch.

The epochs are laid so that the fixes fall on their ends. Increments are summed up and read off at
each epoch's end, straight between two rows; what a count leaves is carried on. So nothing is lost
over time, whatever the recording's rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats, Integers
from rrins.host_tools.rounding import rounded
from rrins.host_tools.vehicle.errors import VehicleError
from rrins.host_tools.vehicle.recording import Fixes, Increments

SLOWEST_HZ, FASTEST_HZ = 50, 1000
"""Rates that the firmware can run at."""

_GAP = 1.5  # usual intervals
_LONGEST_GAP_S = 1.0


@dataclass(frozen=True)
class Epochs:
    """Increments by epoch, in counts.

    Attributes
    ----------
    gyros, accelerometers : array, shape (n, sensors)
        Counts.
    """

    gyros: Integers
    accelerometers: Integers
    begins_s: float  #: when the first epoch begins, by the recording's clock
    period_s: float
    gaps: tuple[tuple[float, float], ...]  #: begin (s) and length (s) of gaps that were bridged
    clipped: int  #: increments beyond the range of a frame

    def __len__(self) -> int:
        return len(self.gyros)


def rate_of(increments: Increments) -> int:
    """Return the firmware's rate for increments, Hz: the nearest that it can run at.

    Raises
    ------
    VehicleError
        If the recording is too slow.
    """
    rate = 1.0 / increments.interval_s
    if rate < 0.9 * SLOWEST_HZ:
        raise VehicleError(
            f"import: the increments come at {rounded(rate)} Hz; the firmware needs {SLOWEST_HZ} Hz"
        )
    possible = np.array([hz for hz in range(SLOWEST_HZ, FASTEST_HZ + 1) if 1_000_000_000 % hz == 0])
    return int(possible[np.argmin(np.abs(possible - rate))])


def grid_begin(start_s: float, period_s: float, fixes: Fixes | None) -> float:
    """Return where the epoch begins that is nearest to a time, if fixes end epochs."""
    if fixes is None:
        return start_s
    phases = 2 * np.pi * (fixes.time_s / period_s)
    phase = float(np.angle(np.mean(np.exp(1j * phases)))) / (2 * np.pi) * period_s
    return float(np.round((start_s - phase) / period_s) * period_s + phase)


def _sums(
    time_s: Floats, values: Floats, usual_s: float
) -> tuple[Floats, tuple[tuple[float, float], ...]]:
    """Return sums up to each row's time, shape (rows + 1, sensors), and the gaps.

    A row after a gap covers its own interval only: the gap is filled at its rate.
    """
    lengths = np.diff(time_s, prepend=time_s[0] - usual_s)
    is_gap = lengths > _GAP * usual_s
    if float(lengths.max()) > _LONGEST_GAP_S:
        at = int(np.argmax(lengths))
        raise VehicleError(
            f"import: {rounded(lengths[at])} s are missing before {time_s[at]:.3f} s; at most "
            f"{_LONGEST_GAP_S:g} s can be bridged"
        )
    scale = np.where(is_gap, lengths / usual_s, 1.0)[:, np.newaxis]
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values * scale, axis=0)])
    gaps = tuple((float(time_s[k] - lengths[k]), float(lengths[k])) for k in np.flatnonzero(is_gap))
    return sums, gaps


def _counts(
    time_s: Floats, sums: Floats, ends_s: Floats, scale: float, limit: int
) -> tuple[Integers, int]:
    read = np.column_stack([np.interp(ends_s, time_s, column) for column in sums.T])
    counts = np.diff(np.rint(read / scale).astype(np.int64), axis=0)
    clipped = int(np.count_nonzero(np.abs(counts) > limit))
    return np.clip(counts, -limit, limit), clipped


def laid_out(
    increments: Increments,
    begins_s: float,
    ends_s: float,
    rate_hz: int,
    scales: tuple[float, float],
    limits: tuple[int, int],
) -> Epochs:
    """Return the increments of whole epochs.

    Parameters
    ----------
    increments : Increments
    begins_s, ends_s : float
        When the first epoch begins, and when the last is to end at the latest.
    rate_hz : int
    scales : pair of float
        What a count of a gyro (rad) and of an accelerometer (m/s) is.
    limits : pair of int
        Largest counts of a frame.

    Raises
    ------
    VehicleError
        If there is nothing in between, or a gap is too long.
    """
    period_s = 1.0 / rate_hz
    count = int((ends_s - begins_s) / period_s + 1e-6)
    if count < rate_hz:
        raise VehicleError(
            f"import: {rounded(max(0.0, ends_s - begins_s))} s are too short to navigate"
        )
    usual_s = increments.interval_s
    rows = (increments.time_s > begins_s - 2) & (increments.time_s <= ends_s + 2)
    time_s = increments.time_s[rows]
    grid_s = begins_s + period_s * np.arange(count + 1, dtype=np.float64)
    found = []
    gaps: tuple[tuple[float, float], ...] = ()
    clipped = 0
    for values, scale, limit in zip(
        (increments.dtheta[rows], increments.dv[rows]), scales, limits, strict=True
    ):
        sums, gaps = _sums(time_s, values, usual_s)
        at_s: Floats = np.concatenate([[time_s[0] - usual_s], time_s])
        counts, beyond = _counts(at_s, sums, grid_s, scale, limit)
        found.append(counts)
        clipped += beyond
    return Epochs(found[0], found[1], begins_s, period_s, gaps, clipped)
