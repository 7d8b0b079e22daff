"""Compiles the functions of the steps, and keeps their machine code between runs.

numba's own cache believes what it finds, misses changes in other files, such as constants and
inlined functions, and mixes files up when two processes compile one function for different types.
Here code is kept by `rrins.dbc.code_folder`: one file for each function and signature, in a folder
named after a digest of all sources.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps

from rrins.dbc.code_folder import CodeFolder, code_folder, name_of_code
from rrins.dbc.compile_events import signals_deferred

_F = TypeVar("_F", bound=Callable[..., object])
_Key = tuple[Any, ...]


class _Locator(UserProvidedCacheLocator):
    """Tells numba the state of a function's source file; it does not say where code is kept."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file = file
        self._lineno = function.__code__.co_firstlineno
        self._cache_path = ""

    def ensure_cache_path(self) -> None:
        """Do nothing: the folder is made when a file is saved."""

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Locator:
        """Return the locator of a function."""
        return cls(function, file)


class _Results(CompileResultCacheImpl):
    """Turns compiled functions into what can be pickled, and back."""

    _locator_classes: list[type[object]] = [_Locator]  # noqa: RUF012 - as numba declares it


class _Files(IndexDataCacheFile):
    """The files of one function, in the place of numba's index and data files."""

    def __init__(self, function: Any, stamp: object, folder: CodeFolder | None) -> None:
        self._name = f"{function.__module__}.{function.__name__}".removeprefix("rrins.")
        self._stamp = stamp
        self._given = folder

    @property
    def _folder(self) -> CodeFolder | None:
        return self._given if self._given is not None else code_folder()

    def load(self, key: _Key) -> object:
        """Return the compiled function of a key; None if it is to be compiled."""
        folder = self._folder
        code = None if folder is None else folder.load(self._file(key))
        return None if code is None else pickle.loads(code)

    def save(self, key: _Key, compiled: object) -> None:
        """Keep a compiled function."""
        if self._folder is not None:
            self._folder.save(self._file(key), dumps(compiled))

    def discard(self, key: _Key) -> None:
        """Delete a file of which numba can make nothing."""
        if self._folder is not None:
            self._folder.heal(self._file(key))

    def flush(self) -> None:
        """Do nothing: other functions' code is in the folder, too."""

    def _file(self, key: _Key) -> str:
        signature, *rest = key
        return name_of_code(
            self._name, repr(([str(kind) for kind in signature], rest, self._stamp))
        )


class _CheckedCache(FunctionCache):
    """numba's cache of a function, with our files."""

    _impl_class = _Results

    def __init__(self, function: Any, folder: CodeFolder | None) -> None:
        FunctionCache.__init__(self, function)
        self._numba: Any = super()
        self._files = _Files(function, self._impl.locator.get_source_stamp(), folder)
        self._cache_file = self._files

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the function compiled for a signature; None if it is to be compiled."""
        with signals_deferred():
            try:
                return self._numba.load_overload(signature, target)
            except (pickle.UnpicklingError, ImportError, AttributeError, RuntimeError, TypeError):
                # The file is as it was written, and yet wrong: the process that wrote it was.
                self._files.discard(self._numba._index_key(signature, target.codegen()))
                return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the function compiled for a signature."""
        with signals_deferred():
            self._numba.save_overload(signature, result)


def compiled(function: _F) -> _F:
    """Compile a function of a step at its first call; its machine code is kept."""
    return compiled_with()(function)


def compiled_with(folder: CodeFolder | None = None, **options: Any) -> Callable[[_F], _F]:
    """Return what compiles a function with options of `numba.njit`.

    Parameters
    ----------
    folder : CodeFolder, optional
        Where the machine code is kept; the user's without it.
    **options
        Such as ``nogil=True``.
    """

    def compile_later(function: _F) -> _F:
        # No wrapper for callers in C: there are none, and it is a tenth of the work.
        dispatcher = numba.njit(**{"no_cfunc_wrapper": True, **options})(function)
        if isinstance(dispatcher, Dispatcher):  # else NUMBA_DISABLE_JIT=1
            cast(Any, dispatcher)._cache = _CheckedCache(function, folder)
        return cast(_F, dispatcher)

    return compile_later
