"""The navigation output of every epoch: its digest, and a thinned copy for whoever wants one."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.memory import NAVIGATION

_CHUNK = 4096


class NavigationTrace:
    """Collects the navigation records of a run in fixed memory.

    Parameters
    ----------
    keep_every : int
        Rows whose epoch is a multiple of this are handed to `sink`.
    sink : callable, optional
        Called with an array of dtype `firmware_py.memory.NAVIGATION`, oldest first.
    """

    def __init__(
        self, keep_every: int = 1, sink: Callable[[NDArray[Any]], None] | None = None
    ) -> None:
        self._rows = np.zeros(_CHUNK, dtype=NAVIGATION)
        self._count = 0
        self._digest = hashlib.sha256()
        self._keep_every = keep_every
        self._sink = sink
        self.epochs = 0
        """Rows taken so far."""

    def take(self, ram: NDArray[Any]) -> None:
        """Take the navigation output that a RAM image holds."""
        self._rows[self._count] = ram["navigation"][0]
        self._count += 1
        self.epochs += 1
        if self._count == _CHUNK:
            self.flush()

    def take_rows(self, rows: NDArray[Any]) -> None:
        """Take the navigation output of several epochs, oldest first."""
        self.flush()
        self.epochs += len(rows)
        self._pass_on(rows)

    def flush(self) -> None:
        """Digest what has been taken and hand it on."""
        self._pass_on(self._rows[: self._count])
        self._count = 0

    def _pass_on(self, rows: NDArray[Any]) -> None:
        self._digest.update(rows.tobytes())
        if self._sink is not None:
            kept = rows[rows["epoch"] % self._keep_every == 0]
            if len(kept):
                self._sink(kept)

    def sha256(self) -> str:
        """Return the digest, in hexadecimal, over the records of all epochs so far."""
        self.flush()
        return self._digest.hexdigest()
