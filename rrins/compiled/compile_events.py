"""Progress of numba's compilation, and Ctrl-C, which waits for the next function.

numba calls LLVM, and LLVM calls back. An exception that a signal raises in such a callback is lost,
with a traceback on standard error. So SIGINT and SIGTERM wait until the next function begins, or
the last one ends: a fraction of a second.
"""

from __future__ import annotations

import itertools
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)

OnFunction = Callable[[int], None]
"""Called with how many functions have been begun."""


class _Deferral:
    """Holds back signals between `begin` and `end`, which may nest; `heed` lets one through."""

    def __init__(self) -> None:
        self._depth = 0
        self._before: dict[int, Any] = {}
        self._pending: list[int] = []

    def begin(self) -> None:
        self._depth += 1
        if self._depth == 1:
            self._before = {number: signal.getsignal(number) for number in _SIGNALS}
            for number, handler in self._before.items():
                if handler not in (None, signal.SIG_IGN):
                    signal.signal(number, self._hold)

    def end(self) -> None:
        self._depth -= 1
        if self._depth == 0:
            for number, handler in self._before.items():
                if handler not in (None, signal.SIG_IGN):
                    signal.signal(number, handler)
            self.heed()

    def heed(self) -> None:
        """Do what the signal would have done when it came."""
        while self._pending:
            number = self._pending.pop()
            handler = self._before[number]
            if callable(handler):
                handler(number, None)
            else:
                signal.signal(number, signal.SIG_DFL)
                signal.raise_signal(number)

    def _hold(self, number: int, frame: FrameType | None) -> None:
        if number not in self._pending:
            self._pending.append(number)


_deferral = _Deferral()


def _is_in_main_thread() -> bool:
    """Return whether signals come to this thread at all."""
    return threading.current_thread() is threading.main_thread()


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Hold back Ctrl-C and SIGTERM inside."""
    if not _is_in_main_thread():
        yield
        return
    _deferral.begin()
    try:
        yield
    finally:
        _deferral.end()


def heed_signals() -> None:
    """Break off here, if Ctrl-C or SIGTERM came while they were held back."""
    if _is_in_main_thread():
        _deferral.heed()


_watchers: list[Callable[[], None]] = []


@contextmanager
def compiling() -> Iterator[None]:
    """Hold back signals while a function is compiled, with those that it calls; break off before.

    Tells whoever watches.
    """
    with signals_deferred():
        heed_signals()
        for on_function in tuple(_watchers):
            on_function()
        yield


@contextmanager
def compiling_watched(on_function: OnFunction) -> Iterator[None]:
    """Follow what is compiled inside: nothing where all code is in the cache."""
    functions = itertools.count(1)

    def count() -> None:
        on_function(next(functions))

    _watchers.append(count)
    try:
        yield
    finally:
        _watchers.remove(count)


def forget_watchers() -> None:
    """Tell nobody: what a process does that was forked while somebody watched."""
    _watchers.clear()
