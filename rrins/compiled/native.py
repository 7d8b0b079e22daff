"""Machine code in memory: objects are loaded, linked with each other, and called from Python.

An object is the code of one function with all that it calls, except for units, which are objects of
their own. One that Python calls has an entry with the calling convention of CPython
(``METH_FASTCALL``), as `rrins.compiled.entry_code` writes it.
"""

from __future__ import annotations

import ctypes
import functools
import json
import pickle
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from llvmlite import binding as llvm

from rrins.compiled.code_folder import CodeFolder, shipped
from rrins.compiled.compile_events import signals_deferred

_METH_FASTCALL = 0x80  # Include/methodobject.h
DATA, SHAPE, STRIDES = 16, 32, 40
"""Offsets of fields of numpy's `PyArrayObject`, which its binary interface fixes."""
RECORD = 24
"""Offset of the address of the data in numpy's `PyVoidScalarObject`."""


class RaisedError(Exception):
    """An exception of compiled code, by the address of its description."""


@dataclass(frozen=True)
class Code:
    """Machine code as it is kept.

    Attributes
    ----------
    entry : str
        Name of its function.
    units : tuple of str
        The files of the units that it calls.
    machine_code : bytes
        An object file.
    """

    entry: str
    units: tuple[str, ...]
    machine_code: bytes = field(repr=False)

    def to_bytes(self) -> bytes:
        """Return what is kept."""
        return json.dumps([self.entry, self.units]).encode() + b"\n" + self.machine_code

    @classmethod
    def from_bytes(cls, data: bytes) -> Code:
        """Return the code of what was kept.

        Raises
        ------
        ValueError
            When it is none.
        """
        head, _, machine_code = data.partition(b"\n")
        entry, units = json.loads(head)
        if not machine_code.startswith(b"\x7fELF"):
            raise ValueError("no object file")
        return cls(entry, tuple(units), machine_code)


class _Method(ctypes.Structure):
    """`PyMethodDef` of Include/methodobject.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


class _Engine:
    """LLVM's linker in this process."""

    def __init__(self) -> None:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        self._functions: dict[str, Callable[..., Any]] = {}
        self._methods: list[_Method] = []
        self._files: set[str] = set()
        self.lock = threading.RLock()

    def add(self, file: str, code: Code) -> None:
        """Load code, unless it is there."""
        if file not in self._files:
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(code.machine_code))
            self._files.add(file)

    def has(self, file: str) -> bool:
        """Return whether the code of a file is loaded."""
        return file in self._files

    def function(self, entry: str) -> Callable[..., Any]:
        """Return a function that Python calls."""
        if entry not in self._functions:
            self._engine.finalize_object()
            address = self._engine.get_function_address(entry)
            method = _Method(entry.encode(), address, _METH_FASTCALL, None)
            self._methods.append(method)
            new = ctypes.pythonapi.PyCFunction_NewEx
            new.argtypes = [ctypes.POINTER(_Method), ctypes.py_object, ctypes.c_void_p]
            new.restype = ctypes.py_object
            self._functions[entry] = new(ctypes.byref(method), RaisedError, None)
        return self._functions[entry]


@functools.cache
def engine() -> _Engine:
    """Return the linker of this process.

    Raises
    ------
    RuntimeError
        When numpy's arrays are not laid out as compiled code takes them.
    """
    array = np.arange(6.0).reshape(2, 3)
    record = np.zeros(1, np.dtype((np.record, [("x", "<f8")])))
    shape = ctypes.c_void_p.from_address(id(array) + SHAPE).value or 0
    strides = ctypes.c_void_p.from_address(id(array) + STRIDES).value or 0
    scalar = record[0]
    is_known = (
        ctypes.c_void_p.from_address(id(array) + DATA).value == array.ctypes.data
        and tuple((ctypes.c_ssize_t * 2).from_address(shape)) == array.shape
        and tuple((ctypes.c_ssize_t * 2).from_address(strides)) == array.strides
        and ctypes.c_void_p.from_address(id(scalar) + RECORD).value == record.ctypes.data
    )
    if not is_known:
        raise RuntimeError("numpy lays out its arrays in an unknown way: set NUMBA_DISABLE_JIT=1")
    return _Engine()


def load(folder: CodeFolder | None, file: str) -> Callable[..., Any] | None:
    """Return the function of a file, for Python to call; None if it is to be made."""
    with signals_deferred(), engine().lock:
        code = _read(folder, file)
        return None if code is None or not load_units(folder, code) else bind(file, code)


def load_units(folder: CodeFolder | None, code: Code) -> bool:
    """Load the units of a code; return whether all are there."""
    for file in code.units:
        if engine().has(file):
            continue
        unit = load_unit(folder, file)
        if unit is None:
            return False
        engine().add(file, unit)
    return True


def load_unit(folder: CodeFolder | None, file: str) -> Code | None:
    """Return a unit's code with all that it needs loaded; None if it is to be made."""
    code = _read(folder, file)
    return code if code is not None and load_units(folder, code) else None


def bind(file: str, code: Code) -> Callable[..., Any]:
    """Return the function of a code, for Python to call; its units are loaded."""
    engine().add(file, code)
    return engine().function(code.entry)


def entry_of(file: str) -> str:
    """Return the name of the function of a file."""
    return re.sub(r"\W", "_", file.removesuffix(".code"))


def _read(folder: CodeFolder | None, file: str) -> Code | None:
    """Return the code of a file, from the package or the user's folder."""
    place = shipped()
    if place is not None and (place / file).exists():
        return Code.from_bytes((place / file).read_bytes())
    data = None if folder is None else folder.load(file)
    if folder is None or data is None:
        return None
    try:
        return Code.from_bytes(data)
    except ValueError:
        folder.heal(file)
        return None


def exception_at(address: int) -> BaseException:
    """Return the exception that numba has described at an address: its class and arguments."""
    place = ctypes.c_void_p.from_address(address).value
    size = ctypes.c_int32.from_address(address + ctypes.sizeof(ctypes.c_void_p)).value
    kind, arguments, *_ = pickle.loads(ctypes.string_at(place or 0, size))
    return kind(*(arguments or ()))
