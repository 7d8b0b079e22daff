"""A diagnostic tool that repeatedly reads every identifier of a rehearsal."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rrins.firmware_py.diagnostics import table
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.errors import BusError, NoAnswerError

_AGAIN_S = 0.05


@dataclass
class Count:
    """Number of times that every identifier has been read."""

    times: int = 0


@contextmanager
def reading(channel: str) -> Iterator[Count]:
    """Read in a background thread while the embedded bus exists."""
    stop = threading.Event()
    count = Count()
    thread = threading.Thread(target=_read, args=(Target(channel=channel), stop, count))
    thread.start()
    try:
        yield count
    finally:
        stop.set()
        thread.join()


def _read(target: Target, stop: threading.Event, count: Count) -> None:
    while not stop.is_set():
        try:
            with Tester(target) as tester:
                dids = tester.has(table.IDENTIFIERS)
                while not stop.is_set():
                    tester.read(dids)
                    count.times += 1
        except (BusError, NoAnswerError):  # not started yet, or finished
            stop.wait(_AGAIN_S)
