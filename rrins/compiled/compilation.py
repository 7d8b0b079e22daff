"""Compiles the functions of the steps: as wholes for Python, as parts for compiled code.

`compiled` is numba's `njit` with two differences: the code is kept between runs
(`rrins.compiled.code_cache`), and only what Python calls becomes machine code
(`rrins.compiled.code_library`), which halves the time that the first start compiles.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import types
from numba.core.compiler import Compiler, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]  # no stub
from numba.core.event import trigger_event
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature
from numba.core.typing.templates import make_concrete_template
from numba.np import numpy_support

from rrins.compiled.code_cache import CodeCache
from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.code_library import Part, PartLibrary, WholeLibrary, collector_paused
from rrins.compiled.sources import stamp_of

_F = TypeVar("_F", bound=Callable[..., object])
_Kinds = tuple[Any, ...]

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


class _Compiler(_FunctionCompiler):
    """numba's compiler of a function, into our libraries."""

    def __init__(
        self,
        function: Callable[..., object],
        target: Any,
        options: dict[str, Any],
        make_unit: Callable[[PartLibrary], None],
    ) -> None:
        super().__init__(function, target, options, {}, Compiler)
        self._make_unit = make_unit

    def part(self, kinds: _Kinds, file: str, is_unit: bool) -> Part:
        """Compile for a call from compiled code."""
        library = PartLibrary(self.py_func.__qualname__, file, is_unit)
        result = self._compile_into(library, kinds, None, is_part=True)
        library.environment = result.environment
        library.entry = result.fndesc.llvm_func_name
        library.finalize()
        return Part(library, result.fndesc, result.signature)

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        library = WholeLibrary(self.py_func.__qualname__, self._make_unit)
        with collector_paused():
            return self._compile_into(library, args, return_type, is_part=False)

    def _compile_into(self, library: Any, args: Any, return_type: Any, is_part: bool) -> Any:
        flags: Any = Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        if is_part:
            flags.no_cpython_wrapper = flags.no_compile = True
        return compile_extra(
            self.targetdescr.typing_context,
            self.targetdescr.target_context,
            self.py_func,
            args=args,
            return_type=return_type,
            flags=flags,
            locals=self.locals,
            library=library,
            pipeline_class=self.pipeline_class,
        )


class Function(CPUDispatcher):
    """A compiled function: a whole where Python calls it, a part where compiled code does."""

    def __init__(
        self, function: Any, folder: CodeFolder | None, is_unit: bool, options: dict[str, Any]
    ) -> None:
        # No wrapper for callers in C: there are none, and it is a tenth of the work.
        chosen = {"nopython": True, "boundscheck": None, "no_cfunc_wrapper": True, **options}
        function.__signature__ = inspect.signature(function)  # numba asks for it four times
        super().__init__(function, targetoptions=chosen)
        del self._cache  # numba's, which keeps nothing
        self._stamp, self._folder = stamp_of(function.__code__.co_filename), folder
        self._is_unit = is_unit
        self._compiler = _Compiler(
            function, self.targetdescr, chosen, lambda unit: self._cache.make_unit(unit)
        )
        self._parts: dict[_Kinds, tuple[object, Part]] = {}

    @functools.cached_property
    def _cache(self) -> CodeCache:
        """Made when code is asked for: of most functions it never is."""
        return CodeCache(self.py_func, self._stamp, self._folder)

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

    def part(self, kinds: _Kinds) -> tuple[object, Part]:
        """Return the part for the types of its arguments, and what numba knows it by."""
        with global_compiler_lock:
            if kinds not in self._parts:
                with self._compiling_counter:
                    part = self._load_or_compile(kinds)
                known_by = object()
                self.targetctx.insert_user_function(known_by, part.descriptor, [part.library])
                self._parts[kinds] = known_by, part
            return self._parts[kinds]

    def _load_or_compile(self, kinds: _Kinds) -> Part:
        file = self._cache.file_of_part(kinds)
        part = self._cache.load_part(file)
        if part is not None:
            return part
        with self._cache.claimed(file):
            part = self._cache.load_part(file)
            if part is None:
                details = {"dispatcher": self, "args": kinds, "return_type": None}
                with trigger_event("numba:compile", data=details):
                    part = self._compiler.part(kinds, file, self._is_unit)
                self._cache.save_part(part)
        return part

    def prepare(self, kinds: _Kinds) -> None:
        """Have the code of a part in the folder, and a unit's machine code."""
        library = self.part(kinds)[1].library
        if library.is_unit:
            with global_compiler_lock:
                self._cache.make_unit(library)


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
        if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # set as it loads
            function.py_func = function  # type: ignore[attr-defined]  # as a compiled one has it
            return function
        return cast(_F, Function(function, folder, is_unit, options))

    return compile_later
