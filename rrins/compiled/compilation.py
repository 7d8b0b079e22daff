"""Compiled functions: machine code that Python calls, made once and kept.

A step is compiled by numba, once for each processor and kinds of arguments; its machine code is
kept (`rrins.compiled.code_folder`), and whoever calls it later loads that and nothing else
(`rrins.compiled.native`). numba is imported to make code (`rrins.compiled.compiler`), never to run
it. With `NUMBA_DISABLE_JIT=1` nothing is compiled, and all runs as plain Python; so it does with a
newer numba than any that was tried, if that turns out not to compile the steps.
"""

from __future__ import annotations

import functools
import inspect
import logging
import os
import re
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, TypeVar, cast

from rrins.compiled import native
from rrins.compiled.code_folder import CodeFolder, code_folder, name_of_code, sources
from rrins.compiled.compile_events import signals_deferred
from rrins.compiled.kinds import Kinds, kind_of, text_of
from rrins.compiled.sources import PACKAGE, stamp_of

_log = logging.getLogger(__name__)
_F = TypeVar("_F", bound=Callable[..., object])

_TRIED = 0, 68
"""The newest numba with which all tests have passed: ours derives from classes of its inside."""
_TRIAL = "import rrins; rrins.simulate('rimu_rotating', duration_s=1)"
_ANSWER = "trial.code"
_OF_THE_MACHINE = re.compile(rb"OSError|PermissionError|MemoryError|KeyboardInterrupt")


def is_tried(numba: str) -> bool:
    """Return whether a version of numba is none that is newer than the newest tried."""
    return tuple(int(part) for part in numba.split(".")[:2]) <= _TRIED


def passes_trial(numba: str, folder: CodeFolder | None) -> bool:
    """Return whether an untried numba compiles the steps: tried once, in a process, and told.

    The folder keeps why not, empty if it does, and what the trial has compiled. It does not keep
    what was not for numba to help, such as a full disk: then the next start tries again.
    """
    why = None if folder is None else folder.load(_ANSWER)
    if why is None:
        import subprocess

        _log.warning("numba %s is newer than any that was tried: this start tries it", numba)
        environment = os.environ | {"NUMBA_DISABLE_JIT": "0"}
        trial = [sys.executable, "-c", _TRIAL]
        done = subprocess.run(trial, cwd=PACKAGE.parent, env=environment, capture_output=True)
        died = f"status {done.returncode}".encode()
        why = (done.stderr.splitlines() or [died])[-1] if done.returncode else b""
        is_of_numba = done.returncode >= 0 and not _OF_THE_MACHINE.match(why)
        if folder is not None and is_of_numba:
            folder.save(_ANSWER, why)
    if why:
        newest = ".".join(map(str, _TRIED))
        so = "all runs as plain Python, thousands of times slower"
        line = "numba %s cannot compile the steps (%s): %s; `pip install 'numba==%s.*'` is fast"
        _log.warning(line, numba, why.decode(errors="replace"), so, newest)
    return not why


def _is_disabled() -> bool:
    wish = os.environ.get("NUMBA_DISABLE_JIT")
    if wish:
        return wish != "0"
    numba = version("numba")
    return not (is_tried(numba) or passes_trial(numba, code_folder()))


IS_DISABLED = _is_disabled()
"""Whether all runs as plain Python."""


@dataclass(frozen=True)
class Foreign:
    """A function of the C library, for compiled code to call.

    Attributes
    ----------
    name : str
    returns : str
        Name of numba's type, such as ``int32``.
    takes : tuple of str
        The same, for each argument.
    """

    name: str
    returns: str
    takes: tuple[str, ...]

    def __call__(self, *arguments: object) -> Any:
        """Refuse: only compiled code calls it."""
        raise TypeError(f"{self.name} is for compiled code")

    @functools.cached_property
    def _numba_type_(self) -> object:
        from rrins.compiled.compiler import foreign_type

        return foreign_type(self.name, self.returns, self.takes)


class Function:
    """A compiled function.

    Attributes
    ----------
    py_func : function
        The same in Python.
    is_unit : bool
        Whether it has machine code of its own where compiled code calls it.
    options : dict
        Options of `numba.njit`.
    """

    def __init__(
        self, function: Any, folder: CodeFolder | None, is_unit: bool, options: dict[str, Any]
    ) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.is_unit, self.options = function, is_unit, options
        self._stamp, self._folder = stamp_of(function.__code__.co_filename), folder
        self._arity = function.__code__.co_argcount
        self._natives: dict[Kinds, Callable[..., Any]] = {}
        self._lock = threading.Lock()

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the machine code, which is loaded or made at the first call with such arguments."""
        if named or len(arguments) != self._arity:
            bound = inspect.signature(self.py_func).bind(*arguments, **named)
            bound.apply_defaults()
            arguments = bound.args
        kinds = tuple([kind_of(argument) for argument in arguments])
        code = self._natives.get(kinds) or self._find(kinds)
        try:
            return code(*arguments)
        except native.RaisedError as error:
            raise native.exception_at(error.args[0]) from None

    def __reduce__(self) -> str:
        return str(self.py_func.__qualname__)

    @property
    def folder(self) -> CodeFolder | None:
        """Where its code is kept; None if the user has no home."""
        return self._folder if self._folder is not None else code_folder()

    def file(self, key: str, kind: str = "") -> str:
        """Return the name of the file of its code for a key, such as the kinds of its arguments."""
        # The folder's name stands for the content of all files, unless one was written since.
        function = self.py_func
        is_known = sources().is_as_digested(function.__code__.co_filename, self._stamp)
        content = repr((key, self._identity, None if is_known else self._stamp))
        name = f"{function.__module__}.{function.__name__}".removeprefix("rrins.")
        return name_of_code(name + kind, content)

    @functools.cached_property
    def _identity(self) -> str:
        """Names what its code depends on beside its source: variables of the function around it."""
        cells = [cell.cell_contents for cell in self.py_func.__closure__ or ()]
        seen = [each._identity if isinstance(each, Function) else each for each in cells]
        return repr((self.py_func.__code__.co_code.hex(), seen)) if seen else ""

    @functools.cached_property
    def _numba_type_(self) -> object:
        """Its type in compiled code that calls it."""
        return self.callee.numba_type

    @functools.cached_property
    def callee(self) -> Any:
        """The function as compiled code calls it, a `rrins.compiled.compiler.Callee`."""
        with signals_deferred():  # half of numba imported could not be imported again
            from rrins.compiled.compiler import Callee

            return Callee(self)

    def _find(self, kinds: Kinds) -> Callable[..., Any]:
        file = self.file(repr([text_of(kind) for kind in kinds]))
        with self._lock:
            if kinds not in self._natives:
                found = native.load(self.folder, file)
                if found is None:
                    found = self.callee.make_native(kinds, file)
                self._natives[kinds] = found
            return self._natives[kinds]


def compiled(function: _F) -> _F:
    """Compile a function of a step at its first call; its code is kept."""
    return compiled_with()(function)


def compiled_with(
    folder: CodeFolder | None = None, is_unit: bool = False, **options: Any
) -> Callable[[_F], _F]:
    """Return what compiles a function with options of `numba.njit`.

    Parameters
    ----------
    folder : CodeFolder, optional
        Where the code is kept; the user's without it.
    is_unit : bool
        Whether it has machine code of its own where compiled code calls it: for what is large and
        has several callers.
    **options
        Such as ``nogil=True``.
    """

    def compile_later(function: _F) -> _F:
        if IS_DISABLED:
            function.py_func = function  # type: ignore[attr-defined]  # as a compiled one has it
            return function
        return cast(_F, Function(function, folder, is_unit, options))

    return compile_later
