"""The kinds of arguments that machine code is made for, and their names in every process."""

from __future__ import annotations

import functools
import hashlib
from types import NoneType
from typing import Any

import numpy as np

LANES = 8
"""Floats side by side: of the widest vectors there are; other processors take two turns or four."""

Kinds = tuple[Any, ...]
"""For each argument a Python type; the dtype of a record; or dtype, dimensions and flags."""

C_ORDER, F_ORDER, WRITEABLE = 1, 2, 0x400
ALIGNED = 0x100
"""Flags of an array, as numpy numbers them (`NPY_ARRAY_C_CONTIGUOUS` and so on)."""

_FLAGS = C_ORDER | F_ORDER | WRITEABLE | ALIGNED
_SMALL = 1 << 63
_INTEGERS, _FRACTIONS = (int, np.integer), (float, np.floating)  # `int | …` is made at each call


def kind_of(value: Any) -> object:
    """Return the kind of an argument."""
    kind = type(value)
    if kind is np.ndarray:
        return value.dtype, value.ndim, value.flags.num & _FLAGS
    if kind is np.record or kind is np.void:
        return value.dtype
    if kind is float or kind is bool or kind is NoneType or kind is np.uint64:
        return kind
    if isinstance(value, _INTEGERS):
        return int if -_SMALL <= value < _SMALL else np.uint64
    if isinstance(value, _FRACTIONS):
        return float
    if isinstance(value, np.bool_):
        return bool
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.num & _FLAGS
    raise TypeError(f"compiled code takes no {kind.__name__}")


def text_of(kind: Any) -> str:
    """Return the name of a kind, the same in every process."""
    if isinstance(kind, tuple):
        return repr((_text_of_dtype(kind[0]), *kind[1:]))
    return kind.__name__ if isinstance(kind, type) else _text_of_dtype(kind)


@functools.cache
def _text_of_dtype(dtype: np.dtype[Any]) -> str:
    content = repr((dtype.type.__name__, dtype.str, dtype.descr))
    return hashlib.sha256(content.encode()).hexdigest()[:16]
