"""Teaches numba the type of `rrins.compiled.lanes`: a vector of LLVM's."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.registry import cpu_target
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from rrins.compiled.kinds import LANES

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(32)


class LanesType(types.Type):
    """numba's type of eight floats side by side."""

    def __init__(self) -> None:
        super().__init__(f"Lanes{LANES}")


LANES_TYPE = LanesType()
_OPERATORS = (
    (operator.add, operator.iadd, "fadd"),
    (operator.sub, operator.isub, "fsub"),
    (operator.mul, operator.imul, "fmul"),
    (operator.truediv, operator.itruediv, "fdiv"),
)


@register_model(LanesType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)  # type: ignore[no-untyped-call]


def _spread(builder: Any, value: Any) -> Any:
    """Return a vector; a float becomes one of equal lanes."""
    if value.type == _VECTOR:
        return value
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, value, _INDEX(0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, LANES), None))


def _teach_operator(function: Any, instruction: str) -> None:
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            numbers = types.Float, types.Integer
            if LANES_TYPE in args and all(
                each is LANES_TYPE or isinstance(each, numbers) for each in args
            ):
                chosen = (each if each is LANES_TYPE else types.float64 for each in args)
                return signature(LANES_TYPE, *chosen)
            return None

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*(_spread(builder, each) for each in args))

    infer_global(function)(Template)
    one, other = LANES_TYPE, types.float64
    for kinds in ((one, one), (one, other), (other, one)):
        lower_builtin(function, *kinds)(lower)


def _of_llvm(name: str) -> Callable[..., Any]:
    """Return what calls a function of LLVM's on vectors."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(args))
        full = f"llvm.{name}.v{LANES}f64"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), args)

    return lower


def _teach_unary(function: Any, lower: Callable[..., Any]) -> None:
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(LANES_TYPE, LANES_TYPE) if args == (LANES_TYPE,) else None

    infer_global(function)(Template)
    lower_builtin(function, LANES_TYPE)(lower)


for _operator, _in_place, _instruction in _OPERATORS:
    _teach_operator(_operator, _instruction)
    _teach_operator(_in_place, _instruction)
_teach_unary(operator.neg, lambda context, builder, sig, args: builder.fneg(args[0]))
_teach_unary(math.sqrt, _of_llvm("sqrt"))
_teach_unary(abs, _of_llvm("fabs"))


def _row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the address of a row."""
    data = context.make_array(sig.args[0])(context, builder, args[0]).data
    first = builder.mul(args[1], ir.Constant(args[1].type, LANES))
    return builder.bitcast(builder.gep(data, [first]), _VECTOR.as_pointer())


@intrinsic
def _load(typing: Any, array: Any, row: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_row(context, builder, sig, args), align=8)

    return LANES_TYPE(array, types.intp), lower


@intrinsic
def _store(typing: Any, array: Any, row: Any, lanes: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(_spread(builder, args[2]), _row(context, builder, sig, args), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), lower


@intrinsic
def _fetch(typing: Any, array: Any, index: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        place = builder.bitcast(builder.gep(data, [args[1]]), cgutils.voidptr_t)
        kind = ir.FunctionType(ir.VoidType(), [place.type, _INDEX, _INDEX, _INDEX])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [place, _INDEX(0), _INDEX(3), _INDEX(1)])
        return context.get_dummy_value()

    return types.void(array, types.intp), lower


@intrinsic
def _rounded(typing: Any, lanes: Any) -> Any:
    return LANES_TYPE(LANES_TYPE), _of_llvm("rint")


@intrinsic
def _sign(typing: Any, lanes: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        one = _spread(builder, ir.Constant(ir.DoubleType(), 1.0))
        return _of_llvm("copysign")(context, builder, sig, (one, args[0]))

    return LANES_TYPE(LANES_TYPE), lower


@intrinsic
def _spread_out(typing: Any, value: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _spread(builder, args[0])

    return LANES_TYPE(types.float64), lower


@intrinsic
def _larger(typing: Any, one: Any, other: Any) -> Any:
    return LANES_TYPE(LANES_TYPE, LANES_TYPE), _of_llvm("maxnum")


@intrinsic
def _unchanged(typing: Any, before: Any, one: Any, other: Any) -> Any:
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        more = builder.fadd(args[0], _spread(builder, ir.Constant(ir.DoubleType(), 1.0)))
        same = builder.fcmp_ordered("==", args[1], args[2])
        return builder.select(same, more, ir.Constant(_VECTOR, None))

    return LANES_TYPE(LANES_TYPE, LANES_TYPE, LANES_TYPE), lower


def operation_type(name: str) -> Any:
    """Return numba's type of an operation of `rrins.compiled.lanes`."""
    named = {
        "fetch": _fetch,
        "load": _load,
        "store": _store,
        "rounded": _rounded,
        "sign": _sign,
        "spread": _spread_out,
        "larger": _larger,
        "unchanged": _unchanged,
    }
    return cpu_target.typing_context.resolve_value_type(named[name])


cpu_target.typing_context.refresh()  # a compilation that is under way knows all this from here on
cpu_target.target_context.refresh()
