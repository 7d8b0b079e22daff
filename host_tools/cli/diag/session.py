"""`rrins diag identify`, `session` and `reset`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import click

from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.access import Session
from rrins.firmware_py.diagnostics.identifiers import IDENTIFICATION
from rrins.host_tools.cli.diag.did import print_values
from rrins.host_tools.cli.diag.options import with_securing_tester, with_tester
from rrins.host_tools.cli.diag.output import grid
from rrins.host_tools.cli.options import NOT_NEGATIVE, json_option, option
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.diag.tester import Tester
from rrins.host_tools.diag.values import to_json
from rrins.host_tools.errors import DiagError, NoAnswerError
from rrins.host_tools.files import JsonObject

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
    """Identify the computer: versions, state, trouble codes."""
    dids = [*IDENTIFICATION, *(table.identifier(name) for name in _STATE)]
    found = tester.read(dids)
    failed = len(tester.troubles(Status.TEST_FAILED))
    confirmed = len(tester.troubles(Status.CONFIRMED))
    is_same = found["table_version"]["table_crc32"] == table.crc32()
    summary: JsonObject = {one.name: to_json(one.layout, found[one.name]) for one in dids} | {
        "table_is_this_tools": is_same,
        "troubles_failed_now": failed,
        "troubles_confirmed": confirmed,
    }
    rows = grid("", "", heading=False)
    for label, value in _identity_rows(
        {one.name: one.layout.named(found[one.name]) for one in dids}
    ):
        rows.add_row(label, value)
    rows.add_row("trouble codes", f"{failed} failed now, {confirmed} confirmed")
    print_results(as_json, summary, [rows])
    if not is_same:
        print_note(
            "the computer's diagnostic table differs from this tool's: identifiers may differ in "
            "meaning; use the tool of the same version"
        )


def _identity_rows(named: Mapping[str, JsonObject]) -> Iterator[tuple[str, str]]:
    """Yield a computer's identification as labels and values."""
    single = {name: next(iter(values.values())) for name, values in named.items()}
    mode, sensors, memory = named["mode"], named["sensors"], named["parameter_memory"]
    yield "system", f"{single['system_name']}, by {single['supplier']}"
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
@option("--for for_s", "Keep the session for this many seconds.", NOT_NEGATIVE)
@json_option
@with_securing_tester
def session(tester: Tester, name: str | None, for_s: float | None, as_json: bool) -> None:
    """Enter a diagnostic session, or show the active one.

    A session ends 5 s after the last request. Each command enters the session that it needs, so
    this is for the shell, and for other tools on the bus.
    """
    if name is not None:
        tester.conversation.enter(Session[name.upper()])
    if tester.conversation.is_securing:
        tester.conversation.unlock()
    if for_s is not None:
        tester.conversation.pass_time(for_s)
    did = table.identifier("active_session")
    active = did.layout.named(tester.read([did])[did.name])["session"]
    is_unlocked = tester.conversation.is_unlocked
    result = {"session": active, "unlocked": is_unlocked, "s3_ms": access.S3_MS}
    print_results(as_json, result, [f"session {active}{', unlocked' if is_unlocked else ''}"])


@click.command()
@click.argument("kind", type=click.Choice(tuple(_KINDS)), default="hard")
@json_option
@with_securing_tester
def reset(tester: Tester, kind: str, as_json: bool) -> None:
    """Reset the computer and wait until it answers.

    A hard reset reloads the parameter memory and begins an operation cycle. A computer that
    navigates refuses it, unless --security unlocks it: afterwards it begins anew at the position of
    its set-up, whatever it has moved since, and resumes the operator's last mode command.
    """
    tester.reset(_KINDS[kind])
    dids = [table.identifier(name) for name in ("mode", "uptime")]
    waited_s = 0.0
    while True:
        tester.conversation.connection.pass_time(_LOOK_S)
        waited_s += _LOOK_S
        try:
            found = tester.read(dids)
            break
        except NoAnswerError as error:
            if waited_s > _BACK_S:
                raise DiagError("reset: the navigation computer does not answer again") from error
    print_values(dids, found, as_json)
