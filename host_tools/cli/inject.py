"""The command `rrins inject`."""

from __future__ import annotations

import click

from rrins.host_tools.cli.completion import complete_messages
from rrins.host_tools.cli.options import (
    Bus,
    bus_option,
    flag,
    json_option,
    option,
)
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.files import JsonObject
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.injection.fault_report import (
    ActiveFault,
    FaultReport,
    fault_keys,
    fault_words,
)
from rrins.host_tools.injection.messages import LiveFault

_CLEAR, _LIST = "clear", "list"
_STEPS = {
    "delay_s": "a whole number of epochs",
    "probability": "the nearest value a command can carry",
}


@click.command()
@click.argument("kind", metavar="KIND|clear|list")
@option(
    "--message",
    "Wire: message concerned, such as SENSOR_3.  [default: all]",
    shell_complete=complete_messages,
)
@option("--node", "Wire: sender concerned: any, firmware or hardware.  [default: any]")
@option("--delay delay_s", "For delay, s.", float)
@option("--frames-per-epoch", "For babble: number of frames.", int)
@option("--bit", "For corrupt: bit of the payload.  [default: random]", int)
@option("--probability", "Wire: fraction of the frames affected.", float)
@option("--axis", "Axis that fails: inner or outer.")
@option("--sensor", "Gyro or accelerometer that fails.  [default: all]", int)
@option("--rate-dps", "For axis_runaway, °/s.", float)
@option("--offset-deg", "For encoder_offset, °.", float)
@option("--slip-percent", "For encoder_slip and odometer_slip, %.", float)
@option("--bias-dph", "For gyro_bias, °/h.", float)
@option("--bias-ug", "For accelerometer_bias, µg.", float)
@option("--angle-random-walk-deg-per-sqrt-h", "For gyro_noise, °/√h.", float)
@option("--white-noise-ug-per-sqrt-hz", "For accelerometer_noise, µg/√Hz.", float)
@option("--bias-dph-per-min", "For gyro_ramp, °/h per minute.", float)
@option("--bias-ug-per-min", "For accelerometer_ramp, µg per minute.", float)
@option("--scale-ppm", "For …_scale, ppm.", float)
@option("--shift-arcsec", "For …_shift_u and …_shift_v, ″.", float)
@option("--direction", "For gnss_jump and gnss_pull: east, north or up.  [default: east]")
@option("--jump-m", "For gnss_jump, m.", float)
@option("--pull-mps", "For gnss_pull, m/s.", float)
@option("--period period_s", "Hardware: intermittent, period in s.", float)
@option("--duty", "Share of the period with the fault.  [default: 0.5]", float)
@option("--for for_s", "Duration in simulated seconds.  [default: until removed]", float)
@flag("--remove", "Remove the fault.")
@bus_option
@json_option
def inject(
    kind: str,
    remove: bool,
    bus: Bus,
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
    from rrins.host_tools.scenario.scenario import fault_of

    given = {key: value for key, value in keys.items() if value is not None}
    if kind in (_CLEAR, _LIST):
        if given or remove:
            option = "--remove" if remove else f"--{next(iter(given)).replace('_', '-')}"
            raise click.UsageError(f"{kind} does not accept fault options such as {option}")
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
