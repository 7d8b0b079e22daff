"""Compiles parts and units in a second process, while this one compiles the rest."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrins.compiled.code_folder import code_folder, forget_claims
from rrins.compiled.compilation import Function
from rrins.compiled.compile_events import compiling_watched, forget_watchers
from rrins.compiled.kinds import ALIGNED, C_ORDER, WRITEABLE
from rrins.compiled.record import Record

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_FIRST_OTHER_FD = 3


@dataclass(frozen=True)
class Beside:
    """A function that compiled code calls, and the types of its arguments."""

    function: Callable[..., object]  #: a compiled one
    arguments: tuple[Any, ...]  #: for each a class of records, a dtype, a type, or `array_of`

    def compile(self) -> None:
        """Compile it, unless its code is there."""
        if isinstance(self.function, Function):
            self.function.callee.prepare([_kind(argument) for argument in self.arguments])


def _kind(argument: Any) -> Any:
    is_record = isinstance(argument, type) and issubclass(argument, Record)
    return argument.dtype if is_record else argument


def array_of(kind: Any, dimensions: int = 1) -> tuple[Any, int, int]:
    """Return what stands for a contiguous array of records or numbers."""
    return np.dtype(_kind(kind)), dimensions, C_ORDER | WRITEABLE | ALIGNED


class _Helper:
    """A fork of this process, made when the first function is compiled."""

    def __init__(self, wanted: Sequence[Beside]) -> None:
        self._wanted = wanted
        self._pid: int | None = None

    def begin(self, functions: int) -> None:
        """Fork, once."""
        if self._pid is None:
            self._pid = os.fork()
            if self._pid == 0:
                _compile_and_exit(self._wanted)

    def end(self) -> None:
        """Stop it."""
        if self._pid is not None:
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)


@contextlib.contextmanager
def compiled_beside(*wanted: Beside) -> Iterator[None]:
    """Have parts compiled in a second process, in their order, while this one compiles others.

    Whatever goes wrong there is done here instead, when the part is needed. A process with more
    than one thread cannot be forked safely; it does all alone.
    """
    is_able = threading.active_count() == 1 and (os.cpu_count() or 1) > 1
    if not is_able or code_folder() is None:
        yield
        return
    helper = _Helper(wanted)
    with compiling_watched(helper.begin):
        try:
            yield
        finally:
            helper.end()


def _compile_and_exit(wanted: Sequence[Beside]) -> None:
    """Be the helper: silent, without what it inherited, and gone with its parent."""
    try:
        forget_watchers()  # nobody is to be told of what is compiled here
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        os.closerange(_FIRST_OTHER_FD, os.sysconf("SC_OPEN_MAX"))
        forget_claims()
        for each in wanted:
            each.compile()
    finally:
        os._exit(0)
