"""Fields of the RAM image: path, address, type, unit and description, from the records."""

from __future__ import annotations

import functools
import inspect
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, cast, get_args, get_origin, get_type_hints

import numpy as np

from rrins.compiled.record import Record, Records
from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest
from rrins.firmware_py.core.records.diagnostic_records import RoutineRequest
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.version import VERSION

_ENUMERATIONS: dict[str, type[IntEnum]] = {
    kind.__name__: kind
    for kind in (
        Mode, FirmwareFault, ModeRequest, AxisState, AxisCommand, InitialAttitude, RoutineRequest,
    )
}  # fmt: skip

_NAMED_UNITS = {
    "deg": "deg", "dps": "deg/s", "dps2": "deg/s²", "ns": "ns", "s": "s", "percent": "%",
    "ppm": "ppm", "epochs": "epochs",
}  # fmt: skip
"""Unit by the last part of a field's name."""

_UNIT = re.compile(r"(rad|m|s|ns|deg|°)([²³]|/s[²³]?|²/s²| s|/h)?(?=[,;.]|$)")
_FIELD = re.compile(r" {4}(\w+): [^#]*(?:#: (.*))?")


@dataclass(frozen=True)
class MemoryField:
    """A number of the RAM image, or an array of numbers."""

    path: str  #: such as ``redundancy.gyros.alarm``; records of an array by number from 0
    address: int  #: offset in the RAM image
    dtype: np.dtype[Any]  #: of one number
    shape: tuple[int, ...]  #: of the array; empty for a number
    unit: str  #: empty if it has none
    text: str  #: description
    names: type[IntEnum] | None = None  #: meaning of its values

    @property
    def count(self) -> int:
        """Numbers."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def size(self) -> int:
        """Bytes."""
        return self.count * self.dtype.itemsize


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    """Return the types of the fields of a record's class, each of which has many records."""
    return get_type_hints(kind, include_extras=True)


@functools.cache
def _texts(kind: Any) -> dict[str, str]:
    """Return the comments of the fields of a record's class."""
    texts: dict[str, str] = {}
    above = ""
    for line in inspect.getsource(kind).splitlines():
        if line.startswith("    #: "):
            above = f"{above} {line[7:]}".strip()
            continue
        found = _FIELD.match(line)
        if found is not None:
            texts[found[1]] = found[2] or above
        above = ""
    return texts


def _unit_of(name: str, text: str) -> str:
    stated = _UNIT.match(text)
    if stated is not None:
        return stated[0]
    return _NAMED_UNITS.get(name.rpartition("_")[2], "")


def _fields(kind: type[Record], path: str, address: int) -> Iterator[MemoryField]:
    assert kind.dtype.fields is not None
    hints, texts = _hints(cast(Any, kind)), _texts(cast(Any, kind))
    for name, (dtype, offset, *_) in kind.dtype.fields.items():
        at, inner = address + int(offset), _record_of(hints[name])
        if inner is None:
            text = texts.get(name, "")
            named = re.search(r"an? `(\w+)`", text)
            yield MemoryField(
                path + name, at, dtype.base, dtype.shape, _unit_of(name, text), text,
                _ENUMERATIONS.get(named[1]) if named else None,
            )  # fmt: skip
        elif dtype.shape:
            for k, index in enumerate(np.ndindex(dtype.shape)):
                place = ".".join(map(str, (name, *index)))
                yield from _fields(inner, f"{path}{place}.", at + k * inner.dtype.itemsize)
        else:
            yield from _fields(inner, f"{path}{name}.", at)


def _record_of(hint: object) -> type[Record] | None:
    """Return the record that a field, or each element of it, is; None for numbers."""
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    if get_origin(hint) is Records:
        (hint,) = get_args(hint)
    return hint if isinstance(hint, type) and issubclass(hint, Record) else None


@functools.cache
def fields() -> tuple[MemoryField, ...]:
    """Return all fields of the RAM image, by address."""
    return tuple(_fields(Ram, "", 0))


@functools.cache
def by_path() -> dict[str, MemoryField]:
    """Return all fields of the RAM image by path."""
    return {field.path: field for field in fields()}


def record_text(name: str) -> str:
    """Return what a record of the RAM image is; of its plain fields for another name."""
    kind = _record_of(_hints(Ram).get(name))
    first = inspect.getdoc(kind or Ram) or ""
    return first.partition("\n\n")[0].replace("\n", " ")


@functools.cache
def epk() -> str:
    """Return the identification of this layout: version, and CRC-32 of paths, addresses, types."""
    layout = repr([(f.path, f.address, f.dtype.str, f.shape) for f in fields()])
    return f"RRINS {VERSION} {zlib.crc32(layout.encode()):08X}"
