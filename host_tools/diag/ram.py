"""Fields of the RAM image: their addresses and values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.regions import Region

_Dtype = np.dtype[Any]  # of a record, an array or a number


class MemoryPathError(ValueError):
    """The RAM image has no such part."""


def part_of(path: str) -> Region:
    """Return the part of the RAM image at a path, such as ``sequencer.target_angle_deg.0``.

    Raises
    ------
    MemoryPathError
        If there is no such part.
    """
    whole = table.regions()[0]
    if path == whole.name:
        return whole
    address, dtype = 0, whole.dtype
    for step in path.split("."):
        offset, dtype = _below(dtype, step, path)
        address += offset
    return Region(path, address, dtype.itemsize, whole.access, dtype)


def _below(dtype: _Dtype, step: str, path: str) -> tuple[int, _Dtype]:
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        inner = base if len(shape) == 1 else np.dtype((base, shape[1:]))
        if step.isdigit() and int(step) < shape[0]:
            return int(step) * inner.itemsize, inner
        raise MemoryPathError(f"memory {path}: {step!r} is not an index from 0 to {shape[0] - 1}")
    if dtype.fields is None or step not in dtype.fields:
        there = ", ".join(dtype.names or ()) or "none"
        raise MemoryPathError(f"memory {path}: there is no {step!r}; fields: {there}")
    inner, offset = dtype.fields[step][:2]
    return int(offset), inner


def paths_below(begun: str) -> list[str]:
    """Return the paths that start with `begun`, one level down."""
    above, _, name = begun.rpartition(".")
    try:
        dtype = part_of(above).dtype if above else table.regions()[0].dtype
    except MemoryPathError:
        return []
    prefix = f"{above}." if above else ""
    names = dtype.names or ()
    if dtype.subdtype is not None:
        names = tuple(str(k) for k in range(dtype.subdtype[1][0]))
    return [prefix + one for one in names if one.startswith(name)]


def leaves(part: Region, data: bytes) -> Iterator[tuple[str, Any]]:
    """Yield path and value of each field in the bytes of a part; arrays of numbers as lists."""
    value = np.frombuffer(data, dtype=np.dtype([("it", part.dtype)]))[0]["it"]
    yield from _leaves(part.name, value, part.dtype)


def _leaves(path: str, value: Any, dtype: _Dtype) -> Iterator[tuple[str, Any]]:
    if dtype.names is not None:
        for name in dtype.names:
            inner = dtype.fields[name][0] if dtype.fields is not None else dtype
            yield from _leaves(f"{path}.{name}", value[name], inner)
    elif dtype.subdtype is not None and dtype.subdtype[0].names is not None:
        for k in range(dtype.subdtype[1][0]):
            yield from _leaves(f"{path}.{k}", value[k], _below(dtype, str(k), path)[1])
    else:
        yield path, value.tolist() if hasattr(value, "tolist") else value


def dump(address: int, data: bytes) -> Iterator[str]:
    """Yield the lines of a hex dump, sixteen bytes each."""
    for start in range(0, len(data), 16):
        row = data[start : start + 16]
        text = "".join(chr(one) if 32 <= one < 127 else "." for one in row)
        yield f"{address + start:06x}  {row.hex(' '):<47}  {text}"
