"""The command `rrins inject`."""

from __future__ import annotations

import json

import click

from rrins.host_tools.bus.port import EMBEDDED
from rrins.host_tools.cli.completion import complete_messages
from rrins.host_tools.cli.options import bus_options, json_option
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.files import JsonObject
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.injection.fault_report import (
    ActiveFault,
    FaultReport,
    fault_keys,
    fault_words,
)
from rrins.host_tools.injection.messages import LiveFault

_DEFAULT_CHANNEL = "rrins0"
_CLEAR, _LIST = "clear", "list"
_STEPS = {
    "delay_s": "a whole number of epochs",
    "probability": "the nearest value a command can carry",
}


@click.command()
@click.argument("kind", metavar="KIND|clear|list")
@click.option(
    "--message",
    help="Wire: message concerned, such as SENSOR_3.  [default: all]",
    shell_complete=complete_messages,
)
@click.option("--node", help="Wire: sender concerned: any, firmware or hardware.  [default: any]")
@click.option("--delay", "delay_s", type=float, help="For delay, s.")
@click.option("--frames-per-epoch", type=int, help="For babble: number of frames.")
@click.option("--bit", type=int, help="For corrupt: bit of the payload.  [default: random]")
@click.option("--probability", type=float, help="Wire: fraction of the frames affected.")
@click.option("--axis", help="Axis that fails: inner or outer.")
@click.option("--sensor", type=int, help="Gyro or accelerometer that fails.  [default: all]")
@click.option("--rate-dps", type=float, help="For axis_runaway, °/s.")
@click.option("--offset-deg", type=float, help="For encoder_offset, °.")
@click.option("--slip-percent", type=float, help="For encoder_slip and odometer_slip, %.")
@click.option("--bias-dph", type=float, help="For gyro_bias, °/h.")
@click.option("--bias-ug", type=float, help="For accelerometer_bias, µg.")
@click.option("--angle-random-walk-deg-per-sqrt-h", type=float, help="For gyro_noise, °/√h.")
@click.option("--white-noise-ug-per-sqrt-hz", type=float, help="For accelerometer_noise, µg/√Hz.")
@click.option("--bias-dph-per-min", type=float, help="For gyro_ramp, °/h per minute.")
@click.option("--bias-ug-per-min", type=float, help="For accelerometer_ramp, µg per minute.")
@click.option("--scale-ppm", type=float, help="For …_scale, ppm.")
@click.option("--shift-arcsec", type=float, help="For …_shift_u and …_shift_v, ″.")
@click.option(
    "--direction", help="For gnss_jump and gnss_pull: east, north or up.  [default: east]"
)
@click.option("--jump-m", type=float, help="For gnss_jump, m.")
@click.option("--pull-mps", type=float, help="For gnss_pull, m/s.")
@click.option("--period", "period_s", type=float, help="Hardware: intermittent, period in s.")
@click.option("--duty", type=float, help="Share of the period with the fault.  [default: 0.5]")
@click.option(
    "--for", "for_s", type=float, help="Duration in simulated seconds.  [default: until removed]"
)
@click.option("--remove", is_flag=True, help="Remove the fault.")
@bus_options
@json_option
def inject(
    kind: str,
    remove: bool,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    as_json: bool,
    **keys: str | float | None,
) -> None:
    """Inject a fault into a running rehearsal, or remove it.

    Faults on the wire: drop, delay, duplicate, reorder, corrupt_wire, corrupt, wrong_counter,
    babble, silence, bus_off, cut, stale.

    Hardware faults: axis_stall, axis_runaway, encoder_stuck, encoder_offset, encoder_slip; gyro_ or
    accelerometer_ with stuck, dead, absent, full_scale, bias, ramp, noise, scale, shift_u or
    shift_v; odometer_slip, odometer_lock, odometer_lost; gnss_jump, gnss_pull, gnss_lost.

    `clear` removes all faults; `list` shows the active ones and when they began.
    """
    from rrins.host_tools.runs.rehearsal import default_address
    from rrins.host_tools.scenario.scenario import fault_of

    given = {key: value for key, value in keys.items() if value is not None}
    if kind in (_CLEAR, _LIST):
        if given or remove:
            option = "--remove" if remove else f"--{next(iter(given)).replace('_', '-')}"
            raise click.UsageError(f"{kind} does not accept fault options such as {option}")
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
