"""`rrins diag did`: data identifiers."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import click
from rich.table import Table

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Values
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.identifiers import IOControl
from rrins.firmware_py.diagnostics.parameters import (
    ACCELEROMETER_CALIBRATIONS,
    ACCELEROMETER_SIGMAS,
    GYRO_CALIBRATIONS,
    GYRO_SIGMAS,
)
from rrins.host_tools.cli.diag.arguments import CONTROLLABLE, IDENTIFIER, WRITABLE, complete_values
from rrins.host_tools.cli.diag.options import with_securing_tester, with_tester
from rrins.host_tools.cli.diag.output import grid, paragraph, value_grid
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import NOT_NEGATIVE, flag, json_option, option
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.diag.values import AssignmentError, limits_of, parse_values, to_json
from rrins.host_tools.files import JsonObject

_CONTROLS = {
    "adjust": IOControl.SHORT_TERM_ADJUSTMENT,
    "freeze": IOControl.FREEZE_CURRENT_STATE,
    "default": IOControl.RESET_TO_DEFAULT,
    "return": IOControl.RETURN_CONTROL,
}


@click.group(cls=Group)
def did() -> None:
    """Read and write data by identifier."""


def _sensor_of(one: DataIdentifier) -> int | None:
    """Return the sensor that an identifier calibrates; None for other identifiers."""
    for group in (
        GYRO_CALIBRATIONS,
        GYRO_SIGMAS,
        ACCELEROMETER_CALIBRATIONS,
        ACCELEROMETER_SIGMAS,
    ):
        if one in group:
            return group.index(one) + 1
    return None


def _group_of(one: DataIdentifier) -> str:
    """Return the number of the first sensor's identifier, with n for the sensor."""
    base = one.number - 1
    return f"0x{one.number >> 8:02X}nn" if base & 0xFF == 0 else f"0x{base:04X}+n"


def _rights(one: DataIdentifier) -> str:
    return "r" + ("w" if one.write else "") + ("c" if one.control else "")


def _description(one: DataIdentifier) -> JsonObject:
    return {
        "number": f"0x{one.number:04X}",
        "name": one.name,
        "text": one.text,
        "read": str(one.read),
        "write": None if one.write is None else str(one.write),
        "control": None if one.control is None else str(one.control),
        "fields": [
            {
                "name": field.name,
                "type": field.format,
                "count": field.count,
                "unit": field.unit,
                "limits": limits_of(field),
            }
            for field in one.fields
        ],
    }


@did.command("list")
@click.argument("which", type=IDENTIFIER, required=False, metavar="[IDENTIFIER]")
@flag("--writable", "List only writable identifiers.")
@flag("--controllable", "List only controllable identifiers.")
@json_option
def list_identifiers(
    which: DataIdentifier | None, writable: bool, controllable: bool, as_json: bool
) -> None:
    """List the identifiers, or the fields of an IDENTIFIER. Needs no bus."""
    chosen = [
        one
        for one in ([which] if which else table.IDENTIFIERS)
        if (one.write or not writable) and (one.control or not controllable)
    ]
    parts = _description_parts(which) if which is not None else _list_parts(chosen)
    print_results(as_json, [_description(one) for one in chosen], parts)


def _list_parts(chosen: Sequence[DataIdentifier]) -> Iterator[Table | str]:
    table = grid("number", "identifier", "", "description")
    for one in chosen:
        if _sensor_of(one) == 1:
            name = one.name.replace("_1_", "_n_")
            text = one.text.replace(" 1 ", " n ").replace(" 1;", " n;")
            table.add_row(_group_of(one), name, _rights(one), text)
        elif _sensor_of(one) is None:
            table.add_row(f"0x{one.number:04X}", one.name, _rights(one), one.text)
    yield table
    yield "r read, w write, c control; n from 1 to 16, nn the same in hexadecimal"


def _description_parts(one: DataIdentifier) -> Iterator[Table | str]:
    yield paragraph(f"0x{one.number:04X} {one.name}: {one.text}", indent="")
    for word in ("read", "write", "control"):
        right = getattr(one, word)
        if right is not None:
            yield f"{word}: {right}"
    table = grid("field", "type", "allowed", "")
    for field in one.fields:
        kind = field.format + (f"[{field.count}]" if field.count > 1 else "")
        table.add_row(field.name, kind, limits_of(field) or field.unit, field.text)
    yield table


def print_values(dids: Sequence[DataIdentifier], found: dict[str, Values], as_json: bool) -> None:
    """Show the values of identifiers."""
    values = {one.name: to_json(one.layout, found[one.name]) for one in dids}
    rows = ((one.name, one.fields, found[one.name]) for one in dids)
    print_results(as_json, values, [value_grid(("identifier", "field"), rows)])


@did.command("read")
@click.argument("dids", type=IDENTIFIER, nargs=-1, metavar="[IDENTIFIER]...")
@flag("--all all_of_them", "Read all identifiers of this computer.")
@option("--every every_s", "Repeat every so many seconds until Ctrl-C.", NOT_NEGATIVE)
@option("--times", "Number of reads, instead of until Ctrl-C.", click.IntRange(1))
@json_option
@with_tester
def read_identifiers(
    tester: Tester,
    dids: tuple[DataIdentifier, ...],
    all_of_them: bool,
    every_s: float | None,
    times: int | None,
    as_json: bool,
) -> None:
    """Read data by identifier: name (position) or number (0x0401)."""
    if bool(dids) == all_of_them:
        raise click.UsageError("give at least one IDENTIFIER, or --all")
    chosen = tester.has(table.IDENTIFIERS) if all_of_them else list(dict.fromkeys(dids))
    often = times if times is not None else 1 if every_s is None else None
    for turn in itertools.count() if often is None else range(often):
        if turn and every_s:
            tester.conversation.pass_time(every_s)
        print_values(chosen, tester.read(chosen), as_json)


def _parse_values(one: DataIdentifier, texts: tuple[str, ...], current: Values | None) -> Values:
    try:
        return parse_values(one.fields, texts, current)
    except AssignmentError as error:
        raise click.UsageError(f"{one.name}: {error}") from error


@did.command("write")
@click.argument("did", type=WRITABLE, metavar="IDENTIFIER")
@click.argument(
    "texts", nargs=-1, required=True, metavar="FIELD=VALUE...", shell_complete=complete_values
)
@json_option
@with_securing_tester
def write_identifier(
    tester: Tester, did: DataIdentifier, texts: tuple[str, ...], as_json: bool
) -> None:
    """Write a parameter to the parameter memory.

    Omitted fields keep their values; separate the values of an array with commas. The new values
    take effect at the next reset.
    """
    _parse_values(did, texts, _blank(did))  # report errors before anything is sent
    current = tester.read([did])[did.name]
    tester.write(did, _parse_values(did, texts, current))
    print_values([did], tester.read([did]), as_json)
    print_note("takes effect at the next reset (`rrins diag reset`)")


def _blank(one: DataIdentifier) -> Values:
    """Return placeholder values for all fields of an identifier, to check the given ones."""
    return one.decode(bytes(one.layout.size))


@did.command("control")
@click.argument("did", type=CONTROLLABLE, metavar="IDENTIFIER")
@click.argument("how", type=click.Choice(tuple(_CONTROLS)))
@click.argument("texts", nargs=-1, metavar="[FIELD=VALUE]...", shell_complete=complete_values)
@option("--for for_s", "Keep control for this many seconds.", NOT_NEGATIVE)
@json_option
@with_securing_tester
def control_identifier(
    tester: Tester,
    did: DataIdentifier,
    how: str,
    texts: tuple[str, ...],
    for_s: float | None,
    as_json: bool,
) -> None:
    """Take control of an output, or return it.

    Control returns to the computer when the session ends: 5 s after the command, later with --for;
    in the shell, when the shell exits.
    """
    if bool(texts) != (how == "adjust"):
        raise click.UsageError("adjust needs FIELD=VALUE; the other actions do not accept any")
    values = None
    if texts:
        _parse_values(did, texts, _blank(did))
        values = _parse_values(did, texts, tester.read([did])[did.name])
    found = tester.control(did, _CONTROLS[how], values)
    print_values([did], {did.name: found}, as_json)
    if for_s is not None:
        tester.conversation.pass_time(for_s)
        print_values([did], tester.read([did]), as_json)
