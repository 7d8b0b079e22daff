"""The intermediate code of single functions, kept between runs, and the machine code of several.

numba makes machine code of each function it compiles, and each caller contains its callees' code
once more. Of the hundreds of functions of a step Python calls one. So a function that compiled code
calls is kept as a *part*: LLVM's intermediate code. It is optimised and becomes machine code once,
with the function that Python calls. A part that many of these call may be a *unit*: an object of
its own, with all that it calls, to which their calls are linked.
"""

from __future__ import annotations

import gc
import importlib
import io
import pickle
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import numba
from llvmlite import binding as llvm
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import cpu_target
from numba.core.serialize import NumbaPickler

from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.compile_events import signals_deferred
from rrins.compiled.native import entry_of
from rrins.compiled.record import Record

_DAMAGE = (pickle.UnpicklingError, ImportError, AttributeError, RuntimeError, TypeError, ValueError)
"""Errors from a file that is whole and yet wrong, because the process that wrote it was."""

_UNCOUNTED = "\n".join(
    f"define void @NRT_{name}(ptr %0) alwaysinline {{ ret void }}" for name in ("incref", "decref")
)
"""Steps count no references: what takes the place of numba's functions that do."""


class PartLibrary(JITCodeLibrary):
    """The intermediate code of one function.

    Attributes
    ----------
    file : str
        Name of the file it is kept in.
    calls : list of PartLibrary
        The parts that it calls.
    entry : str
        The function's name in the code.
    unit : str
        The unit's file; empty if it is none.
    """

    def __init__(self, name: str, file: str, unit: str) -> None:
        super().__init__(cpu_target.target_context.codegen(), name)
        self.file, self.unit, self.entry = file, unit, entry_of(file)
        self.calls: list[PartLibrary] = []

    @property
    def module(self) -> llvm.ModuleRef:
        """Its code, without that of the parts it calls."""
        return self._final_module

    def add_linking_library(self, library: Any) -> None:
        """Note a part that the function calls; what numba provides becomes part of this one."""
        if not isinstance(library, PartLibrary):
            super().add_linking_library(library)
        elif library not in self.calls:
            self.calls.append(library)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave them: the whole is optimised, here or for another processor."""
        ll_module.data_layout = cast(Any, self._codegen)._data_layout

    def finalize(self) -> None:
        """Add what numba provides; optimise nothing and make no machine code."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"  # several objects may contain it
        simplify(self._final_module, cast(Any, self._codegen)._tm)
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the module for a library that is not ours: one with all that it calls."""
        self._ensure_finalized()
        if self._shared_module is None:
            self._shared_module = self._final_module.clone()
            for part in self.with_all_it_calls():
                if part is not self:
                    self._shared_module.link_in(part._final_module, preserve=True)
        return self._shared_module

    def with_all_it_calls(self) -> Iterator[PartLibrary]:
        """Return this part, those it calls, those these call, and so on, each once."""
        return self._reached(beyond_units=True)

    def within(self) -> Iterator[PartLibrary]:
        """Return the same, without what the units among them call."""
        return self._reached(beyond_units=False)

    def _reached(self, beyond_units: bool) -> Iterator[PartLibrary]:
        found = {self: None}
        waiting = [self]
        while waiting:
            part = waiting.pop()
            if part is not self and part.unit and not beyond_units:
                continue
            new = [called for called in part.calls if called not in found]
            found.update(dict.fromkeys(new))
            waiting += new
        return iter(found)


@dataclass(frozen=True)
class Part:
    """A function compiled for one signature, as compiled code calls it."""

    library: PartLibrary
    descriptor: Any  #: numba's description of the function
    signature: Any  #: numba's signature


class _Pickler(NumbaPickler):
    """Writes numba's type of a `Record` as the name of that, which is a thousandth."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._names = {
            numba.from_dtype(each.dtype): (each.__module__, each.__name__)
            for each in Record.__subclasses__()
            if each.__qualname__ == each.__name__
        }

    def persistent_id(self, value: object) -> tuple[str, str] | None:
        """Return the module and name of a record's class; None of whatever else."""
        return self._names.get(value) if isinstance(value, types.Record) else None


class _Unpickler(pickle.Unpickler):
    """Reads what `_Pickler` writes."""

    def persistent_load(self, name: Any) -> object:
        """Return the type of a record."""
        return numba.from_dtype(getattr(importlib.import_module(name[0]), name[1]).dtype)


_known: dict[tuple[object, str], Part] = {}
"""The parts that this process has, by folder and file."""


def load_part(folder: CodeFolder | None, file: str) -> Part | None:
    """Return a part with all that it calls; None if one of them is to be compiled."""
    if folder is None:
        return None
    cpu_target.target_context.refresh()
    with signals_deferred():
        try:
            return _load_part(folder, file)
        except _DAMAGE:
            folder.heal(file)
            return None


def _load_part(folder: CodeFolder, file: str) -> Part | None:
    known = _known.get((folder.path, file))
    if known is not None:
        return known
    data = folder.load(file)
    if data is None:
        return None
    (name, unit, bitcode), descriptor, signature, names = _Unpickler(io.BytesIO(data)).load()
    calls = [part.library for each in names if (part := _load_part(folder, each)) is not None]
    if len(calls) < len(names):
        return None
    library = PartLibrary(name, file, unit)
    library.calls = calls
    library._final_module = llvm.parse_bitcode(bitcode)
    library._finalized = True
    part = _known[folder.path, file] = Part(library, descriptor, signature)
    return part


def save_part(folder: CodeFolder, part: Part) -> None:
    """Keep a part."""
    library, data = part.library, io.BytesIO()
    part.descriptor.typemap = part.descriptor.calltypes = None  # not needed, and may be large
    with signals_deferred():
        state = library.name, library.unit, library.module.as_bitcode()
        names = [called.file for called in library.calls]
        _Pickler(data).dump((state, part.descriptor, part.signature, names))
        folder.save(library.file, data.getvalue())
        _known[folder.path, library.file] = part


def declared(library: PartLibrary) -> str:
    """Return the declaration of a part's function in LLVM's text."""
    function = library.module.get_function(library.entry)
    kinds = ", ".join(str(argument.type) for argument in function.arguments)
    return f"declare i32 @{function.name}({kinds})\n"


def linked(text: str, parts: Iterable[PartLibrary]) -> llvm.ModuleRef:
    """Return a module of its own with some text and the parts it calls; no references are counted.

    A caller comes before those it calls: code that nobody calls yet is left out.
    """
    module, waiting = llvm.parse_assembly(text + _UNCOUNTED), list(parts)
    while waiting:
        module.link_in(_group(waiting[:_GROUP]))
        del waiting[:_GROUP]
    return module


_GROUP = 50
"""LLVM looks through all of a module to link another one to it: so parts join in groups first."""


def _group(parts: Sequence[PartLibrary]) -> llvm.ModuleRef:
    """Return a module with some parts, whether or not anybody calls them yet."""
    names = (part.module.get_function(part.entry).name for part in parts)
    calls = ", ".join(f"ptr @{name}" for name in names)
    kept = f"@rrins.kept = appending global [{len(parts)} x ptr] [{calls}]\n"
    module = llvm.parse_assembly(kept + "".join(dict.fromkeys(map(declared, parts))))
    for part in parts:
        module.link_in(part.module, preserve=True)
    return module


def hide(module: llvm.ModuleRef, entries: Iterable[str]) -> None:
    """Make all but the entries invisible from outside, so that it can be left out."""
    kept = set(entries)
    for each in (*module.functions, *module.global_variables):
        if not each.is_declaration and not each.name.startswith("llvm."):
            each.linkage = "external" if each.name in kept else "internal"


def simplify(module: llvm.ModuleRef, machine: llvm.TargetMachine) -> None:
    """Tidy each function up by itself, which leaves a fifth of what numba writes.

    A function that keeps structs with pointers stays as it is: their layout is the processor's.
    """
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    split, rest = llvm.create_new_function_pass_manager(), llvm.create_new_function_pass_manager()
    split.add_sroa_pass()
    rest.add_simplify_cfg_pass()
    rest.add_instruction_combine_pass()
    rest.add_simplify_cfg_pass()
    for function in module.functions:
        if not function.is_declaration:
            split.run(function, builder)
            if not _OWN_STRUCT.search(str(function)):
                rest.run(function, builder)


_OWN_STRUCT = re.compile(
    r"(?:alloca|load|store|getelementptr(?: \w+)*) [{[<][^\n]*?\bptr\b[^\n]*?[]}>][^\n]*\n"
)


def optimise(module: llvm.ModuleRef, machine: llvm.TargetMachine, inlining: int) -> None:
    """Optimise a module as a whole."""
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.inlining_threshold = inlining
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


@contextmanager
def collector_paused() -> Iterator[None]:
    """Collect no garbage meanwhile: the compiler makes little, and looking for it takes a tenth."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
