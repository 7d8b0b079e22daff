"""The command `rrins xcp`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import (
    FILE,
    POSITIVE,
    Bus,
    Number,
    bus_option,
    json_option,
    option,
)
from rrins.host_tools.cli.output import counting, print_note, print_results
from rrins.host_tools.interruption import as_event

if TYPE_CHECKING:
    from rrins.host_tools.xcp.master import XcpMaster

_EVENTS = ("epoch", "second")

timeout_option = option("--timeout timeout_s", "Longest wait for an answer, s.", POSITIVE, 2.0)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"]})
def xcp() -> None:
    """Measure and calibrate the navigation computer by XCP on CAN (ASAM MCD-1 XCP).

    The scenario of the rehearsal needs the table [xcp]. A signal is named as in the A2L file, such
    as navigation.height or assembly.gyro_dtheta[2]; the name of an array stands for all of it.

    Exit status: 0 success, 2 usage error, 3 no such scenario, 4 no such bus, 25 any other error
    over XCP.
    """


def _master(bus: Bus, timeout_s: float) -> XcpMaster:
    from rrins.host_tools.xcp.master import XcpMaster

    return XcpMaster(bus.address(), timeout_s)


@xcp.command("list")
@click.argument("pattern", default="*")
@json_option
def list_signals(pattern: str, as_json: bool) -> None:
    """List the signals whose name contains PATTERN, which may have *. Needs no bus."""
    from rich.table import Table

    from rrins.host_tools.errors import XcpError
    from rrins.host_tools.xcp.signals import fields_like

    found = fields_like(pattern)
    if not found:
        raise XcpError(f"signal {pattern}: there is none; `rrins xcp list` shows all")
    table = Table(box=None, pad_edge=False)
    for column in ("signal", "values", "unit", "parameter", "description"):
        table.add_column(column, overflow="fold")
    for name, field, limits in found:
        shape = " × ".join(map(str, field.shape)) or "1"
        span = "" if limits is None else f"{limits.minimum:g} to {limits.maximum:g}"
        table.add_row(name, shape, field.unit, span, field.text)
    values = [
        {
            "name": name,
            "address": field.address,
            "type": field.dtype.name,
            "shape": list(field.shape),
            "unit": field.unit,
            "description": field.text,
        }
        | ({} if limits is None else {"minimum": limits.minimum, "maximum": limits.maximum})
        for name, field, limits in found
    ]
    print_results(as_json, values, [table])


@xcp.command("read")
@click.argument("names", metavar="SIGNAL...", nargs=-1, required=True)
@timeout_option
@bus_option
@json_option
def read_signals(bus: Bus, names: tuple[str, ...], timeout_s: float, as_json: bool) -> None:
    """Read signals once, one after the other; `record` reads all at the same moment."""
    from rich.table import Table

    from rrins.host_tools.xcp.master import values_of
    from rrins.host_tools.xcp.signals import signals_of

    signals = signals_of(names)
    with _master(bus, timeout_s) as master:
        values = values_of(master, signals)
    table = Table(box=None, pad_edge=False, show_header=False)
    for signal in signals:
        table.add_row(signal.name, signal.words(values[signal.name]), signal.field.unit)
    print_results(as_json, values, [table])


@xcp.command("write")
@click.argument("name", metavar="PARAMETER")
@click.argument("value", type=Number())
@timeout_option
@bus_option
def write_parameter(bus: Bus, name: str, value: float, timeout_s: float) -> None:
    """Change a parameter until the next power-on; `list` shows which there are, and limits."""
    from rrins.host_tools.errors import XcpError
    from rrins.host_tools.xcp.master import values_of
    from rrins.host_tools.xcp.signals import signals_of

    signals = signals_of([name])
    if len(signals) > 1:
        raise XcpError(f"signal {name}: is an array; name one of its elements, as {name}[0]")
    with _master(bus, timeout_s) as master:
        before = values_of(master, signals)[name]
        master.write(signals[0], value)
        after = values_of(master, signals)[name]
    words = signals[0].words
    print_results(False, {}, [f"{name}: {words(before)}, now {words(after)}"])


@xcp.command("record")
@click.argument("out", metavar="OUT", type=FILE)
@click.argument("names", metavar="SIGNAL...", nargs=-1, required=True)
@option("--for seconds", "Length, s, by the computer's time.  [default: until Ctrl-C]", POSITIVE)
@option("--event", "When a sample is taken.", _EVENTS, "epoch")
@option("--every", "Events from one sample to the next.", click.IntRange(1, 255), 1)
@timeout_option
@bus_option
@json_option
def record_signals(
    bus: Bus,
    out: Path,
    names: tuple[str, ...],
    seconds: float | None,
    event: str,
    every: int,
    timeout_s: float,
    as_json: bool,
) -> None:
    """Record signals into OUT: .parquet, .csv, .mf4 or .mcap. All of a sample is of one epoch."""
    from rrins.firmware_py.xcp.daq import EventChannel
    from rrins.host_tools.xcp.recording import record
    from rrins.host_tools.xcp.signals import signals_of
    from rrins.host_tools.xcp.writing import write, writer_of

    writer_of(out)
    signals = signals_of(names)
    channel = EventChannel[event.upper()]
    with _master(bus, timeout_s) as master, as_event() as stopped:
        total = None if seconds is None else round(seconds)
        with counting("recording", total, as_json) as on_progress:
            recording = record(
                master, signals, seconds, channel, every,
                stopped.is_set, lambda passed_s: on_progress(round(passed_s)),
            )  # fmt: skip
    write(recording, out)
    share = 100 * recording.bus_share
    line = f"{out}: {recording.count} samples of {len(signals)} signals, bus load {share:.1f} %"
    summary = {
        "samples": recording.count,
        "signals": len(signals),
        "overloads": recording.overloads,
        "torn": recording.torn,
        "bus_share": recording.bus_share,
    }
    print_results(as_json, summary, [line])
    if recording.overloads or recording.torn:
        print_note(
            "samples are missing: the computer's share of the bus is used up; record fewer "
            "signals, or every other epoch (--every 2), or raise xcp.frames_hz"
        )


@xcp.command("a2l")
@click.argument("out", metavar="OUT", type=FILE)
@option(
    "--scenario",
    "Write the file for a scenario, without a bus.",
    shell_complete=complete_scenarios,
)
@timeout_option
@bus_option
def write_a2l(bus: Bus, out: Path, scenario: str | None, timeout_s: float) -> None:
    """Write the A2L file: fetched from the computer, or made for a scenario."""
    from rrins.host_tools.files import write_text

    if scenario is None:
        with _master(bus, timeout_s) as master:
            text = master.a2l()
    else:
        from rrins.firmware_py.xcp.a2l import a2l_text
        from rrins.host_tools.scenario.scenario import load

        text = a2l_text(load(scenario).period_ns)
    write_text(out, text)
    measured, parameters = (text.count(f"/begin {k} ") for k in ("MEASUREMENT", "CHARACTERISTIC"))
    print_results(False, {}, [f"{out}: {measured} measurements, {parameters} parameters"])
