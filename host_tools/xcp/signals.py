"""Signals of the RAM image by name: a number, or an element of an array."""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrins.firmware_py.xcp.a2l import measurements, name_of
from rrins.firmware_py.xcp.characteristics import CHARACTERISTICS, Characteristic
from rrins.firmware_py.xcp.layout import MemoryField
from rrins.host_tools.errors import XcpError

_ELEMENT = re.compile(r"(?P<field>.*?)(?P<indices>(\[\d+\])*)")


@dataclass(frozen=True)
class Signal:
    """A number of the RAM image."""

    name: str  #: as in the A2L file, with an index if it is an element of an array
    address: int
    field: MemoryField
    limits: Characteristic | None = None  #: of a parameter that can be changed

    @property
    def size(self) -> int:
        """Bytes."""
        return self.field.dtype.itemsize

    def values(self, data: NDArray[np.uint8]) -> NDArray[np.generic]:
        """Return numbers from their bytes, shape (n, size)."""
        whole = np.ascontiguousarray(data)
        return whole.view(self.field.dtype)[:, 0]

    def words(self, value: float) -> str:
        """Return a value for people."""
        names = self.field.names
        if names is not None and value in list(names):
            return names(int(value)).name
        if self.field.dtype == bool:
            return "yes" if value else "no"
        return f"{value:.9g}" if self.field.dtype.kind == "f" else str(int(value))


def _all() -> dict[str, tuple[MemoryField, Characteristic | None]]:
    found: dict[str, tuple[MemoryField, Characteristic | None]] = {
        name_of(one.field): (one.field, one) for one in CHARACTERISTICS
    }
    return found | {name_of(field): (field, None) for field in measurements()}


def fields_like(pattern: str) -> list[tuple[str, MemoryField, Characteristic | None]]:
    """Return the fields whose name has a part like this, or matches a pattern with ``*``."""
    wanted = pattern if any(sign in pattern for sign in "*?") else f"*{pattern}*"
    return [
        (name, *found)
        for name, found in sorted(_all().items(), key=lambda item: item[1][0].address)
        if fnmatch.fnmatchcase(name, wanted)
    ]


def elements() -> Iterator[Signal]:
    """Yield all signals there are."""
    for name, found in _all().items():
        yield from _elements(name, *found)


def signals_of(names: Sequence[str]) -> list[Signal]:
    """Return the signals with these names; the name of an array stands for all its elements.

    Raises
    ------
    XcpError
        If there is no such signal.
    """
    return [signal for name in names for signal in _signals(name)]


def _signals(name: str) -> Iterator[Signal]:
    found = _all()
    if name in found:
        yield from _elements(name, *found[name])
        return
    match = _ELEMENT.fullmatch(name)
    assert match is not None
    if match["field"] in found and match["indices"]:
        field, limits = found[match["field"]]
        wanted = [one for one in _elements(match["field"], field, limits) if one.name == name]
        if wanted:
            yield wanted[0]
            return
        raise XcpError(f"signal {name}: {match['field']} has the shape {list(field.shape)}")
    near = difflib.get_close_matches(name, found, 1)
    hint = f"did you mean {near[0]}?" if near else "`rrins xcp list` shows all"
    raise XcpError(f"signal {name}: there is none; {hint}")


def _elements(name: str, field: MemoryField, limits: Characteristic | None) -> Iterator[Signal]:
    for k, index in enumerate(np.ndindex(field.shape)):
        indices = "".join(f"[{i}]" for i in index)
        address = field.address + k * field.dtype.itemsize
        yield Signal(name + indices, address, field, limits)
