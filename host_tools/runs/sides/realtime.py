"""Real-time scheduling of a process, and how well it kept its deadlines."""

from __future__ import annotations

import ctypes
import gc
import os

import numpy as np

from rrins.host_tools.files import JsonObject

_PRIORITY = 50
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_BIN_NS = 1_000
_BINS = 100_000
_STALL_NS = 20_000_000
_MOST_STALLS = 100


def enter_realtime() -> dict[str, bool]:
    """Ask for SCHED_FIFO and locked memory, and stop the garbage collector.

    Returns
    -------
    dict
        `sched_fifo`, `memory_locked`: whether the system permitted each.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        fifo = True
    except PermissionError:
        fifo = False
    libc = ctypes.CDLL(None, use_errno=True)
    locked = libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    return {"sched_fifo": fifo, "memory_locked": locked}


class LatenessHistogram:
    """How late the epochs of a run began, in bins of a microsecond; fixed memory.

    Parameters
    ----------
    period_ns : int
        Of the epochs, for the times of stalls.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._stalls: list[tuple[int, int]] = []  # epoch, lateness in ns
        self._stalled = False
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._max_ns = 0
        self.epochs = 0
        self.overruns = 0

    def add(self, late_ns: int, overrun: bool) -> None:
        """Count one epoch."""
        self._bins[min(max(late_ns, 0) // _BIN_NS, _BINS - 1)] += 1
        self._max_ns = max(self._max_ns, late_ns)
        if late_ns >= _STALL_NS:
            self._note_stall(late_ns)
        self._stalled = late_ns >= _STALL_NS
        self.epochs += 1
        self.overruns += overrun

    def _note_stall(self, late_ns: int) -> None:
        """Keep the largest lateness of each stall: the epochs after it are late, too."""
        if not self._stalled:
            if len(self._stalls) == _MOST_STALLS:
                self._stalls.remove(min(self._stalls, key=lambda stall: stall[1]))
            self._stalls.append((self.epochs, late_ns))
        elif late_ns > self._stalls[-1][1]:
            self._stalls[-1] = (self.epochs, late_ns)

    def _percentile_us(self, share: float) -> float:
        below = np.cumsum(self._bins)
        return float(np.searchsorted(below, share * below[-1]) + 1)

    def summary(self) -> JsonObject:
        """Return p50, p99, p999 and max in µs, the overruns and the stalls (20 ms and more)."""
        if not self.epochs:
            return {"epochs": 0, "overruns": 0}
        return {
            "epochs": self.epochs,
            "overruns": self.overruns,
            "p50": self._percentile_us(0.50),
            "p99": self._percentile_us(0.99),
            "p999": self._percentile_us(0.999),
            "max": round(self._max_ns / 1000, 1),
            "stalls": [
                {"at_s": epoch * self._period_ns / 1e9, "late_ms": round(late_ns / 1e6, 1)}
                for epoch, late_ns in self._stalls
            ],
        }
