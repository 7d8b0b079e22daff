"""Rows of quantities over the whole of a run, in bounded memory."""

from __future__ import annotations

import numpy as np

from rrins.compiled.record import Floats

_CAPACITY = 2400
_RECENT = 700
_STEP_S = 0.1  # between two rows, at first


class _Rows:
    """Times and rows, in the order in which they came."""

    def __init__(self, columns: int, capacity: int) -> None:
        self.times = np.zeros(capacity)
        self.rows = np.zeros((capacity, columns), dtype=np.float32)
        self.count = 0

    @property
    def is_full(self) -> bool:
        """Whether another one does not fit."""
        return self.count == len(self.times)

    def add(self, time_s: float, row: Floats) -> None:
        """Append a row."""
        self.times[self.count] = time_s
        self.rows[self.count] = row
        self.count += 1

    def keep(self, those: slice) -> None:
        """Drop all others."""
        times, rows = self.times[: self.count][those], self.rows[: self.count][those]
        self.count = len(times)
        self.times[: self.count] = times.copy()
        self.rows[: self.count] = rows.copy()


class History:
    """The whole of a run, thinned as it becomes longer, and its last minute in full.

    Parameters
    ----------
    columns : int
    step_s : float
        Shortest time between two rows.
    """

    def __init__(self, columns: int, step_s: float = _STEP_S) -> None:
        self._step_s = step_s
        self._columns = columns
        self.clear()

    def clear(self) -> None:
        """Forget all rows."""
        self._whole = _Rows(self._columns, _CAPACITY)
        self._recent = _Rows(self._columns, 2 * _RECENT)
        self._whole_step_s = self._step_s
        self._whole_due_s = self._recent_due_s = -np.inf

    def hold(self, step_s: float, rows: int) -> None:
        """Forget all rows, and hold this many with at least this time between two."""
        self._step_s = step_s
        self.clear()
        self._whole = _Rows(self._columns, rows + 1)

    def add(self, time_s: float, row: Floats) -> None:
        """Take a row, if it is due; a time before the latest begins a new run."""
        if time_s < self._recent_due_s - 2 * self._step_s:
            self.clear()
        if time_s >= self._recent_due_s:
            if self._recent.is_full:
                self._recent.keep(slice(-_RECENT, None))
            self._recent.add(time_s, row)
            self._recent_due_s = time_s + self._step_s * (1 - 1e-6)
        if time_s >= self._whole_due_s:
            if self._whole.is_full:
                self._whole.keep(slice(None, None, 2))
                self._whole_step_s *= 2
            self._whole.add(time_s, row)
            self._whole_due_s = time_s + self._whole_step_s * (1 - 1e-6)

    def rows(self) -> tuple[Floats, Floats]:
        """Return times, shape (n,), and rows, shape (n, columns): thin, then the last in full."""
        whole, recent = self._whole, self._recent
        recent_times = recent.times[: recent.count][-_RECENT:]
        recent_rows = recent.rows[: recent.count][-_RECENT:]
        begins = recent_times[0] if len(recent_times) else np.inf
        old = int(np.searchsorted(whole.times[: whole.count], begins))
        return (
            np.concatenate([whole.times[:old], recent_times]),
            np.concatenate([whole.rows[:old], recent_rows]),
        )
