"""The diagnostic table as C: what the server of `c/diagnostics` answers, for one scenario.

Offsets are those of the memory that the scenario's step has; what parameters change at power-on is
found by Python's own power-on.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.records.diagnostic_records import Snapshot
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import ParityBefore, SensorKind
from rrins.firmware_py.core.records.trouble_table import PARITY_KIND, TROUBLES
from rrins.firmware_py.core.sensors.calibration import input_axes, transverse
from rrins.firmware_py.diagnostics import parameter_settings, table
from rrins.firmware_py.diagnostics.access import Access
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.firmware_py.diagnostics.computer import IDENTITY
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.fault_memory import PARITY_ROW, FaultMemory
from rrins.firmware_py.diagnostics.last_second import LAST_SECOND
from rrins.firmware_py.diagnostics.node import silenced_types
from rrins.firmware_py.diagnostics.parameters import HeightChannel
from rrins.firmware_py.diagnostics.reader import view_of
from rrins.firmware_py.diagnostics.redundancy_identifiers import PARITY_BEFORE
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.builds.diagnostic_constants import BY_NUMBER, special_names
from rrins.host_tools.builds.images import Images
from rrins.host_tools.builds.variants import Variant, shortened

_KINDS = {"|b1": "U1", "|u1": "U1", "<u2": "U2", "<u4": "U4", "<i8": "I8", "<f8": "F8"}
_WRITTEN = ("u8", "u16", "u24", "u32", "f64")
_GAP = 16
"""Equal bytes in a row that are worth the end of one patch and the start of another."""


@dataclass(frozen=True)
class _Place:
    """Where a field's values stand in a memory."""

    offset: int
    kind: str
    available: int
    stride: int


def _place(array: NDArray[np.void], view: NDArray[np.generic], offset: int = 0) -> _Place:
    """Return the place of a view of an array of one record."""
    begin = view.__array_interface__["data"][0] - array.__array_interface__["data"][0]
    available = view.shape[1] if view.ndim > 1 else 1
    stride = view.strides[1] if view.ndim > 1 else view.dtype.itemsize
    return _Place(begin + offset, _KINDS[view.dtype.str], available, stride)


def _blank(dtype: np.dtype[np.void]) -> NDArray[np.void]:
    return np.zeros(1, dtype)


def _number(value: float | None, otherwise: str) -> str:
    return otherwise if value is None else float(value).hex()


def _field(field: Field, memory: NDArray[np.void] | None, is_written: bool = False) -> str:
    """Return a field as an initialiser; `memory` is where its source is found."""
    parts = [
        f".format = FORMAT_{field.format.upper()}",
        f".count = {field.count}",
        f".minimum = {_number(field.minimum, '-HUGE_VAL')}",
        f".maximum = {_number(field.maximum, 'HUGE_VAL')}",
    ]
    if is_written:
        assert field.format in _WRITTEN, f"{field.name}: {field.format} cannot be written in C"
        if field.choices is not None:
            mask = sum(1 << int(choice) for choice in field.choices)
            parts.append(f".choices = UINT64_C({mask})")
    if memory is not None and field.source:
        place = _place(memory, view_of(memory, field.source))
        parts += [
            ".origin = FROM_MEMORY",
            f".factor = {float(field.factor).hex()}",
            f".add = {field.offset}",
            *_place_parts(place),
        ]
    elif memory is not None and field.name in LAST_SECOND:
        last = LAST_SECOND[field.name]
        seconds = last.seconds(memory)
        row = seconds[:, 0]
        count = view_of(memory, f"{last.record}.history_count")
        parts += [
            ".origin = FROM_LAST_SECOND",
            f".factor = {float(last.unit).hex()}",
            f".history_count = {_place(memory, count).offset}",
            f".second_bytes = {seconds.strides[1]}",
            f".seconds = {seconds.shape[1]}",
            *_place_parts(_place(memory, row)),
        ]
    elif memory is not None and field.name in special_names():
        parts += [".origin = FROM_SPECIAL", f".special = SPECIAL_{field.name.upper()}"]
    return "{" + ", ".join(parts) + "}"


def _place_parts(place: _Place) -> list[str]:
    return [
        f".kind = KIND_{place.kind}",
        f".offset = {place.offset}",
        f".available = {place.available}",
        f".stride = {place.stride}",
    ]


class _Writer:
    """Collects definitions; each list of fields is an array of its own."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._lists = 0

    def layout(
        self, fields: Sequence[Field], memory: NDArray[np.void] | None, is_written: bool = False
    ) -> str:
        """Define the fields, and return the layout's initialiser."""
        size = sum(field.size for field in fields)
        if not fields:
            return "{0}"
        name = f"fields_{self._lists}"
        self._lists += 1
        self.lines.append(f"static const struct field {name}[] = {{")
        self.lines += [f"    {_field(field, memory, is_written)}," for field in fields]
        self.lines.append("};")
        return f"{{{name}, {len(fields)}, {size}}}"

    def array(self, kind: str, name: str, length: str, rows: Iterable[str]) -> None:
        """Define an array."""
        self.lines.append(f"const {kind} {name}[{length}] = {{")
        self.lines += [f"    {row}," for row in rows]
        self.lines.append("};")

    def bytes(self, name: str, value: bytes) -> None:
        """Define bytes of this file."""
        numbers = ", ".join(map(str, value))
        self.lines.append(f"static const uint8_t {name}[] = {{{numbers}}};")


def _access(access: Access | None) -> int:
    if access is None:
        return 0
    return sum(1 << int(session) for session in access.sessions) | access.secured << 7


def source(images: Images, choices: Mapping[tuple[int, int], bytes]) -> str:
    """Return `rrins_diagnostics.c`; `choices` are those of `choices_of`."""
    writer = _Writer()
    memory = _blank(images.ram.dtype)
    identifiers = sorted(table.IDENTIFIERS, key=lambda did: did.number)
    _write_identifiers(writer, identifiers, memory)
    _write_parameters(writer, images, identifiers)
    _write_services(writer)
    _write_routines(writer, memory)
    _write_troubles(writer, images, identifiers)
    writer.array(
        "struct segment",
        "memory_segments",
        "MEMORY_SEGMENTS",
        (f"{{{whole}, {own}, {size}}}" for whole, own, size in segments(images.ram.dtype)),
    )
    _write_choices(writer, images, choices)
    _write_rest(writer, images)
    head = "/* The diagnostic table; written by `rrins build`. */\n#include <math.h>\n\n"
    return head + '#include "tables.h"\n\n' + "\n".join((*writer.lines, ""))


def _write_identifiers(
    writer: _Writer, identifiers: Sequence[DataIdentifier], memory: NDArray[np.void]
) -> None:
    numbers = {parameter.number: index for index, parameter in enumerate(BY_NUMBER)}
    rows = []
    for did in identifiers:
        layout = writer.layout(did.fields, memory, bool(did.write or did.control))
        access = ", ".join(str(_access(one)) for one in (did.read, did.write, did.control))
        parameter = numbers.get(did.number, -1)
        rows.append(f"{{{did.number}, {access}, {parameter}, {layout}}}")
    writer.array("struct identifier", "identifiers", "IDENTIFIERS", rows)


def _write_parameters(
    writer: _Writer, images: Images, identifiers: Sequence[DataIdentifier]
) -> None:
    values = parameter_settings.parameters_of(images.settings)
    rows = []
    for index, parameter in enumerate(BY_NUMBER):
        known = values.get(parameter.number)
        if known is not None:
            writer.bytes(f"set_up_{index}", parameter.encode(known))
        record = "NULL" if known is None else f"set_up_{index}"
        did = f"&identifiers[{identifiers.index(parameter)}]"
        rows.append(f"{{{did}, {str(known is not None).lower()}, {record}}}")
    writer.array("struct parameter", "parameters", "PARAMETERS", rows)


def _write_services(writer: _Writer) -> None:
    rows = []
    for service in table.SERVICES:
        name = f"subfunctions_{service.number:02X}"
        numbers = ", ".join(
            f"{{{number}, {_access(service.only_in.get(number))}}}"
            for number in service.subfunctions
        )
        if numbers:
            writer.lines.append(f"static const struct subfunction {name}[] = {{{numbers}}};")
        rows.append(
            f"{{{service.number}, {_access(service.access)}, {len(service.subfunctions)}, "
            f"{name if numbers else 'NULL'}}}"
        )
    writer.array("struct service", "services", "SERVICES", rows)


def _write_routines(writer: _Writer, memory: NDArray[np.void]) -> None:
    rows = []
    for routine in table.ROUTINES:
        arguments = writer.layout(routine.arguments, None, is_written=True)
        results = writer.layout(routine.results, memory)
        can_stop = str(routine.can_stop).lower()
        access = _access(routine.access)
        rows.append(f"{{{routine.number}, {access}, {can_stop}, {arguments}, {results}}}")
    writer.array("struct routine", "routines", "ROUTINES", rows)


def _write_troubles(writer: _Writer, images: Images, identifiers: Sequence[DataIdentifier]) -> None:
    firmware = Firmware(images.settings)
    supported = FaultMemory(firmware.ram, firmware.contract).supported
    writer.array(
        "struct trouble",
        "troubles",
        "TROUBLES",
        (
            f"{{{trouble.number}, {int(trouble.kind)}, {trouble.bit}, "
            f"{str(index in supported).lower()}, {PARITY_ROW.get(index, -1)}, "
            f"{int(PARITY_KIND.get(index, -1))}}}"
            for index, trouble in enumerate(TROUBLES)
        ),
    )
    snapshot, parity = _blank(Snapshot.dtype), _blank(ParityBefore.dtype)
    shown = [PARITY_BEFORE[kind] for kind in SensorKind]
    for name, length, dids, layouts in (
        (
            "snapshot",
            "SNAPSHOT_IDENTIFIERS",
            table.SNAPSHOT,
            [writer.layout(did.fields, snapshot) for did in table.SNAPSHOT],
        ),
        ("parity", "2", shown, [writer.layout(_bare(did), parity) for did in shown]),
    ):
        writer.array(
            "struct identifier *const",
            f"{name}_identifiers",
            length,
            (f"&identifiers[{identifiers.index(did)}]" for did in dids),
        )
        writer.array("struct layout", f"{name}_layouts", length, layouts)


def _bare(did: DataIdentifier) -> list[Field]:
    """Return an identifier's fields as they are in a freeze frame, without the path to them."""
    return [replace(field, source=field.source.split(".")[-1]) for field in did.fields]


def segments(own: np.dtype[np.void]) -> list[tuple[int, int, int]]:
    """Return what a variant of the memory shares with `Ram`: offset there, here, size in bytes."""
    found: list[list[int]] = []
    for whole, mine, size in _shared(Ram.dtype, own, 0, 0):
        last = found[-1] if found else [0, 0, 0]
        if found and last[0] + last[2] == whole and last[1] + last[2] == mine:
            last[2] += size
        else:
            found.append([whole, mine, size])
    return [(whole, mine, size) for whole, mine, size in found]


def _shared(
    whole: np.dtype[np.void], own: np.dtype[np.void], at: int, own_at: int
) -> Iterator[tuple[int, int, int]]:
    if whole == own:
        yield at, own_at, whole.itemsize
        return
    if whole.subdtype is not None:
        count = whole.shape[0] if whole.shape == own.shape else 1
        elements, own_elements = _row(whole), _row(own)
        for k in range(count):
            yield from _shared(
                elements,
                own_elements,
                at + k * elements.itemsize,
                own_at + k * own_elements.itemsize,
            )
        return
    if whole.fields is None:
        yield at, own_at, whole.itemsize
        return
    assert own.fields is not None
    for name in whole.names or ():
        field, offset, *_ = whole.fields[name]
        own_field, own_offset, *_ = own.fields[name]
        yield from _shared(field, own_field, at + offset, own_at + own_offset)


def _row(array: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the dtype of an array's rows."""
    rest = array.shape[1:]
    return np.dtype((array.base, rest)) if rest else array.base


def choices_of(images: Images) -> dict[tuple[int, int], bytes]:
    """Return the memories at power-on by method of alignment and height channel.

    Those for which the program has room: it was compiled for what its scenario asks for.
    """
    alignment = table.identifier("alignment").number
    height = table.identifier("height_channel").number
    own = parameter_settings.parameters_of(images.settings)
    found = {}
    for method in InitialAttitude:
        for channel in HeightChannel:
            changed = parameter_settings.changed(
                images.settings,
                {
                    alignment: own[alignment] | {"method": int(method)},
                    height: {"height_channel": int(channel)},
                },
            )
            ram = Firmware(changed).ram
            wanted, given = vars(Variant.of(ram)), vars(images.variant)
            if all(given[name] or not is_wanted for name, is_wanted in wanted.items()):
                memory = shortened(ram, images.ram.dtype).tobytes()
                found[int(method), int(channel)] = memory
    return found


def _write_choices(
    writer: _Writer, images: Images, choices: Mapping[tuple[int, int], bytes]
) -> None:
    """Write what the choices change of the memory."""
    rows = []
    for (method, channel), memory in choices.items():
        name = f"patches_{method}_{channel}"
        count = _write_patches(writer, name, images.ram.tobytes(), memory)
        rows.append(f"{{{method}, {channel}, {name if count else 'NULL'}, {count}}}")
    writer.array("struct choice", "choices", "CHOICES", rows)


def _write_patches(writer: _Writer, name: str, before: bytes, after: bytes) -> int:
    rows = []
    for begin, end in _runs(before, after):
        writer.bytes(f"{name}_{begin}", after[begin:end])
        rows.append(f"    {{{begin}, {end - begin}, {name}_{begin}}},")
    if rows:
        writer.lines += [f"static const struct patch {name}[] = {{", *rows, "};"]
    return len(rows)


def _runs(before: bytes, after: bytes) -> list[tuple[int, int]]:
    """Return where two memories differ, stretch by stretch."""
    found: list[tuple[int, int]] = []
    differing = np.flatnonzero(np.frombuffer(before, "u1") != np.frombuffer(after, "u1"))
    for at in differing.tolist():
        if found and at - found[-1][1] < _GAP:
            found[-1] = found[-1][0], at + 1
        else:
            found.append((at, at + 1))
    return found


def _write_rest(writer: _Writer, images: Images) -> None:
    settings = images.settings
    texts = ('"' + text + '"' for text in IDENTITY.values())
    writer.array("char *const", "identity", "IDENTITIES", texts)
    types = silenced_types(load_contract())
    ids = np.flatnonzero(types)
    writer.array("uint16_t", "silenced_ids", "SILENCED_IDS", map(str, ids))
    writer.array("uint8_t", "silenced_types", "SILENCED_IDS", map(str, types[ids]))
    axes = settings.gyro_axes_deg, settings.accelerometer_axes_deg
    for name, matrices in (
        ("input_axes", [input_axes(one) for one in axes]),
        ("transverse_u", [transverse(one)[0] for one in axes]),
        ("transverse_v", [transverse(one)[1] for one in axes]),
    ):
        rows = (
            "{" + ", ".join("{" + ", ".join(x.hex() for x in h.tolist()) + "}" for h in one) + "}"
            for one in matrices
        )
        writer.lines.append(f"const double {name}[2][SENSORS][3] = {{")
        writer.lines += [f"    {row}," for row in rows]
        writer.lines.append("};")
