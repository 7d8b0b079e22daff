"""The entries through which Python calls machine code, in LLVM's text.

An entry takes Python's arguments as CPython hands them over, an array of objects, and calls a
function by numba's convention: a place for the result, one for the description of an exception, and
the arguments, an array as its owner, owner's object, items, size of an item, data, shape, strides.
`rrins.compiled.compilation` has checked the kinds of the arguments.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding as llvm
from numba.core import types
from numba.core.registry import cpu_target

from rrins.compiled.native import DATA, RECORD, SHAPE, STRIDES

_DECLARED = """
declare i64 @PyLong_AsLongLong(ptr)
declare i64 @PyLong_AsUnsignedLongLongMask(ptr)
declare double @PyFloat_AsDouble(ptr)
declare i32 @PyObject_IsTrue(ptr)
declare ptr @PyErr_Occurred()
declare void @PyErr_SetObject(ptr, ptr)
declare ptr @PyLong_FromVoidPtr(ptr)
declare ptr @PyLong_FromLongLong(i64)
declare ptr @PyLong_FromUnsignedLongLong(i64)
declare ptr @PyFloat_FromDouble(double)
declare ptr @PyBool_FromLong(i64)
declare void @Py_IncRef(ptr)
declare ptr @PyTuple_New(i64)
declare i32 @PyTuple_SetItem(ptr, i64, ptr)
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
@_Py_NoneStruct = external global i8
"""

_NONE = -2  # status with which numba returns None where there may be a value


class EntryCode:
    """Writes an entry.

    Parameters
    ----------
    name : str
    function : llvm.ValueRef
        What it calls.
    takes : sequence
        numba's types of the arguments.
    returns : object
        numba's type of the result.
    is_free : bool
        Whether other threads may run meanwhile.
    """

    def __init__(
        self,
        name: str,
        function: llvm.ValueRef,
        takes: tuple[Any, ...],
        returns: Any,
        is_free: bool,
    ) -> None:
        self._lines: list[str] = []
        self._count = 0
        parameters = [str(argument.type) for argument in function.arguments]
        passed = ["ptr %result", "ptr %raised"]
        for index, kind in enumerate(takes):
            passed += self._argument(index, kind, parameters[len(passed) :])
        arguments = "\n".join(self._lines)
        self._lines = []
        result = _stored(returns)
        value = self._value(returns, result, "%result")
        answer = "\n".join(self._lines)
        save = "%thread = call ptr @PyEval_SaveThread()" if is_free else ""
        restore = "call void @PyEval_RestoreThread(ptr %thread)" if is_free else ""
        self.text = f"""{_DECLARED}
define ptr @{name}(ptr %exception, ptr %arguments, i64 %count) {{
  %result = alloca {result}, align 16
  %raised = alloca ptr, align 8
  store {result} zeroinitializer, ptr %result, align 8
{arguments}
  %wrong = call ptr @PyErr_Occurred()
  %is_wrong = icmp ne ptr %wrong, null
  br i1 %is_wrong, label %refuse, label %run
refuse:
  ret ptr null
run:
  {save}
  %status = call i32 @{function.name}({", ".join(passed)})
  {restore}
  switch i32 %status, label %raise [ i32 0, label %answer
                                     i32 {_NONE}, label %none ]
raise:
  %description = load ptr, ptr %raised, align 8
  %address = call ptr @PyLong_FromVoidPtr(ptr %description)
  call void @PyErr_SetObject(ptr %exception, ptr %address)
  ret ptr null
none:
  call void @Py_IncRef(ptr @_Py_NoneStruct)
  ret ptr @_Py_NoneStruct
answer:
{answer}
  ret ptr {value}
}}
"""

    def _new(self, expression: str) -> str:
        """Return the name of a new value."""
        self._count += 1
        name = f"%v{self._count}"
        self._lines.append(f"  {name} = {expression}")
        return name

    def _load(self, kind: str, place: str, offset: int) -> str:
        at = self._new(f"getelementptr i8, ptr {place}, i64 {offset}")
        return self._new(f"load {kind}, ptr {at}, align 1")

    def _argument(self, index: int, kind: Any, parameters: list[str]) -> list[str]:
        """Return what is passed for an argument."""
        argument = self._load("ptr", "%arguments", 8 * index)
        if isinstance(kind, types.NoneType):
            return ["ptr null"]
        if isinstance(kind, types.Array):
            return self._array(argument, kind)
        if isinstance(kind, types.Record):
            return [f"ptr {self._load('ptr', argument, RECORD)}"]
        if isinstance(kind, types.Float):
            return [f"double {self._new(f'call double @PyFloat_AsDouble(ptr {argument})')}"]
        if isinstance(kind, types.Boolean):
            is_true = self._new(f"call i32 @PyObject_IsTrue(ptr {argument})")
            return [f"{parameters[0]} {self._new(f'trunc i32 {is_true} to {parameters[0]}')}"]
        convert = "PyLong_AsLongLong" if _is_signed(kind) else "PyLong_AsUnsignedLongLongMask"
        return [f"i64 {self._new(f'call i64 @{convert}(ptr {argument})')}"]

    def _array(self, argument: str, kind: Any) -> list[str]:
        shapes, strides = self._load("ptr", argument, SHAPE), self._load("ptr", argument, STRIDES)
        places = range(kind.ndim)
        shape = [self._load("i64", shapes, 8 * place) for place in places]
        steps = [self._load("i64", strides, 8 * place) for place in places]
        items = "1"
        for length in shape:
            items = self._new(f"mul i64 {items}, {length}")
        size = kind.dtype.size if isinstance(kind.dtype, types.Record) else _size(kind.dtype)
        return [
            "ptr null",
            "ptr null",
            f"i64 {items}",
            f"i64 {size}",
            f"ptr {self._load('ptr', argument, DATA)}",
            *(f"i64 {each}" for each in (*shape, *steps)),
        ]

    def _value(self, kind: Any, stored: str, place: str) -> str:
        """Return the Python object of a result at a place."""
        if isinstance(kind, types.NoneType):
            self._lines.append("  call void @Py_IncRef(ptr @_Py_NoneStruct)")
            return "@_Py_NoneStruct"
        if isinstance(kind, types.Optional):
            return self._value(kind.type, stored, place)
        if isinstance(kind, types.BaseTuple):
            members: tuple[Any, ...] = tuple(kind)  # type: ignore[arg-type]  # numba's stub is short
            whole = self._new(f"call ptr @PyTuple_New(i64 {len(members)})")
            for index, each in enumerate(members):
                at = self._new(f"getelementptr {stored}, ptr {place}, i32 0, i32 {index}")
                value = self._value(each, _stored(each), at)
                self._new(f"call i32 @PyTuple_SetItem(ptr {whole}, i64 {index}, ptr {value})")
            return whole
        if isinstance(kind, types.Float):
            value = self._new(f"load double, ptr {place}")
            return self._new(f"call ptr @PyFloat_FromDouble(double {value})")
        value = self._new(f"load {stored}, ptr {place}")
        if isinstance(kind, types.Boolean):
            wide = self._new(f"zext {stored} {value} to i64")
            return self._new(f"call ptr @PyBool_FromLong(i64 {wide})")
        if not isinstance(kind, types.Integer):
            raise TypeError(f"compiled code returns no {kind} to Python")
        sign, maker = ("sext", "") if _is_signed(kind) else ("zext", "Unsigned")
        if stored != "i64":
            value = self._new(f"{sign} {stored} {value} to i64")
        return self._new(f"call ptr @PyLong_From{maker}LongLong(i64 {value})")


def _is_signed(kind: Any) -> bool:
    return bool(kind.signed)


def _size(kind: Any) -> int:
    """Return the bytes of a number in an array."""
    return 1 if isinstance(kind, types.Boolean) else int(kind.bitwidth) // 8


def _stored(kind: Any) -> str:
    """Return LLVM's type of a value within a result."""
    return str(cpu_target.target_context.data_model_manager[kind].get_return_type())
