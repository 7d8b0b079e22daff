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
    """How late the epochs of a run began, in bins of a microsecond; fixed memory."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._max_ns = 0
        self.epochs = 0
        self.overruns = 0

    def add(self, late_ns: int, overrun: bool) -> None:
        """Count one epoch."""
        self._bins[min(max(late_ns, 0) // _BIN_NS, _BINS - 1)] += 1
        self._max_ns = max(self._max_ns, late_ns)
        self.epochs += 1
        self.overruns += overrun

    def _percentile_us(self, share: float) -> float:
        below = np.cumsum(self._bins)
        return float(np.searchsorted(below, share * below[-1]) + 1)

    def summary(self) -> JsonObject:
        """Return p50, p99, p999 and max in µs, and the overruns."""
        if not self.epochs:
            return {"epochs": 0, "overruns": 0}
        return {
            "epochs": self.epochs,
            "overruns": self.overruns,
            "p50": self._percentile_us(0.50),
            "p99": self._percentile_us(0.99),
            "p999": self._percentile_us(0.999),
            "max": round(self._max_ns / 1000, 1),
        }
