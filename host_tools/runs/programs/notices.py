"""Notices of the embedded bus's host about other peers, for the user of a rehearsal."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from rrins.host_tools.runs.results.pipe import ReportPipe

LOGGER: Final = "rrins.host_tools.bus"
"""Where the host says it."""

_PAUSE_NS: Final = 1_000_000_000  # between two lines: whoever floods a bus does not flood the user

_now: Final = time.monotonic_ns


class _Notices(logging.Handler):
    """Tells the user what others do to the bus: a line of each kind at once, then one a second.

    Parameters
    ----------
    side : str
        Whose process this is.
    """

    def __init__(self, report: ReportPipe, side: str) -> None:
        super().__init__(logging.WARNING)
        self._report = report
        self._side = side
        self._next_ns = 0
        self._told: set[str] = set()
        self._left_out = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a notice on; other records go where the process has them, if anywhere."""
        deed: str | None = getattr(record, "deed", None)
        if deed is None:
            if not self._report.is_read:
                logging.getLogger().handle(record)
            return
        now_ns = _now()
        if deed in self._told and now_ns < self._next_ns:
            self._left_out += 1
            return
        self._told.add(deed)
        self._next_ns = now_ns + _PAUSE_NS
        self._say(record.getMessage())

    def _say(self, text: str) -> None:
        left_out, self._left_out = self._left_out, 0
        self._report.note(self._side, f"{text}{_more(left_out)}")

    def finish(self) -> None:
        """Say how many lines were left out last."""
        if self._left_out:
            self._report.note(self._side, f"{self._left_out} more lines about others on the bus")


def _more(lines: int) -> str:
    return f" ({lines} lines before it left out)" if lines else ""


@contextmanager
def bus_notices(report: ReportPipe, side: str) -> Iterator[None]:
    """Tell the user what others do to the bus that this process hosts."""
    logger, notices = logging.getLogger(LOGGER), _Notices(report, side)
    before = (logger.level, logger.propagate)
    logger.setLevel(logging.WARNING)
    logger.propagate = False
    logger.addHandler(notices)
    try:
        yield
        notices.finish()
    finally:
        logger.removeHandler(notices)
        logger.level, logger.propagate = before
