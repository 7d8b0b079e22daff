"""C headers of the records: structs with the offset, the unit and the meaning of each field."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from rrins.compiled.object_code import Entry
from rrins.compiled.record import Record

_NUMBERS = {
    "?": "uint8_t",
    "u1": "uint8_t",
    "<u2": "uint16_t",
    "<u4": "uint32_t",
    "<u8": "uint64_t",
    "<i2": "int16_t",
    "<i8": "int64_t",
    "<f8": "double",
}
_WORD = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_HEAD = """\
/* {title}; written by `rrins build`, little-endian. Records are packed: copy a field, or let the
 * compiler read it through its struct, but take no pointer to one where the processor minds. */
#ifndef {guard}
#define {guard}

#include <stdint.h>
"""
_FRAME = """
#ifndef RRINS_FRAME
#define RRINS_FRAME
/* A classic frame, laid out like struct can_frame of Linux. */
struct rrins_frame {
    uint32_t can_id; /* with the flags EFF, RTR and ERR of SocketCAN on top */
    uint8_t length;
    uint8_t reserved[3];
    uint8_t data[8];
};
#endif
"""


def header(
    side: str,
    memory: type[Record],
    dtype: np.dtype[np.void],
    constants: dict[str, int],
    entries: Sequence[Entry],
    more: Sequence[type[Record]] = (),
) -> str:
    """Return the header of a side.

    Parameters
    ----------
    side : str
        Such as ``firmware``: part of every name.
    memory : class of records
        Its memory.
    dtype : dtype
        That of the memory as it was built, which may be a shorter variant.
    constants : dict
        To be defined, by name.
    entries : sequence of Entry
    more : sequence of classes of records
        That the entries take beside the memory.
    """
    structs: dict[str, str] = {}
    _write_struct(side, memory, dtype, structs)
    for kind in more:
        _write_struct(side, kind, kind.dtype, structs)
    guard = f"RRINS_{side.upper()}_H"
    lines = [
        _HEAD.format(title=f"The {side} of the rehearsal", guard=guard),
        *(f"#define {name} {value}" for name, value in constants.items()),
        _FRAME,
        "#pragma pack(push, 1)",
        *structs.values(),
        "#pragma pack(pop)",
        "",
        *(_prototype(struct_name(side, memory), entry) for entry in entries),
        f"void rrins_{side}_power_on(struct {struct_name(side, memory)} *memory);",
        "extern const uint8_t rrins_contract[];",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def struct_name(side: str, kind: type[Record]) -> str:
    """Return a record's name in C."""
    return f"rrins_{side}_{_WORD.sub('_', kind.__name__).lower()}"


def _write_struct(
    side: str, kind: type[Record], dtype: np.dtype[np.void], structs: dict[str, str]
) -> None:
    """Add a record's struct, after those that it contains."""
    name = struct_name(side, kind)
    if name in structs:
        return
    lines = list(_fields(side, kind, dtype, structs))
    text = " ".join((kind.__doc__ or "").split()).replace("*/", "* /")
    structs[name] = "\n".join(
        (f"/* {text} */", f"struct {name} {{ /* {dtype.itemsize} bytes */", *lines, "};", "")
    )


def _fields(
    side: str, kind: type[Record], dtype: np.dtype[np.void], structs: dict[str, str]
) -> Iterator[str]:
    assert dtype.fields is not None
    texts = kind.texts()
    for member in kind.members():
        field, offset = dtype.fields[member.name][:2]
        if isinstance(member.kind, str):
            number = _NUMBERS[member.kind]
        else:
            _write_struct(side, member.kind, field.base, structs)
            number = f"struct {struct_name(side, member.kind)}"
        shape = "".join(f"[{length}]" for length in field.shape)
        text = texts.get(member.name, "").replace("*/", "* /")
        yield f"    {number} {member.name}{shape}; /* {f'{offset}: {text}'.rstrip(': ')} */"


def _prototype(memory: str, entry: Entry) -> str:
    """Return an entry's prototype: pointers to arrays, and their lengths."""
    pointers = {
        "contract": "const void *",
        "motion": "const double *",
        "inbox": "const struct rrins_frame *",
        "outbox": "struct rrins_frame *",
        "angles": "const double *",
        "found": "double *",
        "sums": "struct rrins_firmware_table_sums *",
    }
    parameters = []
    for name, argument in entry.parameters:
        is_number = argument is None or not argument.shape
        kind = "int32_t " if is_number else pointers.get(name, f"struct {memory} *")
        parameters.append(kind + name)
    return f"int32_t {entry.name}({', '.join(parameters)});"
