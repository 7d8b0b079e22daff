"""The command `rrins inject`."""

from __future__ import annotations

from typing import get_args

import click

from rrins.host_tools.cli.completion import complete_messages
from rrins.host_tools.cli.options import Bus, Command, bus_option, flag, json_option, option
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.injection.fault_report import (
    ActiveFault,
    FaultReport,
    fault_keys,
    fault_words,
)
from rrins.host_tools.injection.messages import LiveFault
from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.wire.fault_kinds import FaultKind

_CLEAR, _LIST = "clear", "list"
_MOST_NAMED = 4  # kinds in the help of an option
_STEPS = {
    "delay_s": "a whole number of epochs",
    "probability": "the nearest value a command can carry",
}


def _options(command: Command) -> Command:
    """Add an option for each key that a fault can have in a scenario, but `at_s`."""
    keys: dict[str, list[str]] = {}
    for kind, table in KINDS.items():
        for key in table.model_fields:
            keys.setdefault(key, []).append(kind)
    del keys["kind"], keys["at_s"]
    keys["for_s"] = keys.pop("for_s")  # the last
    for key, kinds in reversed(keys.items()):
        field = KINDS[kinds[0]].model_fields[key]
        of = f"For {', '.join(kinds)}: " if len(kinds) <= _MOST_NAMED else ""
        numbers = [number for number in (int, float) if _is_of(field.annotation, number)]
        command = option(
            f"--{key.removesuffix('_s').replace('_', '-')} {key}",
            f"{of}{field.description}",
            numbers[0] if numbers else None,
            shell_complete=complete_messages if key == "message" else None,
        )(command)
    return command


def _is_of(annotation: object, number: type) -> bool:
    return annotation is number or number in get_args(annotation)


_HELP = f"""Inject a fault into a running rehearsal, or remove it.

Faults on the wire: {", ".join(kind.word for kind in FaultKind)}.

Hardware faults: {", ".join(kind.word for kind in HardwareFault)}.

`clear` removes all faults; `list` shows the active ones and when they began.
"""


@click.command(help=_HELP)
@click.argument("kind", metavar="KIND|clear|list")
@_options
@flag("--remove", "Remove the fault.")
@bus_option
@json_option
def inject(kind: str, remove: bool, bus: Bus, as_json: bool, **keys: str | float | None) -> None:
    """Inject a fault into a running rehearsal, or remove it."""
    from rrins.host_tools.scenario.scenario import fault_of

    given = {key: value for key, value in keys.items() if value is not None}
    if kind in (_CLEAR, _LIST):
        if given or remove:
            word = "--remove" if remove else f"--{next(iter(given)).replace('_', '-')}"
            raise click.UsageError(f"{kind} does not accept fault options such as {word}")
        fault = None
    else:
        fault = fault_of({"kind": kind} | given)
    with FaultClient(bus.address()) as client:
        if fault is None:
            text, values = _clear(client) if kind == _CLEAR else _list(client)
        elif remove:
            text, values = _remove(client, fault)
        else:
            text, values = _inject(client, fault)
    print_results(as_json, values, [text])


_Outcome = tuple[str, JsonObject]
"""A summary as text and as plain values."""


def _inject(client: FaultClient, fault: LiveFault) -> _Outcome:
    active, report = client.inject(fault)
    for key in ("delay_s", "probability"):
        wanted, is_now = getattr(fault, key, None), active.keys.get(key)
        if is_now is not None and wanted != is_now:
            print_note(f"{key} {wanted:g} became {is_now:g}, {_STEPS[key]}")
    return f"{active.words} {_times(active, report)}", report.fault_as_dict(active)


def _remove(client: FaultClient, fault: LiveFault) -> _Outcome:
    report = client.remove(fault)
    keys = fault_keys(fault)
    summary = {"removed": keys, "epoch": report.epoch, "time_s": report.seconds(report.epoch)}
    return f"{fault_words(keys)} removed {_at(report, report.epoch)}", summary


def _clear(client: FaultClient) -> _Outcome:
    before = client.report()
    report = client.clear()
    count = len(before.faults)
    summary = {"removed": count, "epoch": report.epoch, "time_s": report.seconds(report.epoch)}
    return f"{_faults(count)} removed {_at(report, report.epoch)}", summary


def _list(client: FaultClient) -> _Outcome:
    report = client.report()
    head = (
        f"{_faults(len(report.faults))} active {_at(report, report.epoch)}; "
        f"{report.affected_frames} frames affected on the wire so far"
    )
    width = max((len(fault.words) for fault in report.faults), default=0)
    lines = [f"  {fault.words:<{width}}  {_times(fault, report)}" for fault in report.faults]
    return "\n".join([head, *lines]), report.as_dict()


def _faults(count: int) -> str:
    return f"{count or 'no'} fault{'' if count == 1 else 's'}"


def _at(report: FaultReport, epoch: int) -> str:
    return f"at epoch {epoch} ({report.seconds(epoch):.3f} s)"


def _times(fault: ActiveFault, report: FaultReport) -> str:
    first = fault.first_epoch
    since = f"since epoch {first} ({report.seconds(first):.3f} s)"
    return f"{since}, for {fault.duration_ms / 1000:g} s" if fault.duration_ms else since
