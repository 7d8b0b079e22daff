"""Ctrl-C and SIGTERM: alike, and as an event for those who have something to finish."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit status of a command that the user stopped."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def heed_sigterm() -> None:
    """Let SIGTERM stop this process as Ctrl-C does."""
    signal.signal(signal.SIGTERM, _interrupt)


def heed_nothing() -> None:
    """Let no signal break off the end of this process, which has come already."""
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def as_event() -> Iterator[threading.Event]:
    """Turn Ctrl-C and SIGTERM into an event, so that they break nothing off and are not lost.

    An exception that a signal raises is lost where it happens to come in a finaliser. In a thread
    other than the main one, where signals do not come, the event is never set.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = [signal.signal(number, lambda *_: stop.set()) for number in _SIGNALS]
    try:
        yield stop
    finally:
        for number, handler in zip(_SIGNALS, before, strict=True):
            signal.signal(number, handler)
