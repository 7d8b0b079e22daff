"""Limits to what strangers can make the server wait for, hold and print."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Final

from uvicorn.protocols.http.h11_impl import H11Protocol

INCOMPLETE_S: Final = 10.0
"""Time for a request to arrive whole."""

AT_ONCE: Final = 20
"""Lines about refusals that are printed at once; then one a second."""


class PatientProtocol(H11Protocol):
    """A connection that is closed when a request, or the first one, does not arrive whole."""

    _due: asyncio.TimerHandle | None = None

    # uvicorn takes no other transport than this.
    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request."""
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        """Take a part of a request."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._stop()
        super().connection_lost(exc)

    def _watch(self) -> None:
        """Wait for the rest of a request, from its first byte on; not while one is answered."""
        is_whole = self.cycle is not None and not self.cycle.response_complete
        if is_whole or self.transport.get_protocol() is not self:
            self._stop()
        elif self._due is None:
            self._due = self.loop.call_later(INCOMPLETE_S, self._give_up)

    def _stop(self) -> None:
        if self._due is not None:
            self._due.cancel()
            self._due = None

    def _give_up(self) -> None:
        if self.transport.get_protocol() is self:
            self.transport.close()


class FewLines(logging.Filter):
    """Lets a burst of lines pass, then one a second, which says how many were left out.

    Parameters
    ----------
    clock : callable
        The wall clock, s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._left = float(AT_ONCE)
        self._looked_s = clock()
        self._dropped = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a line is printed."""
        now_s = self._clock()
        self._left = min(float(AT_ONCE), self._left + now_s - self._looked_s)
        self._looked_s = now_s
        if self._left < 1:
            self._dropped += 1
            return False
        self._left -= 1
        if self._dropped:
            record.msg = f"{record.getMessage()} ({self._dropped} more lines are not shown)"
            record.args = ()
            self._dropped = 0
        return True
