"""The intermediate code of single functions, and the machine code that is made of all of it.

numba makes machine code of each function it compiles, and each caller contains its callees' code
once more. Of the hundreds of functions of a step Python calls one. So a function that only compiled
code calls is kept as a *part*: LLVM's intermediate code. It is optimised and becomes machine code
once, within the function that Python calls, the *whole*. A part that many wholes call may be a
*unit*: machine code of its own, with all that it calls, to which their calls are linked.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

from llvmlite import binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.registry import cpu_target


class PartLibrary(JITCodeLibrary):
    """The intermediate code of one function.

    Attributes
    ----------
    file : str
        Name of the file it is kept in.
    calls : list of PartLibrary
        The parts that it calls.
    environment : object
        numba's record of the function's constants.
    entry : str
        The function's name in the code.
    is_unit : bool
        Whether it is a unit.
    """

    def __init__(self, name: str, file: str, is_unit: bool) -> None:
        super().__init__(cpu_target.target_context.codegen(), name)
        self.file, self.is_unit, self.entry = file, is_unit, ""
        self.calls: list[PartLibrary] = []
        self.environment: Any = None

    @classmethod
    def restored(cls, state: tuple[Any, ...], file: str, calls: list[PartLibrary]) -> PartLibrary:
        """Return the library of a state that `kept_state` returned."""
        name, bitcode, environment, at_load, entry, is_unit = state
        library = cls(name, file, is_unit)
        library.entry = entry
        for function in at_load:
            function()
        library._reload_init.update(at_load)
        library._final_module = llvm.parse_bitcode(bitcode)
        library.calls, library.environment = calls, environment
        library._finalized = True
        return library

    def kept_state(self) -> tuple[Any, ...]:
        """Return what makes the library again, its calls apart."""
        code = self._final_module.as_bitcode()
        at_load = list(self._reload_init)
        return self.name, code, self.environment, at_load, self.entry, self.is_unit

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
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"  # several wholes may contain it
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
            if part is not self and part.is_unit and not beyond_units:
                continue
            new = [called for called in part.calls if called not in found]
            found.update(dict.fromkeys(new))
            waiting += new
        return iter(found)


class WholeLibrary(JITCodeLibrary):
    """The machine code of a function that Python calls, or of a unit, with all parts it needs.

    Parameters
    ----------
    name : str
    make_unit : callable
        Has the engine know the machine code of a unit.

    Attributes
    ----------
    units : dict
        The units whose code this one needs.
    """

    def __init__(self, name: str, make_unit: Callable[[PartLibrary], None]) -> None:
        super().__init__(cpu_target.target_context.codegen(), name)
        self._parts: dict[PartLibrary, None] = {}
        self.units: dict[PartLibrary, None] = {}
        self._make_unit = make_unit
        self.enable_object_caching()

    @classmethod
    def of_unit(cls, part: PartLibrary, make_unit: Callable[[PartLibrary], None]) -> WholeLibrary:
        """Return the machine code of a unit."""
        library = cls(part.name, make_unit)
        module = part._final_module.clone()
        module.get_function(part.entry).linkage = "external"
        library._final_module.link_in(module)
        library._add(part, part.within())
        with collector_paused():
            library.finalize()
        return library

    def add_linking_library(self, library: Any) -> None:
        """Note what is to be linked in."""
        if not isinstance(library, PartLibrary):
            super().add_linking_library(library)
            return
        library._ensure_finalized()
        self._add(None, (library,) if library.is_unit else library.within())

    def _add(self, own: PartLibrary | None, parts: Iterable[PartLibrary]) -> None:
        for part in parts:
            (self.units if part.is_unit and part is not own else self._parts)[part] = None

    def finalize(self) -> None:
        """Link, optimise and make machine code."""
        for unit in self.units:
            self._make_unit(unit)
        for part in self._parts:
            self._reload_init.update(part._reload_init)
            if not part.is_unit:
                self._final_module.link_in(part._final_module, preserve=True)
        super().finalize()
        for part in self._parts:
            name = part.environment.env_name
            if self._codegen._engine.is_symbol_defined(name):
                cast(Any, self._codegen).set_env(name, part.environment)

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """Return what is kept: machine code, and the names of the functions in it.

        numba keeps all intermediate code for a library that may be linked with this one, and
        takes the names from it. Nothing is linked with a whole, and to read that code would take
        half of the time in which one is loaded: here each function is an empty one.
        """
        self._ensure_finalized()
        functions = (f.name for f in self._final_module.functions if not f.is_declaration)
        names = "\n".join(f'define void @"{name}"() {{ ret void }}' for name in functions)
        code: bytes = llvm.parse_assembly(names).as_bitcode()
        return self.name, "object", (self._get_compiled_object(), code)


@dataclass(frozen=True)
class Part:
    """A function compiled for one signature, as compiled code calls it."""

    library: PartLibrary
    descriptor: Any  #: numba's description of the function
    signature: Any  #: numba's signature


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
