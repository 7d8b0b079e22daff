"""The page `docs/diagnostic-table.md`, written from the table of the diagnostics.

``python -m generate.diagnostic_page``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rrins.firmware_py.core.records.troubles import AGING_CYCLES, Trouble
from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.redundancy_identifiers import PARITY_BEFORE
from rrins.firmware_py.diagnostics.regions import BLOCK_LENGTH, CALIBRATION_ADDRESS
from rrins.firmware_py.diagnostics.responses import MEANINGS
from rrins.firmware_py.diagnostics.routines import Routine

_HEAD = """# The diagnostic table

`make docs` writes this page from `firmware_py/diagnostics/table.py`, which the server, clients and
tests use. [Diagnostics](diagnostics.md) describes how the server behaves.

All numbers are big-endian. `u8` … `u64` are unsigned and `i8` … `i64` signed integers; `f32` and
`f64` are IEEE 754 floating-point numbers; `[n]` means n consecutive values.
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
    yield f"| functional requests (to all nodes) | 0x{table.functional_id():03X} |"
    yield f"| responses | 0x{table.response_id():03X} |"
    yield "\n| timing | ms |\n|---|---|"
    for name, value in (
        ("P2server_max", access.P2_MS),
        ("P2*server_max", access.P2_STAR_MS),
        ("S3server", access.S3_MS),
        ("N_Bs", access.N_BS_MS),
        ("N_Cr", access.N_CR_MS),
        ("STmin, requested", access.ST_MIN_MS),
    ):
        yield f"| {name} | {value} |"
    yield (
        f"\nRequested block size: {access.BLOCK_SIZE} frames. Longest message: "
        f"{access.MESSAGE_CAPACITY} bytes. Transmit limit: {access.FRAMES_PER_SECOND} frames a "
        f"second. Padding: 0x{access.PADDING:02X}."
    )


def _services() -> Iterator[str]:
    yield "\n## Services\n"
    yield "| | service | sub-functions | session | |\n|---|---|---|---|---|"
    for service in table.SERVICES:
        parts = ", ".join(f"0x{n:02X} {name}" for n, name in service.subfunctions.items())
        yield (
            f"| 0x{service.number:02X} | {service.name} | {parts} | {service.access} "
            f"| {service.text} |"
        )
    yield "\n## Negative responses\n"
    yield "| | name | meaning |\n|---|---|---|"
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
    is_of_sensor = did.name.endswith(("_calibration", "_calibration_sigma"))
    return is_of_sensor and "_1_" not in did.name


def _identifiers() -> Iterator[str]:
    yield "\n## Data identifiers\n"
    yield "| | name | |\n|---|---|---|"
    for did in table.IDENTIFIERS:
        yield f"| 0x{did.number:04X} | `{did.name}` | {did.text} |"
    for did in table.IDENTIFIERS:
        if not _is_like_the_one_before(did):
            yield from _identifier(did)
        if "_1_calibration" in did.name:
            yield "\nThe identifiers of the other sensors have the same fields."


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
        "of the debounce is the time, or the number of epochs, for which the fault must be present "
        "before the test fails. The second is the time without the fault that takes the test from "
        "failed to undecided, and the same again from undecided to passed. A confirmed trouble "
        f"code is deleted after {AGING_CYCLES} operation cycles without the fault.\n"
    )
    yield "| number | code | name | debounce | |\n|---|---|---|---|---|"
    for trouble in table.TROUBLES:
        if trouble.group <= 0:  # those of the other groups are alike
            yield _trouble(trouble)
    names = ", ".join(f"`{did.name}`" for did in table.SNAPSHOT)
    yield f"\nA freeze frame contains the data identifiers {names}."
    of_parity = ", ".join(f"`{did.name}`" for did in PARITY_BEFORE.values())
    yield f"Those of redundant sensors, of the code's kind, also {of_parity}."
    yield "Record 0x01 is the first occurrence, record 0x02 the latest."
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
    if trouble.group == 0 and trouble.needs not in ("altimeter", "gnss", "odometer"):
        number = f"{number[:4]}nn{number[6:]}"
        code = f"{code[:3]}nn{code[5:]}"
        name = name.replace("_1_", "_n_")
        text = text.replace("SENSOR_1", "SENSOR_n").replace(" 1 ", " n ")
    return f"| {number} | {code} | `{name}` | {trouble.debounce} | {text} |"


def _memory() -> Iterator[str]:
    yield "\n## Memory\n"
    names = ", ".join(f"`{region.name}`" for region in table.regions()[1:])
    yield (
        "ReadMemoryByAddress reads the RAM image, a packed little-endian record "
        "(`firmware_py/core/records/memory.py`); an address is an offset into it. "
        "Its parts, in order, are "
        f"{names}; their offsets depend on the firmware version (`table.regions()`)."
    )
    yield (
        "\nThe calibration file, accessible only to RequestDownload and RequestUpload, is at "
        f"0x{CALIBRATION_ADDRESS:08X}; a block holds at most {BLOCK_LENGTH - 2} bytes of it."
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
