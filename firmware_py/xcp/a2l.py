"""The A2L file (ASAM MCD-2 MC 1.7): the RAM image for tools, from the records' own words.

Every field that is worth seeing is a MEASUREMENT, each parameter a CHARACTERISTIC. Groups are the
records of the RAM image. Addresses are those of this version: its text EPK, which a tool compares
with that of the computer, has a checksum of the layout.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator
from importlib import resources
from string import Template

import numpy as np

from rrins.dbc.codec import load
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.version import VERSION
from rrins.firmware_py.xcp.characteristics import CHARACTERISTICS, SEGMENTS, Characteristic
from rrins.firmware_py.xcp.layout import MemoryField, epk, fields, record_text
from rrins.firmware_py.xcp.measurement import cycle_of
from rrins.firmware_py.xcp.memory import EPK_ADDRESS
from rrins.firmware_py.xcp.protocol import (
    BLOCK_PACKETS,
    LISTS_CAPACITY,
    MAX_CTO,
    MAX_DTO,
    ODT_BYTES,
    TIMESTAMP_BYTES,
    Command,
)
from rrins.firmware_py.xcp.stimulation import targets

_ELEMENTS = 256  # of an array that is worth seeing
_RECORDS = 16  # of an array of records
_INDEX = re.compile(r"\.(\d+)(?=\.|$)")

_TYPES = {
    "?": "UBYTE", "B": "UBYTE", "H": "UWORD", "L": "A_UINT64", "I": "ULONG", "Q": "A_UINT64",
    "h": "SWORD", "l": "A_INT64", "q": "A_INT64", "d": "FLOAT64_IEEE",
}  # fmt: skip
_LETTERS = str.maketrans(
    {"²": "^2", "³": "^3", "°": "deg", "λ": "lambda", "μ": "mu", "π": "pi", "Σ": "sum"}
)
_MANDATORY = (Command.CONNECT, Command.DISCONNECT, Command.GET_STATUS, Command.SYNCH)
_UNLISTED = (*_MANDATORY, Command.SHORT_DOWNLOAD)  # which writes nothing in frames of 8 bytes


def name_of(field: MemoryField) -> str:
    """Return the name of a field in the A2L file: its path with indices in brackets."""
    return _INDEX.sub(r"[\1]", field.path)


@functools.cache
def measurements() -> tuple[MemoryField, ...]:
    """Return the fields that are worth seeing: without scratch, long arrays and parameters."""
    changeable = {one.path for one in CHARACTERISTICS}
    long = {
        field.path[: index.start()]
        for field in fields()
        for index in _INDEX.finditer(field.path)
        if int(index[1]) >= _RECORDS
    }
    return tuple(
        field
        for field in fields()
        if field.count <= _ELEMENTS
        and "scratch" not in field.text
        and field.path not in changeable
        and not any(field.path[: index.start()] in long for index in _INDEX.finditer(field.path))
    )


def a2l_text(period_ns: int) -> str:
    """Return the A2L file of a computer whose epochs have this length."""
    shown = (*measurements(), *(one.field for one in CHARACTERISTICS))
    template = resources.files(__package__).joinpath("module.a2l").read_text(encoding="utf-8")
    cycle, unit = cycle_of(period_ns)
    return Template(template).substitute(
        version=VERSION,
        epk=epk(),
        epk_address=f"0x{EPK_ADDRESS:X}",
        max_cto=f"0x{MAX_CTO:02X}",
        max_dto=MAX_DTO,
        commands="\n".join(f"      OPTIONAL_CMD {c.name}" for c in Command if c not in _UNLISTED),
        block_packets=BLOCK_PACKETS,
        lists=LISTS_CAPACITY,
        odt_bytes=f"0x{ODT_BYTES:02X}",
        timestamp_size={4: "SIZE_DWORD"}[TIMESTAMP_BYTES],
        cycle=cycle,
        unit=unit,
        segment_count=len(SEGMENTS),
        can_master=f"0x{load().frame_id('XCP_COMMAND'):X}",
        can_slave=f"0x{load().frame_id('XCP_RESPONSE'):X}",
        bitrate=load().bits_per_s,
        segments="\n".join(map(_segment, range(len(SEGMENTS)), SEGMENTS)),
        conversions="\n".join(_conversions(shown)),
        layouts="\n".join(map(_layout, sorted({_type(one.field) for one in CHARACTERISTICS}))),
        characteristics="\n".join(map(_characteristic, CHARACTERISTICS)),
        measurements="\n".join(map(_measurement, measurements())),
        groups="\n".join(_groups(shown)),
    )


def _type(field: MemoryField) -> str:
    return _TYPES[field.dtype.char]


def ascii_of(text: str) -> str:
    """Return a text in ASCII: what a reader takes other letters for depends on the reader."""
    return text.translate(_LETTERS)


def _quoted(text: str) -> str:
    text = ascii_of(text)
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _conversion(field: MemoryField) -> str:
    """Return the name of a field's conversion."""
    if field.names is not None:
        return field.names.__name__
    if field.dtype == bool:
        return "Bool"
    return f"in_{_plain(field.unit)}" if field.unit else "NO_COMPU_METHOD"


def _plain(unit: str) -> str:
    """Return a unit as part of a name."""
    for sign, word in (("/", "_per_"), ("²", "2"), ("³", "3"), (" ", "_"), ("%", "percent")):
        unit = unit.replace(sign, word)
    return unit


def _conversions(shown: Iterable[MemoryField]) -> Iterator[str]:
    for name, field in sorted({_conversion(field): field for field in shown}.items()):
        if field.names is not None or name == "Bool":
            rows = {m.value: m.name for m in field.names or ()} or {0: "no", 1: "yes"}
            pairs = " ".join(f"{value} {_quoted(text)}" for value, text in rows.items())
            yield (
                f'    /begin COMPU_METHOD {name} "" TAB_VERB "%.0" ""'
                f" COMPU_TAB_REF {name}_TABLE /end COMPU_METHOD\n"
                f'    /begin COMPU_VTAB {name}_TABLE "" TAB_VERB {len(rows)} {pairs}'
                " /end COMPU_VTAB"
            )
        elif field.unit:
            unit = _quoted(field.unit)
            yield f'    /begin COMPU_METHOD {name} {unit} IDENTICAL "%.9" {unit} /end COMPU_METHOD'


def _range(field: MemoryField) -> str:
    """Return the least and the largest value of a field."""
    if field.dtype == bool:
        return "0 1"
    if field.names is not None:
        return f"{min(field.names).value} {max(field.names).value}"
    if field.dtype.kind == "f":
        most = np.finfo(field.dtype).max
        return f"{-most!r} {most!r}".replace("np.float64(", "").replace(")", "")
    return f"{np.iinfo(field.dtype).min} {np.iinfo(field.dtype).max}"


def _array(field: MemoryField) -> str:
    sizes = [*reversed(field.shape), 1, 1][:3]  # older readers want three
    return f" MATRIX_DIM {' '.join(map(str, sizes))}" if field.shape else ""


def _measurement(field: MemoryField) -> str:
    stim = ""
    if field in targets():
        stim = (
            " READ_WRITE /begin IF_DATA XCP /begin DAQ_EVENT VARIABLE"
            " /begin AVAILABLE_EVENT_LIST EVENT 0x0000 EVENT 0x0001 /end AVAILABLE_EVENT_LIST"
            " /end DAQ_EVENT /end IF_DATA"
        )
    return (
        f"    /begin MEASUREMENT {name_of(field)} {_quoted(field.text)} {_type(field)}"
        f" {_conversion(field)} 0 0 {_range(field)} ECU_ADDRESS 0x{field.address:X}"
        f"{_array(field)}{stim} /end MEASUREMENT"
    )


def _characteristic(one: Characteristic) -> str:
    field = one.field
    kind = "VAL_BLK" if field.shape else "VALUE"
    return (
        f"    /begin CHARACTERISTIC {name_of(field)} {_quoted(field.text)} {kind}"
        f" 0x{field.address:X} L_{_type(field)} 0 {_conversion(field)}"
        f" {one.minimum!r} {one.maximum!r}{_array(field)} /end CHARACTERISTIC"
    )


def _layout(name: str) -> str:
    return (
        f"    /begin RECORD_LAYOUT L_{name} FNC_VALUES 1 {name} ROW_DIR DIRECT /end RECORD_LAYOUT"
    )


def _segment(number: int, name: str) -> str:
    assert Ram.dtype.fields is not None
    dtype, offset = Ram.dtype.fields[name][:2]
    pages = "".join(
        f" /begin PAGE 0x{page:02X} ECU_ACCESS_DONT_CARE XCP_READ_ACCESS_DONT_CARE"
        f" XCP_WRITE_ACCESS_{write} INIT_SEGMENT 0x{number:02X} /end PAGE"
        for page, write in enumerate(("DONT_CARE", "NOT_ALLOWED"))
    )
    return (
        f"      /begin MEMORY_SEGMENT {name} {_quoted(record_text(name))} DATA FLASH INTERN"
        f" 0x{offset:X} 0x{dtype.itemsize:X} -1 -1 -1 -1 -1"
        f" /begin IF_DATA XCP /begin SEGMENT 0x{number:02X} 0x02 0x00 0x00 0x00"
        f" /begin CHECKSUM XCP_CRC_32 MAX_BLOCK_SIZE 0x400000 /end CHECKSUM{pages}"
        " /end SEGMENT /end IF_DATA /end MEMORY_SEGMENT"
    )


def _groups(shown: Iterable[MemoryField]) -> Iterator[str]:
    members: dict[str, list[MemoryField]] = {}
    for field in sorted(shown, key=lambda field: field.address):
        members.setdefault(field.path.partition(".")[0] if "." in field.path else "ram", []).append(
            field
        )
    changeable = {one.path for one in CHARACTERISTICS}
    for group, found in members.items():
        lists = ""
        for keyword, is_ours in (("REF_CHARACTERISTIC", True), ("REF_MEASUREMENT", False)):
            names = [name_of(f) for f in found if (f.path in changeable) == is_ours]
            if names:
                lists += f" /begin {keyword} {' '.join(names)} /end {keyword}"
        yield f"    /begin GROUP _{group} {_quoted(record_text(group))} ROOT{lists} /end GROUP"
