"""`rrins diag dtc`: trouble codes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import click
import numpy as np
from rich.table import Table

from rrins.firmware_py.core.records.redundancy_records import BEFORE_S
from rrins.firmware_py.core.records.troubles import ALL_GROUPS, FIRST_SNAPSHOT, Trouble
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Field, Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.redundancy_identifiers import PARITY_BEFORE
from rrins.host_tools.cli.diag.arguments import TROUBLE
from rrins.host_tools.cli.diag.options import with_tester
from rrins.host_tools.cli.diag.output import grid, paragraph
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import flag, json_option
from rrins.host_tools.cli.output import print_json, print_results
from rrins.host_tools.diag.tester import RECORDS, Tester
from rrins.host_tools.diag.trouble_table import TroubleReport
from rrins.host_tools.diag.values import value_text
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rounding import alike


@click.group(cls=Group)
def dtc() -> None:
    """Read and clear diagnostic trouble codes."""


def _trouble_object(tester: Tester, found: TroubleReport, with_frames: bool) -> JsonObject:
    result: JsonObject = {
        "code": found.code,
        "number": f"0x{found.number:06X}",
        "name": found.trouble.name if found.trouble else None,
        "text": found.trouble.text if found.trouble else None,
        "status": found.status,
        "status_bits": found.status_bits,
    }
    if with_frames:
        result |= tester.extended_data(found.number)
        result["freeze_frames"] = tester.freeze_frames(found.number)
    return result


def _find_trouble(tester: Tester, trouble: Trouble) -> TroubleReport:
    """Return a trouble code's report; fail if this computer does not support the code."""
    for found in tester.all_troubles():
        if found.number == trouble.number:
            return found
    raise click.UsageError(f"this computer does not have {trouble.name}")


@dtc.command("read")
@click.argument("trouble", type=TROUBLE, required=False, metavar="[TROUBLE]")
@flag("--all all_of_them", "Read all supported codes, passed or failed.")
@flag("--freeze-frames", "Include the freeze frames.")
@json_option
@with_tester
def read_troubles(
    tester: Tester,
    trouble: Trouble | None,
    all_of_them: bool,
    freeze_frames: bool,
    as_json: bool,
) -> None:
    """Read the failed, pending and confirmed trouble codes.

    With a TROUBLE (sensor_3_silent, U1103-87 or 0xD10387), read its counters and freeze frames.
    """
    if trouble is not None:
        found = [_find_trouble(tester, trouble)]
    else:
        found = tester.all_troubles() if all_of_them else tester.troubles()
    in_detail = freeze_frames or trouble is not None
    if as_json:
        print_json([_trouble_object(tester, one, in_detail) for one in found])
        return
    parts: list[Table | str] = []
    if not found:
        parts.append("no trouble codes")
    elif in_detail:
        parts += [part for one in found for part in _details(tester, one)]
    else:
        rows = grid("code", "trouble", "status")
        for one in found:
            name = f"{one.name}\n{one.text}".rstrip()
            rows.add_row(one.code, name, one.state.replace(", ", "\n", 1))
        parts.append(rows)
    print_results(False, [], parts)


def _details(tester: Tester, found: TroubleReport) -> Iterator[Table | str]:
    extended = tester.extended_data(found.number)
    frames = tester.snapshots(found.number)
    yield f"{found.code} {found.name} (0x{found.number:06X})"
    if found.trouble:
        yield paragraph(found.trouble.text)
        yield paragraph(f"fails after / passes after: {found.trouble.debounce}")
    bits = (bit.replace("_", " ") for bit in found.status_bits)
    yield paragraph(f"status 0x{found.status:02X}: {', '.join(bits)}")
    counters = (f"{name.replace('_', ' ')} {value}" for name, value in extended.items())
    yield paragraph(", ".join(counters))
    if frames:
        yield _freeze_frames(frames)


def _freeze_frames(frames: dict[int, dict[str, Values]]) -> Table:
    headings = [RECORDS.get(record, str(record)) for record in frames]
    first = frames.get(FIRST_SNAPSHOT)
    if first and len(frames) > 1 and all(frame == first for frame in frames.values()):
        frames, headings = {FIRST_SNAPSHOT: first}, ["first and latest"]
    shown = grid("freeze frame", "field", *headings, "unit")
    for did in table.SNAPSHOT:
        name = did.name
        for field in did.fields:
            values = [value_text(field, frame[did.name][field.name]) for frame in frames.values()]
            shown.add_row(name, field.name, *values, field.unit)
            name = ""
    for did in PARITY_BEFORE.values():
        if all(did.name in frame for frame in frames.values()):
            _add_parity(shown, did, list(frames.values()))
    return shown


def _add_parity(shown: Table, did: DataIdentifier, frames: Sequence[Mapping[str, Values]]) -> None:
    """Add what the parity was in each of the seconds before the alarm."""
    alarm, ratio, residual = did.fields
    values = [value_text(alarm, frame[did.name][alarm.name]) for frame in frames]
    shown.add_row(did.name, alarm.name, *values, alarm.unit)
    for k in range(BEFORE_S):
        before = f"{BEFORE_S - k} s before"
        ratios = [f"{_numbers(frame, did, ratio)[k]:.2f}" for frame in frames]
        shown.add_row("", f"{before}: {ratio.name}", *ratios, ratio.unit)
        texts = []
        for frame in frames:
            seconds = np.reshape(_numbers(frame, did, residual), (BEFORE_S, -1))
            sensors = int(np.max(np.flatnonzero(seconds.any(axis=0)), initial=0)) + 1
            texts.append("  ".join(alike(seconds[k, :sensors])))
        shown.add_row("", f"{before}: {residual.name}", *texts, residual.unit)


def _numbers(frame: Mapping[str, Values], did: DataIdentifier, field: Field) -> tuple[float, ...]:
    found = frame[did.name][field.name]
    assert isinstance(found, tuple)
    return found


@dtc.command("clear")
@click.argument("trouble", type=TROUBLE, required=False, metavar="[TROUBLE]")
@json_option
@with_tester
def clear_troubles(tester: Tester, trouble: Trouble | None, as_json: bool) -> None:
    """Clear one or all trouble codes and their freeze frames.

    Faults that persist are detected again.
    """
    tester.clear(ALL_GROUPS if trouble is None else _find_trouble(tester, trouble).number)
    cleared = "all" if trouble is None else trouble.name
    print_results(as_json, {"cleared": cleared}, [f"cleared: {cleared}"])
