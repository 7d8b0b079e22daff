"""`rrins diag identify`, `session` and `reset`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click

from firmware_py.diagnostics import access, table
from firmware_py.diagnostics.access import Session
from firmware_py.diagnostics.identifiers import IDENTIFICATION
from firmware_py.diagnostics.troubles import Status
from host_tools.diag import show
from host_tools.diag.did import show_values
from host_tools.diag.options import json_option, with_securing_tester, with_tester
from host_tools.diag.tester import Tester
from host_tools.diag.values import plain
from host_tools.errors import DiagError, NoAnswerError

_SESSIONS = tuple(session.name.lower() for session in Session)

_KINDS = {
    name.removesuffix("Reset"): number for number, name in table.service(0x11).subfunctions.items()
}
_STATE = ("mode", "uptime", "sensors", "parameter_memory", "operation_cycles")
_BACK_S = 5.0
_LOOK_S = 0.1


@click.command()
@json_option
@with_tester
def identify(tester: Tester, as_json: bool) -> None:
    """Say what is there: the computer, its state, its trouble codes."""
    dids = [*IDENTIFICATION, *(table.identifier(name) for name in _STATE)]
    found = tester.read(dids)
    failed = len(tester.troubles(Status.TEST_FAILED))
    confirmed = len(tester.troubles(Status.CONFIRMED))
    is_same = found["table_version"]["table_crc32"] == table.crc32()
    if as_json:
        told: dict[str, Any] = {one.name: plain(one.layout, found[one.name]) for one in dids}
        show.as_json(
            told
            | {
                "table_is_this_tools": is_same,
                "troubles_failed_now": failed,
                "troubles_confirmed": confirmed,
            }
        )
    else:
        named = {one.name: one.layout.named(found[one.name]) for one in dids}
        grid = show.grid(("", ""), heading=False)
        for label, value in _lines(named):
            grid.add_row(label, value)
        grid.add_row("trouble codes", f"{failed} failed now, {confirmed} confirmed")
        show.put(grid)
    if not is_same:
        show.note(
            "its diagnostic table is not this tool's: identifiers may mean something else; use the "
            "tool of the same version"
        )


def _lines(named: dict[str, dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Yield what a computer says of itself, labelled."""
    single = {name: next(iter(values.values())) for name, values in named.items()}
    mode, sensors, memory = named["mode"], named["sensors"], named["parameter_memory"]
    yield "system", f"{single['system_name']}, of {single['supplier']}"
    yield "firmware", f"{single['software_number']} {single['software_version']}"
    yield "hardware", f"{single['hardware_number']}, serial number {single['serial_number']}"
    yield "table", f"CRC 0x{single['table_version']:08X}"
    yield "session", f"{single['active_session']}"
    yield "mode", mode["mode"] + ("" if mode["fault"] == "NONE" else f": {mode['fault']}")
    yield "up", f"{named['uptime']['uptime_s']:.1f} s, operation cycle {single['operation_cycles']}"
    yield "sensors", f"{sensors['gyros']} gyros, {sensors['accelerometers']} accelerometers"
    yield "parameters", f"{memory['state']}, written {memory['sequence']} times"


@click.command()
@click.argument("name", type=click.Choice(_SESSIONS), required=False)
@click.option("--for", "for_s", type=click.FloatRange(min=0), help="Seconds to keep it.")
@json_option
@with_securing_tester
def session(tester: Tester, name: str | None, for_s: float | None, as_json: bool) -> None:
    """Go to a diagnostic session; without a name, say which it is.

    A session ends 5 s after the last request. Commands go to the session that they need by
    themselves, so this is for the shell, and for other tools on the bus.
    """
    if name is not None:
        tester.enter(Session[name.upper()])
    if tester.is_securing:
        tester.unlock()
    if for_s is not None:
        tester.pass_time(for_s)
    did = table.identifier("active_session")
    active = did.layout.named(tester.read([did])[did.name])["session"]
    if as_json:
        show.as_json({"session": active, "unlocked": tester.is_unlocked, "s3_ms": access.S3_MS})
    else:
        show.line(f"session {active}" + (", unlocked" if tester.is_unlocked else ""))


@click.command()
@click.argument("kind", type=click.Choice(tuple(_KINDS)), default="hard")
@json_option
@with_tester
def reset(tester: Tester, kind: str, as_json: bool) -> None:
    """Power the computer on anew, and wait until it answers.

    A hard reset reads the parameter memory again and begins an operation cycle. It ends navigation:
    the computer does what the operator asked for last once its self-test is over.
    """
    tester.reset(_KINDS[kind])
    dids = [table.identifier(name) for name in ("mode", "uptime")]
    waited_s = 0.0
    while True:
        tester.connection.pass_time(_LOOK_S)
        waited_s += _LOOK_S
        try:
            found = tester.read(dids)
            break
        except NoAnswerError as error:
            if waited_s > _BACK_S:
                raise DiagError("the navigation computer has not come back") from error
    show_values(dids, found, as_json)
