"""`rrins diag did`: data identifiers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import click

from firmware_py.diagnostics import table
from firmware_py.diagnostics.codecs import Values
from firmware_py.diagnostics.data import DataIdentifier
from firmware_py.diagnostics.identifiers import IOControl
from firmware_py.diagnostics.parameters import ACCELEROMETER_CALIBRATIONS, GYRO_CALIBRATIONS
from host_tools.diag import show
from host_tools.diag.kinds import CONTROLLABLE, IDENTIFIER, WRITABLE, complete_values
from host_tools.diag.options import json_option, with_securing_tester, with_tester
from host_tools.diag.tester import Tester
from host_tools.diag.values import AssignmentError, assigned, limits_of, plain

_HOW = {
    "adjust": IOControl.SHORT_TERM_ADJUSTMENT,
    "freeze": IOControl.FREEZE_CURRENT_STATE,
    "default": IOControl.RESET_TO_DEFAULT,
    "return": IOControl.RETURN_CONTROL,
}


@click.group()
def did() -> None:
    """Read and write data by identifier."""


def _sensor_of(one: DataIdentifier) -> int | None:
    """Return which sensor an identifier is the calibration of; None for others."""
    for calibrations in (GYRO_CALIBRATIONS, ACCELEROMETER_CALIBRATIONS):
        if one in calibrations:
            return calibrations.index(one) + 1
    return None


def _rights(one: DataIdentifier) -> str:
    return "r" + ("w" if one.write else "") + ("c" if one.control else "")


def _description(one: DataIdentifier) -> dict[str, Any]:
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
@click.option("--writable", is_flag=True, help="Only those that can be written.")
@click.option("--controllable", is_flag=True, help="Only those that can be controlled.")
@json_option
def list_identifiers(
    which: DataIdentifier | None, writable: bool, controllable: bool, as_json: bool
) -> None:
    """List what there is; with an IDENTIFIER, its fields and their limits. Needs no bus."""
    chosen = [
        one
        for one in ([which] if which else table.IDENTIFIERS)
        if (one.write or not writable) and (one.control or not controllable)
    ]
    if as_json:
        show.as_json([_description(one) for one in chosen])
    elif which is not None:
        _show_one(which)
    else:
        grid = show.grid(("number", "identifier", "", "what it is"))
        for one in chosen:
            if _sensor_of(one) == 1:
                name, text = one.name.replace("_1_", "_n_"), one.text.replace(" 1 ", " n ")
                grid.add_row(f"0x{one.number >> 8:02X}nn", name, _rights(one), text)
            elif _sensor_of(one) is None:
                grid.add_row(f"0x{one.number:04X}", one.name, _rights(one), one.text)
        show.put(grid)
        show.line("r read, w write, c control; n from 1 to 16, nn likewise in hexadecimal")


def _show_one(one: DataIdentifier) -> None:
    show.paragraph(f"0x{one.number:04X} {one.name}: {one.text}", indent="")
    for word, right in (("read", one.read), ("write", one.write), ("control", one.control)):
        if right is not None:
            show.line(f"{word}: {right}")
    grid = show.grid(("field", "type", "allowed", ""))
    for field in one.fields:
        kind = field.format + (f"[{field.count}]" if field.count > 1 else "")
        grid.add_row(field.name, kind, limits_of(field) or field.unit, field.text)
    show.put(grid)


def show_values(dids: Sequence[DataIdentifier], found: dict[str, Values], as_json: bool) -> None:
    """Show the values of identifiers."""
    if as_json:
        show.as_json({one.name: plain(one.layout, found[one.name]) for one in dids})
        return
    grid = show.grid(("identifier", "field", "value", "unit"))
    for one in dids:
        name = one.name
        for field, value, unit in show.rows_of(one.fields, found[one.name]):
            grid.add_row(name, field, value, unit)
            name = ""
    show.put(grid)


@did.command("read")
@click.argument("dids", type=IDENTIFIER, nargs=-1, metavar="[IDENTIFIER]...")
@click.option("--all", "all_of_them", is_flag=True, help="All that this computer has.")
@click.option(
    "--every",
    "every_s",
    type=click.FloatRange(min=0),
    help="Read again and again, so many seconds apart, until Ctrl-C.",
)
@click.option("--times", type=click.IntRange(1), help="How often, instead.")
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
    """Read data by identifier: names (position) or numbers (0x0401)."""
    if bool(dids) == all_of_them:
        raise click.UsageError("name the identifiers, or give --all")
    chosen = tester.has(table.IDENTIFIERS) if all_of_them else list(dict.fromkeys(dids))
    often = times if times is not None else 1 if every_s is None else None
    for turn in itertools.count() if often is None else range(often):
        if turn and every_s:
            tester.pass_time(every_s)
        show_values(chosen, tester.read(chosen), as_json)


def _assigned(one: DataIdentifier, texts: tuple[str, ...], current: Values | None) -> Values:
    try:
        return assigned(one.fields, texts, current)
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
    """Write a parameter into the parameter memory.

    Fields that are not named keep their values; a row is written with commas. What is written is in
    force from the next reset on.
    """
    _assigned(did, texts, _blank(did))  # what is wrong is told before anything is sent
    current = tester.read([did])[did.name]
    tester.write(did, _assigned(did, texts, current))
    show_values([did], tester.read([did]), as_json)
    show.note("in force from the next reset on (`rrins diag reset`)")


def _blank(one: DataIdentifier) -> Values:
    """Return some values for all fields of an identifier, to check what is given beside them."""
    return one.decode(bytes(one.layout.size))


@did.command("control")
@click.argument("did", type=CONTROLLABLE, metavar="IDENTIFIER")
@click.argument("how", type=click.Choice(tuple(_HOW)))
@click.argument("texts", nargs=-1, metavar="[FIELD=VALUE]...", shell_complete=complete_values)
@click.option("--for", "for_s", type=click.FloatRange(min=0), help="Seconds to keep it.")
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
    """Take an output from the computer, or give it back.

    It is given back when the session ends: 5 s after the command, or with --for after so many
    seconds more; in the shell when that ends.
    """
    if bool(texts) != (how == "adjust"):
        raise click.UsageError("adjust needs FIELD=VALUE, the others take none")
    values = None
    if texts:
        _assigned(did, texts, _blank(did))
        values = _assigned(did, texts, tester.read([did])[did.name])
    found = tester.control(did, _HOW[how], values)
    show_values([did], {did.name: found}, as_json)
    if for_s is not None:
        tester.pass_time(for_s)
        show_values([did], tester.read([did]), as_json)
