"""The command `rrins inject`."""

from __future__ import annotations

import json
from typing import Any

import click

from host_tools.completion import complete_messages
from host_tools.injection.client import FaultClient
from host_tools.injection.messages import Fault
from host_tools.injection.report import ActiveFault, FaultReport, keys_of, words_of
from host_tools.port import EMBEDDED

_DEFAULT_CHANNEL = "rrins0"
_CLEAR, _LIST = "clear", "list"
_STEPS = {"delay_s": "a whole number of epochs", "probability": "the nearest that a command says"}


@click.command()
@click.argument("kind", metavar="KIND|clear|list")
@click.option(
    "--message",
    help="Wire: the message that is meant, such as SENSOR_3; all without.",
    shell_complete=complete_messages,
)
@click.option("--node", help="Wire: whose frames: any, firmware or hardware.  [default: any]")
@click.option("--delay", "delay_s", type=float, help="Seconds, for delay.")
@click.option("--frames-per-epoch", type=int, help="For babble.")
@click.option("--bit", type=int, help="Bit of the payload, for corrupt; a random one without.")
@click.option("--probability", type=float, help="Wire: share of the frames that are hit.")
@click.option("--axis", help="The axis that fails: inner or outer.")
@click.option("--sensor", type=int, help="The gyro or accelerometer that fails; all without.")
@click.option("--rate-dps", type=float, help="For axis_runaway, °/s.")
@click.option("--offset-deg", type=float, help="For encoder_offset, °.")
@click.option("--bias-dph", type=float, help="For gyro_bias, °/h.")
@click.option("--bias-ug", type=float, help="For accelerometer_bias, µg.")
@click.option("--angle-random-walk-deg-per-sqrt-h", type=float, help="For gyro_noise, °/√h.")
@click.option("--white-noise-ug-per-sqrt-hz", type=float, help="For accelerometer_noise, µg/√Hz.")
@click.option("--for", "for_s", type=float, help="Seconds (simulated); without, until removed.")
@click.option("--remove", is_flag=True, help="Take the fault out again.")
@click.option("--interface", default=EMBEDDED, show_default=True, help="python-can interface name.")
@click.option("--channel", help=f"Channel of the interface.  [default: {_DEFAULT_CHANNEL}]")
@click.option("--bitrate", type=click.IntRange(1), help="For interfaces that set it.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def inject(
    kind: str,
    remove: bool,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    as_json: bool,
    **keys: Any,
) -> None:
    """Put a fault into a rehearsal under way, or take it out.

    On the wire, KIND is drop, delay, duplicate, reorder, corrupt_wire, corrupt, wrong_counter,
    babble, silence, bus_off, cut or stale.

    Of the hardware it is axis_stall, axis_runaway, encoder_stuck, encoder_offset, gyro_stuck,
    gyro_bias, gyro_noise, gyro_absent, accelerometer_stuck, accelerometer_bias,
    accelerometer_noise or accelerometer_absent.

    `clear` takes out all, `list` says which are active and since when.
    """
    from host_tools.rehearsal import default_address
    from host_tools.scenario import fault_of

    given = {key: value for key, value in keys.items() if value is not None}
    if kind in (_CLEAR, _LIST):
        if given or remove:
            option = "--remove" if remove else f"--{next(iter(given)).replace('_', '-')}"
            raise click.UsageError(f"{kind} takes no option of a fault, such as {option}")
        fault = None
    else:
        fault = fault_of({"kind": kind} | given)
    if channel is None and interface == EMBEDDED:
        channel = _DEFAULT_CHANNEL
    with FaultClient(default_address(interface, channel, bitrate)) as client:
        if fault is None:
            text, values = _clear(client) if kind == _CLEAR else _list(client)
        elif remove:
            text, values = _remove(client, fault)
        else:
            text, values = _inject(client, fault)
    click.echo(json.dumps(values) if as_json else text)


_Outcome = tuple[str, dict[str, Any]]
"""What is told: as text, and as plain values."""


def _inject(client: FaultClient, fault: Fault) -> _Outcome:
    active, report = client.inject(fault)
    for key in ("delay_s", "probability"):
        wanted, is_now = getattr(fault, key, None), active.keys.get(key)
        if is_now is not None and wanted != is_now:
            click.echo(f"rrins: {key} {wanted:g} became {is_now:g}, {_STEPS[key]}", err=True)
    return f"{active.words} {_times(active, report)}", report.fault_as_dict(active)


def _remove(client: FaultClient, fault: Fault) -> _Outcome:
    report = client.remove(fault)
    keys = keys_of(fault)
    told = {"removed": keys, "epoch": report.epoch, "time_s": report.seconds(report.epoch)}
    return f"{words_of(keys)} taken out {_at(report, report.epoch)}", told


def _clear(client: FaultClient) -> _Outcome:
    before = client.report()
    report = client.clear()
    count = len(before.faults)
    told = {"removed": count, "epoch": report.epoch, "time_s": report.seconds(report.epoch)}
    return f"{_faults(count)} taken out {_at(report, report.epoch)}", told


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
