"""Machine code of compiled functions for other processors, as objects that a C linker takes.

The intermediate code of a function and of all it calls is one module: what numba's runtime adds to
it goes, everything but the entries becomes internal, and LLVM optimises the whole for its target.
The entries have the calling convention of C; an array is a pointer, and its length where it varies.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from llvmlite import binding as llvm

from rrins.compiled.compilation import IS_DISABLED, Function
from rrins.compiled.compile_events import signals_deferred
from rrins.compiled.compiler import type_of
from rrins.compiled.kinds import ALIGNED, C_ORDER, WRITEABLE
from rrins.compiled.parts import PartLibrary, collector_paused, declared, hide, linked, optimise


class ObjectCodeError(Exception):
    """Machine code cannot be made here."""


@dataclass(frozen=True)
class Processor:
    """A processor that LLVM makes machine code for.

    Attributes
    ----------
    triple, cpu, features : str
        As LLVM names them.
    is_position_independent : bool
    needs_alignment : bool
        Whether it cannot load a number from an address that is no multiple of its size: records
        are packed.
    """

    triple: str
    cpu: str = ""
    features: str = ""
    is_position_independent: bool = True
    needs_alignment: bool = False

    def machine(self) -> llvm.TargetMachine:
        """Return LLVM's description of it."""
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        return llvm.Target.from_triple(self.triple).create_target_machine(
            cpu=self.cpu,
            features=self.features,
            opt=3,
            reloc="pic" if self.is_position_independent else "static",
            codemodel="default",  # without it, one that C linkers have trouble with
        )


@dataclass(frozen=True)
class Argument:
    """An argument of an entry.

    Attributes
    ----------
    name : str
        Of the parameter in C; empty: the entry passes `value` by itself.
    kind : dtype or type
        A dtype is that of an array's elements.
    shape : tuple
        Of an array: numbers, or the name of the parameter with its length. Empty: no array.
    value : int
        That of an argument without a name.
    """

    name: str
    kind: Any
    shape: tuple[int | str, ...] = ()
    value: int | None = None

    @property
    def given(self) -> Any:
        """The kind of argument that the function is compiled for."""
        if not self.shape:
            return self.kind
        return np.dtype(self.kind), len(self.shape), C_ORDER | WRITEABLE | ALIGNED


@dataclass(frozen=True)
class Entry:
    """A function under its name in C; it returns the function's integer, -1 if that raised.

    Attributes
    ----------
    name : str
    function : callable
        A compiled one.
    arguments : tuple of Argument
        All of the function's, in their order.
    """

    name: str
    function: Callable[..., object]
    arguments: tuple[Argument, ...]

    @property
    def parameters(self) -> tuple[tuple[str, Argument | None], ...]:
        """The parameters in C: a name, and the argument it is of; None of a length."""
        found: dict[str, Argument | None] = {}
        for argument in self.arguments:
            if argument.name:
                found[argument.name] = argument
            for size in argument.shape:
                if isinstance(size, str):
                    found.setdefault(size, None)
        return tuple(found.items())


@dataclass(frozen=True)
class Machine:
    """Optimised code of one processor."""

    module: llvm.ModuleRef
    machine: llvm.TargetMachine

    def emit_object(self) -> bytes:
        """Return it as an object file."""
        return cast(bytes, self.machine.emit_object(self.module))

    def undefined(self) -> tuple[str, ...]:
        """Return the names that a linker has to find elsewhere, such as `sin`."""
        names = (f.name for f in self.module.functions if f.is_declaration)
        return tuple(sorted(name for name in names if not name.startswith("llvm.")))


@signals_deferred()
@collector_paused()
def intermediate_code(entries: Sequence[Entry]) -> str:
    """Return the entries and all that they call as LLVM's text, for no processor in particular."""
    if IS_DISABLED:
        raise ObjectCodeError("machine code needs numba's compiler: unset NUMBA_DISABLE_JIT")
    parts: dict[PartLibrary, None] = {}
    libraries, wrappers = [], []
    for entry in entries:
        callee = cast(Function, entry.function).callee
        library = callee.part(tuple(type_of(each.given) for each in entry.arguments))[1].library
        libraries.append(library)
        parts.update(dict.fromkeys(library.with_all_it_calls()))
        wrappers.append(_wrapper(entry, library.module.get_function(library.entry)))
    texts = [*dict.fromkeys(declared(library) for library in libraries), *wrappers]
    module = linked("".join(texts), parts)
    hide(module, (entry.name for entry in entries))
    return _HOST.sub("", str(module))


@signals_deferred()
def optimised(text: str, processor: Processor) -> Machine:
    """Return code optimised as a whole for a processor."""
    try:
        machine = processor.machine()
    except RuntimeError as error:
        raise ObjectCodeError(f"LLVM has no {processor.triple}: {error}") from None
    if processor.needs_alignment:
        text = _unaligned(text)
    module = llvm.parse_assembly(text)
    module.triple = processor.triple
    module.data_layout = str(machine.target_data)
    optimise(module, machine, _INLINING)
    return Machine(module, machine)


_INLINING = 60
"""A step is called in one place: more than this makes it larger and no faster."""

_HOST = re.compile(r"^target (?:triple|datalayout) .*\n", re.MULTILINE)
_LOAD = re.compile(r"^(\s+(?:%\S+ = load |store )(?!atomic).*?), align \d+", re.MULTILINE)


def _unaligned(text: str) -> str:
    """Return a module's text with loads and stores that suit packed records."""
    return _LOAD.sub(r"\1, align 1", text)


def _wrapper(entry: Entry, function: llvm.ValueRef) -> str:
    """Return the entry in LLVM's text: numba's calling convention behind that of C."""
    lines: list[str] = []
    passed = ["ptr %result", "ptr %exception"]
    kinds = iter([str(argument.type) for argument in function.arguments][2:])
    for argument in entry.arguments:
        passed += _array(argument, lines) if argument.shape else [_scalar(argument, next(kinds))]
        for _ in range(2 * len(argument.shape) + 5 if argument.shape else 0):
            next(kinds)
    parameters = ", ".join(
        f"ptr %{name}" if argument is not None and argument.shape else f"i32 %{name}.int"
        for name, argument in entry.parameters
    )
    lengths = [
        f"  %{name} = sext i32 %{name}.int to i64"
        for name, argument in entry.parameters
        if argument is None or not argument.shape
    ]
    body = "\n".join((*lengths, *lines))
    return f"""
define i32 @{entry.name}({parameters}) {{
  %result = alloca i64, align 8
  %exception = alloca ptr, align 8
  store i64 0, ptr %result, align 8
{body}
  %status = call i32 @{function.name}({", ".join(passed)})
  %fine = icmp eq i32 %status, 0
  %value = load i64, ptr %result, align 8
  %short = trunc i64 %value to i32
  %answer = select i1 %fine, i32 %short, i32 -1
  ret i32 %answer
}}
"""


def _scalar(argument: Argument, kind: str) -> str:
    """Return a number, a flag or None as it is passed."""
    if kind == "ptr":
        return "ptr null"
    return f"{kind} %{argument.name}" if argument.name else f"{kind} {argument.value}"


def _array(argument: Argument, lines: list[str]) -> list[str]:
    """Return an array as numba passes it: its owner, size, place, shape and strides."""
    size = np.dtype(argument.kind).itemsize
    strides = [size]
    for length in reversed(argument.shape[1:]):
        assert isinstance(length, int)
        strides.insert(0, strides[0] * length)
    first = argument.shape[0]
    items = f"i64 {first}" if isinstance(first, int) else f"i64 %{first}"
    inner = strides[0] // size
    count = items
    if inner > 1:
        lines.append(f"  %{argument.name}.items = mul {items}, {inner}")
        count = f"i64 %{argument.name}.items"
    shape = [items, *(f"i64 {length}" for length in argument.shape[1:])]
    return [
        "ptr null",
        "ptr null",
        count,
        f"i64 {size}",
        f"ptr %{argument.name}",
        *shape,
        *(f"i64 {stride}" for stride in strides),
    ]
