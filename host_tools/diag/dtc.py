"""`rrins diag dtc`: trouble codes."""

from __future__ import annotations

from typing import Any

import click

from firmware_py.diagnostics import table
from firmware_py.diagnostics.codecs import Values
from firmware_py.diagnostics.troubles import (
    ALL_GROUPS,
    FIRST_SNAPSHOT,
    LATEST_SNAPSHOT,
    Status,
    Trouble,
)
from host_tools.diag import show
from host_tools.diag.kinds import TROUBLE
from host_tools.diag.options import json_option, with_tester
from host_tools.diag.tester import Found, Tester
from host_tools.diag.values import plain, shown

_NOTED = Status.TEST_FAILED | Status.PENDING | Status.CONFIRMED
_RECORDS = {FIRST_SNAPSHOT: "first", LATEST_SNAPSHOT: "latest"}


@click.group()
def dtc() -> None:
    """Read and clear diagnostic trouble codes."""


def _bits(status: int) -> list[str]:
    return [bit.name.lower() for bit in Status if status & bit]


def _words(status: int) -> str:
    """Return a status byte in few words, on two lines."""
    if status & Status.TEST_FAILED:
        now = "failed now"
    elif status & Status.TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE:
        now = "not tested yet"
    else:
        now = "passed now"
    marks = [bit.name.lower() for bit in (Status.PENDING, Status.CONFIRMED) if status & bit]
    return "\n".join([now, ", ".join(marks)]).rstrip()


def _code(found: Found) -> str:
    return found.trouble.code if found.trouble else f"0x{found.number:06X}"


def _named(found: Found) -> str:
    return found.trouble.name if found.trouble else "not in this tool's table"


def _as_dict(tester: Tester, found: Found, with_frames: bool) -> dict[str, Any]:
    told: dict[str, Any] = {
        "code": _code(found),
        "number": f"0x{found.number:06X}",
        "name": found.trouble.name if found.trouble else None,
        "text": found.trouble.text if found.trouble else None,
        "status": found.status,
        "status_bits": _bits(found.status),
    }
    if with_frames:
        told |= tester.extended_data(found.number)
        told["freeze_frames"] = {
            _RECORDS.get(record, str(record)): {
                name: plain(table.identifier(name).layout, values) for name, values in frame.items()
            }
            for record, frame in tester.snapshots(found.number).items()
        }
    return told


def _had(tester: Tester, trouble: Trouble) -> Found:
    """Return a trouble code as the computer has it; fail when it cannot have it."""
    for found in tester.all_troubles():
        if found.number == trouble.number:
            return found
    raise click.UsageError(f"this computer does not have {trouble.name}")


@dtc.command("read")
@click.argument("trouble", type=TROUBLE, required=False, metavar="[TROUBLE]")
@click.option(
    "--all", "all_of_them", is_flag=True, help="All that the computer can find, passed or failed."
)
@click.option("--freeze-frames", is_flag=True, help="With the freeze frames of each.")
@json_option
@with_tester
def read_troubles(
    tester: Tester,
    trouble: Trouble | None,
    all_of_them: bool,
    freeze_frames: bool,
    as_json: bool,
) -> None:
    """Read trouble codes: those that are failed, pending or confirmed.

    With a TROUBLE (sensor_3_silent, U1103-87 or 0xD10387), its counters and freeze frames.
    """
    if trouble is not None:
        found = [_had(tester, trouble)]
    else:
        found = tester.all_troubles() if all_of_them else tester.troubles(_NOTED)
    in_detail = freeze_frames or trouble is not None
    if as_json:
        show.as_json([_as_dict(tester, one, in_detail) for one in found])
        return
    if not found:
        show.line("no trouble codes")
        return
    if in_detail:
        for one in found:
            _show_one(tester, one)
        return
    grid = show.grid(("code", "trouble", "status"))
    for one in found:
        text = f"\n{one.trouble.text}" if one.trouble else ""
        grid.add_row(_code(one), _named(one) + text, _words(one.status))
    show.put(grid)


def _show_one(tester: Tester, found: Found) -> None:
    extended = tester.extended_data(found.number)
    frames = tester.snapshots(found.number)
    show.line(f"{_code(found)} {_named(found)} (0x{found.number:06X})")
    if found.trouble:
        show.paragraph(found.trouble.text)
        show.paragraph(f"fails after / passes after: {found.trouble.debounce}")
    bits = (bit.replace("_", " ") for bit in _bits(found.status))
    show.paragraph(f"status 0x{found.status:02X}: {', '.join(bits)}")
    show.paragraph(
        ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in extended.items())
    )
    if frames:
        _show_frames(frames)


def _show_frames(frames: dict[int, dict[str, Values]]) -> None:
    headings = [_RECORDS.get(record, str(record)) for record in frames]
    first = frames.get(FIRST_SNAPSHOT)
    if first and len(frames) > 1 and all(frame == first for frame in frames.values()):
        frames, headings = {FIRST_SNAPSHOT: first}, ["first and latest"]
    grid = show.grid(("freeze frame", "field", *headings, "unit"))
    for did in table.SNAPSHOT:
        name = did.name
        for field in did.fields:
            values = [shown(field, frame[did.name][field.name]) for frame in frames.values()]
            grid.add_row(name, field.name, *values, field.unit)
            name = ""
    show.put(grid)


@dtc.command("clear")
@click.argument("trouble", type=TROUBLE, required=False, metavar="[TROUBLE]")
@json_option
@with_tester
def clear_troubles(tester: Tester, trouble: Trouble | None, as_json: bool) -> None:
    """Clear a trouble code, or all, with their freeze frames.

    What is still faulty is found again.
    """
    tester.clear(ALL_GROUPS if trouble is None else _had(tester, trouble).number)
    cleared = "all" if trouble is None else trouble.name
    if as_json:
        show.as_json({"cleared": cleared})
    else:
        show.line(f"cleared: {cleared}")
