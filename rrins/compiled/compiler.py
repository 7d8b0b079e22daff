"""Makes the code of compiled functions with numba: parts, units, and what Python calls.

Only this module and those that it imports import numba, which takes most of a second.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any, Protocol

import numba
import numpy as np
from llvmlite import binding as llvm
from numba.core import types
from numba.core.compiler import Compiler, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]  # no stub
from numba.core.errors import NumbaRuntimeError
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.sigutils import normalize_signature
from numba.core.typed_passes import InlineOverloads, NativeLowering, NopythonRewrites
from numba.core.typing.templates import make_concrete_template
from numba.core.untyped_passes import InlineClosureLikes, WithLifting
from numba.np import numpy_support

from rrins.compiled import native
from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.compile_events import compiling, signals_deferred
from rrins.compiled.entry_code import EntryCode
from rrins.compiled.kinds import ALIGNED, C_ORDER, F_ORDER, WRITEABLE, Kinds
from rrins.compiled.native import Code, entry_of
from rrins.compiled.parts import (
    Part,
    PartLibrary,
    collector_paused,
    declared,
    hide,
    linked,
    load_part,
    optimise,
    save_part,
)

_Types = tuple[Any, ...]

_INLINING = 225
"""LLVM's own threshold, with which a loop of many epochs is fastest."""

# numba writes the type of each argument out for each of its passes, whether anyone reads it or not.
setattr(types.Record, "__repr__", functools.cache(types.Record.__repr__))  # noqa: B010 - a method

# numba makes the type of a record anew for each record that contains one: a thousand for sixty.
_any_struct_type = numpy_support.from_struct_dtype
_record_type = functools.cache(_any_struct_type)


def _struct_type(dtype: np.dtype[np.void]) -> types.Record:
    """Return numba's type of a struct; one of ours is made once."""
    is_ours = dtype.type is np.record and not dtype.isalignedstruct
    return (_record_type if is_ours else _any_struct_type)(dtype)


setattr(numpy_support, "from_struct_dtype", _struct_type)  # noqa: B010 - numba's

# At each operator of the code numba tries every kind of operands anew, some thirty of them.
_any_call_type = types.BaseFunction.get_call_type


@functools.cache
def _call_type(function: Any, _variants: int, context: Any, args: _Types, named: _Types) -> Any:
    return _any_call_type(function, context, args, dict(named))


def _known_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Return what numba knows a call of one of its own functions by, found once."""
    return _call_type(self, len(self.templates), context, tuple(args), tuple(kws.items()))


setattr(types.BaseFunction, "get_call_type", _known_call_type)  # noqa: B010 - a method


def type_of(kind: Any) -> Any:
    """Return numba's type of a kind of argument."""
    if isinstance(kind, tuple):
        dtype, dimensions, flags = kind
        order = "C" if flags & C_ORDER else "F" if flags & F_ORDER else "A"
        is_aligned, is_fixed = bool(flags & ALIGNED), not flags & WRITEABLE
        array: Any = types.Array
        return array(numba.from_dtype(dtype), dimensions, order, is_fixed, aligned=is_aligned)
    known = {int: types.int64, float: types.float64, bool: types.boolean, np.uint64: types.uint64}
    if kind in known:
        return known[kind]
    return types.none if kind is type(None) else numba.from_dtype(kind)


def foreign_type(name: str, returns: str, takes: Sequence[str]) -> Any:
    """Return numba's type of a function of the C library."""
    signature = getattr(types, returns)(*(getattr(types, each) for each in takes))
    return types.ExternalFunction(name, signature)


class Source(Protocol):
    """A `rrins.compiled.compilation.Function`, as far as its maker knows it."""

    py_func: Callable[..., object]
    is_unit: bool
    options: dict[str, Any]

    @property
    def folder(self) -> CodeFolder | None:
        """Where its code is kept."""

    def file(self, key: str, kind: str = "") -> str:
        """Return the name of the file of its code."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(NativeLowering):
    """Makes intermediate code that counts no references."""

    _name = "lowering of steps"

    def run_pass(self, state: Any) -> bool:
        """Lower a function."""
        state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        try:
            return bool(super().run_pass(state))
        except NumbaRuntimeError as error:
            raise _allocates(state.func_id.func_qualname) from error


class _Pipeline(Compiler):
    """numba's passes, without what serves functions that allocate: none of ours does.

    Some look for closures, comprehensions, `with`, and arithmetic with whole arrays.
    """

    def define_pipelines(self) -> list[Any]:
        """Return the passes of one way to compile."""
        (usual,), passes = super().define_pipelines(), PassManager("steps")
        own = {NativeLowering: _Lowering}
        passes.passes = [(own.get(k, k), text) for k, text in usual.passes if k not in _NEVER]
        passes.finalize()
        return [passes]


_NEVER = (InlineClosureLikes, InlineOverloads, NopythonRewrites, WithLifting)


class _Compiler(_FunctionCompiler):
    """numba's compiler of a function, into our libraries."""

    def part(self, kinds: _Types, file: str, unit: str) -> Part:
        """Compile for a call from compiled code."""
        library = PartLibrary(self.py_func.__qualname__, file, unit)
        flags: Any = Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_cpython_wrapper = flags.no_compile = True
        with collector_paused():
            result = compile_extra(
                self.targetdescr.typing_context,
                self.targetdescr.target_context,
                self.py_func,
                args=kinds,
                return_type=None,
                flags=flags,
                locals=self.locals,
                library=library,
                pipeline_class=self.pipeline_class,
            )
        library.finalize()
        # numba's name differs from process to process; callers that are kept know this one.
        library.module.get_function(result.fndesc.mangled_name).name = library.entry
        result.fndesc.mangled_name = library.entry
        return Part(library, result.fndesc, result.signature)


class Callee(CPUDispatcher):
    """A function as compiled code calls it, and the maker of what Python calls."""

    def __init__(self, function: Source) -> None:
        # No wrapper for callers in C: there are none, and it is a tenth of the work.
        chosen = {"nopython": True, "boundscheck": None, "no_cfunc_wrapper": True}
        plain: Any = function.py_func
        plain.__signature__ = inspect.signature(plain)  # numba asks for it four times
        super().__init__(plain, targetoptions={**chosen, **function.options})
        self._function = function
        options = self.targetoptions
        self._compiler = _Compiler(plain, self.targetdescr, options, {}, _Pipeline)
        self._parts: dict[_Types, tuple[object, Part]] = {}

    @functools.cached_property
    def numba_type(self) -> Any:
        """Its type in compiled code that calls it."""
        return types.Dispatcher(self)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what types a call from compiled code; compile the part that it calls."""
        python_signature, folded = self._compiler.fold_argument_types(args, kws)
        # One part for all constants: LLVM puts them in where it is worth it.
        _, part = self.part(tuple(types.unliteral(kind) for kind in folded))
        name = self.py_func.__name__
        template = make_concrete_template(f"Call({name})", key=name, signatures=[part.signature])
        return template, python_signature, folded, {}

    def get_overload(self, sig: Any) -> Any:
        """Return what numba knows the part of a signature by."""
        kinds, _ = normalize_signature(sig)
        return self._parts[tuple(kinds)][0]

    def part(self, kinds: _Types) -> tuple[object, Part]:
        """Return the part for the types of its arguments, and what numba knows it by."""
        with global_compiler_lock:
            if kinds not in self._parts:
                part = self._load_or_compile(kinds)
                known_by = object()
                self.targetctx.insert_user_function(known_by, part.descriptor, [part.library])
                self._parts[kinds] = known_by, part
            return self._parts[kinds]

    def _load_or_compile(self, kinds: _Types) -> Part:
        function, key = self._function, repr([str(kind) for kind in kinds])
        file, folder = function.file(key, ".part"), function.folder
        unit = function.file(key, ".unit") if function.is_unit else ""

        def compile_it() -> Part:
            with compiling():
                part = self._compiler.part(kinds, file, unit)
            if folder is not None:
                save_part(folder, part)
            return part

        return _kept(folder, file, load_part, compile_it)

    def make_native(self, kinds: Kinds, file: str) -> Callable[..., Any]:
        """Make what Python calls; keep it."""
        with global_compiler_lock:
            folder = self._function.folder

            def make() -> Callable[..., Any]:
                with signals_deferred():
                    code, units = self._entry(tuple(type_of(kind) for kind in kinds), file)
                    for unit in units:
                        make_unit(folder, unit)
                if folder is not None:
                    folder.save(file, code.to_bytes())
                with signals_deferred(), native.engine().lock:
                    return native.bind(file, code)

            return _kept(folder, file, native.load, make)

    def _entry(self, kinds: _Types, file: str) -> tuple[Code, list[PartLibrary]]:
        part = self.part(kinds)[1]
        library, returns = part.library, part.signature.return_type
        called = library.module.get_function(library.entry)
        is_free = bool(self._function.options.get("nogil"))
        text = EntryCode(entry_of(file), called, kinds, returns, is_free).text
        return _code_of(library, entry_of(file), text)

    def prepare(self, kinds: Sequence[Any]) -> None:
        """Have the code of a part in the folder, and a unit's machine code."""
        library = self.part(tuple(type_of(kind) for kind in kinds))[1].library
        if library.unit:
            with global_compiler_lock:
                make_unit(self._function.folder, library)


def make_unit(folder: CodeFolder | None, part: PartLibrary) -> None:
    """Have the machine code of a unit in this process."""
    engine, file = native.engine(), part.unit
    if engine.has(file):
        return

    def make() -> Code:
        code, units = _code_of(part, part.entry, "")
        for unit in units:
            make_unit(folder, unit)
        if folder is not None:
            folder.save(file, code.to_bytes())
        return code

    code = _kept(folder, file, native.load_unit, make)
    with signals_deferred(), engine.lock:
        engine.add(file, code)


def _kept(folder: CodeFolder | None, file: str, load: Callable[[Any, str], Any], make: Any) -> Any:
    """Return what is loaded from a file, or else made, by one process at a time."""
    found = load(folder, file)
    if found is None:
        with nullcontext() if folder is None else folder.claimed(file):
            found = load(folder, file)
            if found is None:
                found = make()
    return found


@collector_paused()
def _code_of(part: PartLibrary, name: str, entry: str) -> tuple[Code, list[PartLibrary]]:
    """Return the machine code of a unit, or of an entry to a part; and the units that it calls."""
    parts = list(part.within())
    is_called = bool(entry) and bool(part.unit)  # a unit that Python calls is one for that, too
    units = [each for each in parts if each.unit and (each is not part or is_called)]
    machine = cpu_target.target_context.codegen()._tm
    module = linked(declared(part) + entry, (each for each in parts if each not in units))
    hide(module, (name,))
    optimise(module, machine, _INLINING)
    _check(module, part.name)
    code = Code(name, tuple(unit.unit for unit in units), machine.emit_object(module))
    return code, units


def _check(module: llvm.ModuleRef, name: str) -> None:
    """Refuse code that calls numba's runtime, which nobody loads to run it."""
    if any(each.is_declaration and each.name.startswith("NRT_") for each in module.functions):
        raise _allocates(name)


def _allocates(name: str) -> TypeError:
    what = "compiled code allocates nothing: a slice that is set to another one does"
    return TypeError(f"{what} ({name})")
