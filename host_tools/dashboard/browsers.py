"""A browser that looks on: a bounded queue of messages of which the oldest are dropped.

Whatever a browser does, the rehearsal and the other browsers do not notice: messages for it are put
into its queue, and only its own task waits for it.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

Message = str | bytes
"""Text is JSON; bytes are rows of quantities."""

MOST_ROWS: Final = 6
"""Rows that wait for a browser: 0.2 s."""

MOST_NOTICES: Final = 200
"""Messages that must not be dropped; a browser for which more wait is let go."""


class Browser:
    """One browser.

    Attributes
    ----------
    dropped : int
        Rows that it did not get.
    shown : tuple
        Name, signal and time span of the message that it shows in detail.
    may_control : bool
        Whether it may give orders.
    """

    def __init__(self, may_control: bool) -> None:
        self.may_control = may_control
        self.dropped = 0
        self.shown: tuple[str | None, str | None, int] = (None, None, 0)
        self._notices: deque[Message] = deque()
        self._latest: dict[str, Message] = {}
        self._rows: deque[bytes] = deque(maxlen=MOST_ROWS)
        self._wake = asyncio.Event()

    @property
    def is_stuck(self) -> bool:
        """Whether so much waits that it must have stopped reading long ago."""
        return len(self._notices) > MOST_NOTICES

    def put_row(self, row: bytes) -> None:
        """Put a row; drop the oldest if too many wait."""
        self.dropped += len(self._rows) == MOST_ROWS
        self._rows.append(row)
        self._wake.set()

    def put_latest(self, kind: str, message: Message) -> None:
        """Put a message in place of the one of its kind that may still wait."""
        self._latest[kind] = message
        self._wake.set()

    def put(self, message: Message) -> None:
        """Put a message that must not be dropped."""
        self._notices.append(message)
        self._wake.set()

    def begin_anew(self) -> None:
        """Drop all that waits of the view before."""
        self._rows.clear()
        self._latest.clear()

    async def next_message(self) -> Message:
        """Return what is to be sent next; wait for it."""
        while True:
            if self._notices:
                return self._notices.popleft()
            if self._latest:
                return self._latest.pop(next(iter(self._latest)))
            if self._rows:
                return self._rows.popleft()
            self._wake.clear()
            await self._wake.wait()
