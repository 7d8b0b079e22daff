"""Keeps compiled functions between runs: machine code of wholes and units, bitcode of parts.

numba's own cache believes what it finds, misses changes in other files, such as constants and
inlined functions, and mixes files up when two processes compile one function for different types.
Here code is kept by `rrins.compiled.code_folder`: one file for each function and signature, in a
folder named after a digest of all sources.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from rrins.compiled.code_folder import CodeFolder, code_folder, name_of_code, sources
from rrins.compiled.code_library import Part, PartLibrary, WholeLibrary
from rrins.compiled.compile_events import signals_deferred

_Key = tuple[Any, ...]
_UnitNames = tuple[tuple[str, str], ...]
"""For each unit the file of its part, and the name of its function."""

_DAMAGE = (pickle.UnpicklingError, ImportError, AttributeError, RuntimeError, TypeError, ValueError)
"""Errors from a file that is whole and yet wrong, because the process that wrote it was."""

_known: dict[tuple[Path, str], Part] = {}
"""The parts that this process has, by folder and file."""

_units: dict[str, Any] = {}
"""The units whose machine code this process has, by the names of their functions."""


def prepare_loading() -> None:
    """Have what machine code needs that is loaded; the compiler, a third of a second, is not."""
    rtsys.initialize(cpu_target.target_context)


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
        # The folder's name stands for the content of all files, unless one was written since.
        is_known = sources().is_as_digested(function.__code__.co_filename, stamp)
        self._stamp = None if is_known else stamp
        self._given = folder
        self.units: _UnitNames = ()

    @property
    def folder(self) -> CodeFolder | None:
        """Where the files are."""
        return self._given if self._given is not None else code_folder()

    def load(self, key: _Key) -> object:
        """Return the compiled function of a key; None if it is to be compiled."""
        code = None if self.folder is None else self.folder.load(self.file(key))
        if self.folder is None or code is None:
            return None
        units, compiled = pickle.loads(code)
        return compiled if _load_units(self.folder, units) else None

    def save(self, key: _Key, compiled: object) -> None:
        """Keep a compiled function."""
        if self.folder is not None:
            self.folder.save(self.file(key), dumps((self.units, compiled)))

    def discard(self, key: _Key) -> None:
        """Delete a file of which numba can make nothing."""
        if self.folder is not None:
            self.folder.heal(self.file(key))

    def flush(self) -> None:
        """Do nothing: other functions' code is in the folder, too."""

    def file(self, key: _Key, kind: str = "") -> str:
        """Return the name of the file for a key."""
        signature, *rest = key
        content = repr(([str(each) for each in signature], rest, self._stamp))
        return name_of_code(self._name + kind, content)


class CodeCache(FunctionCache):
    """numba's cache of a function, with our files, and the function's parts.

    Parameters
    ----------
    function : function
    stamp : object
        `rrins.compiled.sources.stamp_of` its file, from when the function was made.
    folder : CodeFolder or None
        Where the code is kept; the user's with None.
    """

    _impl_class = _Results

    def __init__(self, function: Any, stamp: object, folder: CodeFolder | None) -> None:
        FunctionCache.__init__(self, function)
        self._numba: Any = super()
        self._files = _Files(function, stamp, folder)
        self._cache_file = self._files

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the whole of a signature; None if it is to be compiled."""
        with signals_deferred():
            try:
                prepare_loading()
                return self._numba._load_overload(signature, target)
            except _DAMAGE:
                self._files.discard(self._numba._index_key(signature, target.codegen()))
                return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the whole of a signature."""
        with signals_deferred():
            self._files.units = _names(result.library)
            self._numba.save_overload(signature, result)

    def file_of_part(self, kinds: tuple[Any, ...]) -> str:
        """Return the name of the file of a part, by the types of its arguments."""
        key = self._numba._index_key(kinds, cpu_target.target_context.codegen())
        return self._files.file(key, ".part")

    @contextmanager
    def claimed(self, file: str) -> Iterator[None]:
        """Let no other process compile a part meanwhile; wait for one that does."""
        if self._files.folder is None:
            yield
            return
        with self._files.folder.claimed(file):
            yield

    def load_part(self, file: str) -> Part | None:
        """Return a part; None if it, or one that it calls, is to be compiled."""
        cpu_target.target_context.refresh()
        folder = self._files.folder
        if folder is None:
            return None
        with signals_deferred():
            try:
                return _load_part(folder, file)
            except _DAMAGE:
                folder.heal(file)
                return None

    def save_part(self, part: Part) -> None:
        """Keep a part."""
        folder, library = self._files.folder, part.library
        if folder is None:
            return
        part.descriptor.typemap = part.descriptor.calltypes = None  # not needed, and may be large
        calls = [called.file for called in library.calls]
        with signals_deferred():
            kept = library.kept_state(), part.descriptor, part.signature, calls
            folder.save(library.file, dumps(kept))
            _known[folder.path, library.file] = part

    def make_unit(self, part: PartLibrary) -> None:
        """Have the machine code of a unit in this process."""
        folder = self._files.folder
        if part.entry in _units:
            return
        if folder is None:
            _units[part.entry] = WholeLibrary.of_unit(part, self.make_unit)
            return
        if self._load_unit(folder, part):
            return
        with self.claimed(_unit_file(part.file)):
            if not self._load_unit(folder, part):
                library = _units[part.entry] = WholeLibrary.of_unit(part, self.make_unit)
                kept = library.serialize_using_object_code()
                with signals_deferred():
                    folder.save(_unit_file(part.file), dumps((part.entry, _names(library), kept)))

    def _load_unit(self, folder: CodeFolder, part: PartLibrary) -> bool:
        with signals_deferred():
            try:
                return _load_units(folder, ((part.file, part.entry),))
            except _DAMAGE:
                folder.heal(_unit_file(part.file))
                return False


def _unit_file(file: str) -> str:
    """Return the file of a unit's machine code, from that of its part."""
    return name_of_code("unit", file)


def _names(library: Any) -> _UnitNames:
    return tuple((unit.file, unit.entry) for unit in getattr(library, "units", ()))


def _load_units(folder: CodeFolder, units: _UnitNames) -> bool:
    """Load machine code of units; return whether it is what their callers were compiled with."""
    for file, entry in units:
        if entry in _units:
            continue
        data = folder.load(_unit_file(file))
        if data is None:
            return False
        found, called, state = pickle.loads(data)
        if found != entry or not _load_units(folder, called):
            return False
        _units[entry] = cpu_target.target_context.codegen().unserialize_library(state)
    return True


def _load_part(folder: CodeFolder, file: str) -> Part | None:
    """Return a part with all that it calls."""
    known = _known.get((folder.path, file))
    if known is not None:
        return known
    data = folder.load(file)
    if data is None:
        return None
    state, descriptor, signature, names = pickle.loads(data)
    calls = [part.library for name in names if (part := _load_part(folder, name)) is not None]
    if len(calls) < len(names):
        return None
    part = Part(PartLibrary.restored(state, file, calls), descriptor, signature)
    _known[folder.path, file] = part
    return part
