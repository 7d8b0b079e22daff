"""A diagnostic tool that reads every identifier of a rehearsal, again and again."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

from firmware_py.diagnostics import table
from host_tools.diag.target import Target
from host_tools.diag.tester import Tester
from host_tools.errors import BusError, NoAnswerError

_AGAIN_S = 0.05


class Reading:
    """A thread that reads while it is entered.

    Parameters
    ----------
    channel : str
        Of the embedded bus.

    Attributes
    ----------
    times : int
        How often it has read all.
    """

    def __init__(self, channel: str) -> None:
        self._target = Target(channel=channel)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.times = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        """Read from when the bus is there until it ends."""
        while not self._stop.is_set():
            try:
                with Tester(self._target) as tester:
                    dids = tester.has(table.IDENTIFIERS)
                    while not self._stop.is_set():
                        tester.read(dids)
                        self.times += 1
            except (BusError, NoAnswerError):
                time.sleep(_AGAIN_S)
