"""The navigation output of every epoch: its digest, and an optional decimated copy."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import NavigationOutput

_CHUNK = 4096


class NavigationTrace:
    """Collects the navigation records of a run in fixed memory.

    Parameters
    ----------
    keep_every : int
        Rows whose epoch is a multiple of this are passed to `sink`.
    sink : callable, optional
        Called with an array of `NavigationOutput`, oldest first.
    """

    def __init__(
        self, keep_every: int = 1, sink: Callable[[Records[NavigationOutput]], None] | None = None
    ) -> None:
        self._rows = NavigationOutput.zeros(_CHUNK)
        self._count = 0
        self._digest = hashlib.sha256()
        self._keep_every = keep_every
        self._sink = sink
        self.epochs = 0
        """Rows added so far."""

    @property
    def room(self) -> Records[NavigationOutput]:
        """Where the next rows are to be written; there is room for one at least."""
        return self._rows[self._count :]

    def add(self, count: int) -> None:
        """Add the first rows that were written to `room`, oldest first."""
        self._count += count
        self.epochs += count
        if self._count == _CHUNK:
            self.flush()

    def extend(self, rows: Records[NavigationOutput]) -> None:
        """Add the navigation output of several epochs, oldest first."""
        self.flush()
        self.epochs += len(rows)
        self._pass_on(rows)

    def flush(self) -> None:
        """Digest the rows added so far and pass them on."""
        self._pass_on(self._rows[: self._count])
        self._count = 0

    def _pass_on(self, rows: Records[NavigationOutput]) -> None:
        self._digest.update(rows.tobytes())
        if self._sink is not None:
            kept = rows[rows["epoch"] % self._keep_every == 0]
            if len(kept):
                self._sink(kept)

    def sha256(self) -> str:
        """Return the hexadecimal digest of the records of all epochs so far."""
        self.flush()
        return self._digest.hexdigest()
