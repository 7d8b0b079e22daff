"""The single table of the diagnostics: identifiers, outputs, routines, trouble codes, regions.

Server, clients, docs and tests read it. Entries can be looked up by number or name::

    identifier("position").decode(data)       # {"latitude_deg": …, …}
    routine("go_to_axis_angle").argument_layout.encode({"axis": 0, "angle_deg": 90.0})
    trouble(0xD10387).name                    # "sensor_3_silent"
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Iterable, Mapping
from typing import Any, Protocol, TypeVar

from rrins.dbc.codec import load
from rrins.firmware_py.core.records.trouble_table import TROUBLES
from rrins.firmware_py.core.records.troubles import SNAPSHOT_IDENTIFIERS, Trouble
from rrins.firmware_py.diagnostics.codecs import Field, Layout
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.identifiers import READINGS
from rrins.firmware_py.diagnostics.parameters import PARAMETERS
from rrins.firmware_py.diagnostics.regions import Region, regions_of
from rrins.firmware_py.diagnostics.responses import SERVICES, Service
from rrins.firmware_py.diagnostics.routines import ROUTINES, Routine

__all__ = [
    "EXTENDED_DATA",
    "IDENTIFIERS",
    "ROUTINES",
    "SERVICES",
    "SNAPSHOT",
    "TROUBLES",
    "UnknownError",
    "crc32",
    "functional_id",
    "identifier",
    "regions",
    "request_id",
    "response_id",
    "routine",
    "service",
    "trouble",
]

IDENTIFIERS = (*READINGS, *PARAMETERS)
"""All data identifiers."""

EXTENDED_DATA: Mapping[int, Layout] = {
    0x01: Layout(
        (
            Field("occurrences", "u16", text="number of times the test has failed"),
            Field("aging", "u8", text="operation cycles without the fault"),
            Field("fault_detection_counter", "i8", text="-128 passed, 127 failed"),
        )
    )
}
"""Extended data records of a trouble code, by record number."""


class UnknownError(KeyError):
    """The table has no such entry."""

    def __str__(self) -> str:
        return str(self.args[0])


class _Numbered(Protocol):
    @property
    def number(self) -> int: ...
    @property
    def name(self) -> str: ...


_T = TypeVar("_T", bound=_Numbered)


def _by(key: str, things: Iterable[_T]) -> dict[Any, _T]:
    found: dict[Any, _T] = {}
    for thing in things:
        value = getattr(thing, key)
        assert value not in found, f"{thing.name}: its {key} is taken"
        found[value] = thing
    return found


IDENTIFIER_BY_NUMBER: dict[int, DataIdentifier] = _by("number", IDENTIFIERS)
IDENTIFIER_BY_NAME: dict[str, DataIdentifier] = _by("name", IDENTIFIERS)
ROUTINE_BY_NUMBER: dict[int, Routine] = _by("number", ROUTINES)
ROUTINE_BY_NAME: dict[str, Routine] = _by("name", ROUTINES)
TROUBLE_BY_NUMBER: dict[int, Trouble] = _by("number", TROUBLES)
TROUBLE_BY_NAME: dict[str, Trouble] = _by("name", TROUBLES)
SERVICE_BY_NUMBER: dict[int, Service] = _by("number", SERVICES)


def _find(kind: str, which: int | str, numbers: Mapping[int, _T], names: Mapping[str, _T]) -> _T:
    found = numbers.get(which) if isinstance(which, int) else names.get(which)
    if found is None:
        shown = f"0x{which:04X}" if isinstance(which, int) else which
        raise UnknownError(f"no {kind} {shown}")
    return found


def identifier(which: int | str) -> DataIdentifier:
    """Return a data identifier by number or name; `UnknownError` is raised without one."""
    return _find("data identifier", which, IDENTIFIER_BY_NUMBER, IDENTIFIER_BY_NAME)


def routine(which: int | str) -> Routine:
    """Return a routine by number or name; `UnknownError` is raised without one."""
    return _find("routine", which, ROUTINE_BY_NUMBER, ROUTINE_BY_NAME)


def trouble(which: int | str) -> Trouble:
    """Return a trouble code by number or name; `UnknownError` is raised without one."""
    return _find("trouble code", which, TROUBLE_BY_NUMBER, TROUBLE_BY_NAME)


def service(number: int) -> Service:
    """Return a service by its identifier; `UnknownError` is raised without one."""
    return _find("service", number, SERVICE_BY_NUMBER, {})


SNAPSHOT = tuple(IDENTIFIER_BY_NAME[name] for name in SNAPSHOT_IDENTIFIERS)
"""Data identifiers in a freeze frame, in order."""


@functools.cache
def regions() -> tuple[Region, ...]:
    """Return the memory regions that can be read: the RAM image and its parts."""
    from rrins.firmware_py.core.records.memory import Ram

    return regions_of(Ram.dtype)


@functools.cache
def request_id() -> int:
    """CAN identifier of physical requests."""
    return load().frame_id("DIAG_REQUEST")


@functools.cache
def functional_id() -> int:
    """CAN identifier of functional requests."""
    return load().frame_id("DIAG_FUNCTIONAL")


@functools.cache
def response_id() -> int:
    """CAN identifier of responses."""
    return load().frame_id("DIAG_RESPONSE")


@functools.cache
def crc32() -> int:
    """Return the CRC-32 of the table, which tells a tool whether its table is the firmware's."""
    text = repr((IDENTIFIERS, ROUTINES, TROUBLES, SERVICES, sorted(EXTENDED_DATA.items())))
    return zlib.crc32(text.encode())
