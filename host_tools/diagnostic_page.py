"""The page `docs/diagnostic-table.md`, written from the table of the diagnostics.

``python -m host_tools.diagnostic_page``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from firmware_py.diagnostics import access, table
from firmware_py.diagnostics.codecs import Field
from firmware_py.diagnostics.data import DataIdentifier
from firmware_py.diagnostics.regions import BLOCK_LENGTH, CALIBRATION_ADDRESS
from firmware_py.diagnostics.responses import MEANINGS
from firmware_py.diagnostics.routines import Routine
from firmware_py.diagnostics.troubles import AGING_CYCLES, Trouble

_HEAD = """# The diagnostic table

`make docs` writes this page from `firmware_py/diagnostics/table.py`, which server, clients and
tests read. How it is meant to be used: [diagnostics](diagnostics.md).

All numbers are big-endian. `u8` … `u64`, `i8` … `i64` are integers without and with sign, `f32` and
`f64` IEEE 754; `[n]` stands for n in a row.
"""


def _range(field: Field) -> str:
    if field.choices is not None:
        return ", ".join(f"{choice.value} {choice.name}" for choice in field.choices)
    if field.minimum is None or field.maximum is None:
        return ""
    return f"{field.minimum:.10g} … {field.maximum:.10g}"


def _fields(fields: Iterable[Field]) -> Iterator[str]:
    yield "\n| value | type | unit | range | |\n|---|---|---|---|---|"
    for field in fields:
        count = f"[{field.count}]" if field.count > 1 else ""
        yield (
            f"| `{field.name}` | {field.format}{count} | {field.unit} | {_range(field)} "
            f"| {field.text} |"
        )


def _identification() -> Iterator[str]:
    yield "## On the bus\n"
    yield "| | identifier |\n|---|---|"
    yield f"| requests to the navigation computer | 0x{table.request_id():03X} |"
    yield f"| requests to everybody (functional) | 0x{table.functional_id():03X} |"
    yield f"| responses | 0x{table.response_id():03X} |"
    yield "\n| timing | ms |\n|---|---|"
    for name, value in (
        ("P2server_max", access.P2_MS),
        ("P2*server_max", access.P2_STAR_MS),
        ("S3server", access.S3_MS),
        ("N_Bs", access.N_BS_MS),
        ("N_Cr", access.N_CR_MS),
        ("STmin, asked for", access.ST_MIN_MS),
    ):
        yield f"| {name} | {value} |"
    yield (
        f"\nBlock size asked for: {access.BLOCK_SIZE} (all). Longest message: "
        f"{access.MESSAGE_CAPACITY} bytes. At most {access.FRAMES_PER_SECOND} frames a second are "
        f"sent. Padding: 0x{access.PADDING:02X}."
    )


def _services() -> Iterator[str]:
    yield "\n## Services\n"
    yield "| | service | sub-functions | in | |\n|---|---|---|---|---|"
    for service in table.SERVICES:
        parts = ", ".join(f"0x{n:02X} {name}" for n, name in service.subfunctions.items())
        yield (
            f"| 0x{service.number:02X} | {service.name} | {parts} | {service.access} "
            f"| {service.text} |"
        )
    yield "\n## Negative responses\n"
    yield "| | name | here it means |\n|---|---|---|"
    for code, meaning in MEANINGS.items():
        yield f"| 0x{code:02X} | {code.name} | {meaning} |"


def _identifier(did: DataIdentifier) -> Iterator[str]:
    yield f"\n### 0x{did.number:04X} `{did.name}`\n"
    rights = [f"read: {did.read}"]
    if did.write is not None:
        rights.append(f"write: {did.write}")
    if did.control is not None:
        rights.append(f"control: {did.control}")
    yield f"{did.text} ({'; '.join(rights)})"
    yield from _fields(did.fields)


def _is_like_the_one_before(did: DataIdentifier) -> bool:
    return did.name.endswith("_calibration") and "_1_" not in did.name


def _identifiers() -> Iterator[str]:
    yield "\n## Data identifiers\n"
    yield "| | name | |\n|---|---|---|"
    for did in table.IDENTIFIERS:
        yield f"| 0x{did.number:04X} | `{did.name}` | {did.text} |"
    for did in table.IDENTIFIERS:
        if not _is_like_the_one_before(did):
            yield from _identifier(did)
        if "_1_calibration" in did.name:
            yield "\nThose of the other sensors are alike; the number is that of the sensor."


def _routine(routine: Routine) -> Iterator[str]:
    yield f"\n### 0x{routine.number:04X} `{routine.name}`\n"
    stop = "can be stopped" if routine.can_stop else "cannot be stopped"
    yield f"{routine.text} ({routine.access}; {stop})"
    if routine.arguments:
        yield "\nArguments:"
        yield from _fields(routine.arguments)
    yield "\nResults:"
    yield from _fields(routine.results)


def _troubles() -> Iterator[str]:
    yield "\n## Trouble codes\n"
    yield (
        "`n` is the number of a sensor group, 1 to 16 (0x01 to 0x10 in the code). The first figure "
        "of the debounce is how long, or in how many epochs, the fault has to be until the test "
        "has failed; the second how long there must be none, both from failed to undecided and "
        "from there to passed. A confirmed trouble code is forgotten after "
        f"{AGING_CYCLES} operation cycles without it.\n"
    )
    yield "| number | code | name | debounce | |\n|---|---|---|---|---|"
    for trouble in table.TROUBLES:
        if trouble.group <= 0:  # those of the other groups are alike
            yield _trouble(trouble)
    names = ", ".join(f"`{did.name}`" for did in table.SNAPSHOT)
    yield f"\nA freeze frame has the data identifiers {names}."
    yield "Record 0x01 is that of the first occurrence, 0x02 that of the latest."
    yield "\nExtended data:\n\n| record | value | type | |\n|---|---|---|---|"
    for number, layout in table.EXTENDED_DATA.items():
        for field in layout.fields:
            yield f"| 0x{number:02X} | `{field.name}` | {field.format} | {field.text} |"


def _trouble(trouble: Trouble) -> str:
    number, code, name, text = (
        f"0x{trouble.number:06X}",
        trouble.code,
        trouble.name,
        trouble.text,
    )
    if trouble.group == 0 and trouble.needs != "altimeter":
        number = f"{number[:4]}nn{number[6:]}"
        code = f"{code[:3]}nn{code[5:]}"
        name = name.replace("_1_", "_n_")
        text = text.replace("SENSOR_1", "SENSOR_n").replace(" 1 ", " n ")
    return f"| {number} | {code} | `{name}` | {trouble.debounce} | {text} |"


def _memory() -> Iterator[str]:
    yield "\n## Memory\n"
    names = ", ".join(f"`{region.name}`" for region in table.regions()[1:])
    yield (
        "ReadMemoryByAddress reads the RAM image, a record without gaps, little-endian "
        "(`firmware_py.memory.RAM`); an address is an offset in it. Its parts, in this order, are "
        f"{names}; their offsets are those of the firmware's version (`table.regions()`)."
    )
    yield (
        f"\nThe calibration file, for RequestDownload and RequestUpload only, is at "
        f"0x{CALIBRATION_ADDRESS:08X}; a block has {BLOCK_LENGTH - 2} bytes of it at most."
    )


def page() -> str:
    """Return the page as Markdown."""
    return "\n".join(_sections()) + "\n"


def _sections() -> Iterator[str]:
    yield _HEAD
    yield from _identification()
    yield from _services()
    yield from _identifiers()
    yield "\n## Routines"
    for routine in table.ROUTINES:
        yield from _routine(routine)
    yield from _troubles()
    yield from _memory()


if __name__ == "__main__":
    print(page(), end="")
