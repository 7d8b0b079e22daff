"""A diagnostic tool that reads every identifier of a rehearsal, again and again."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from firmware_py.diagnostics import table
from host_tools.diag.target import Target
from host_tools.diag.tester import Tester
from host_tools.errors import BusError, NoAnswerError

_AGAIN_S = 0.05


@dataclass
class Count:
    """How often all has been read."""

    times: int = 0


@contextmanager
def reading(channel: str) -> Iterator[Count]:
    """Read in a thread meanwhile, from when the embedded bus is there until it ends."""
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
        except (BusError, NoAnswerError):  # not there yet, or over
            stop.wait(_AGAIN_S)
