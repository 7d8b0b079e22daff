"""What the commands do: run, collect, write, show."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from host_tools import sides
from host_tools.direct import run_direct
from host_tools.display import RunDisplay
from host_tools.errors import RehearsalError
from host_tools.port import Address
from host_tools.rehearsal import Interrupted, Rehearsal, default_address
from host_tools.report import Report
from host_tools.results import Errors
from host_tools.scenario import Scenario
from host_tools.summary import collect, lines_of, summarise, table_of, write_results


@dataclass(frozen=True)
class Bus:
    """The bus as the options name it."""

    interface: str
    channel: str | None
    bitrate: int | None


def _folder(out: Path | None, name: str) -> Path:
    """Return the folder of a run, made if need be."""
    folder = out if out is not None else Path("out") / Path(name).stem
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be made: {error.strerror}") from error
    return folder


def _finish(
    summary: dict[str, Any],
    errors: Errors,
    folder: Path,
    title: str,
    as_json: bool,
    failure: RehearsalError | None,
) -> None:
    """Write and show what came out, then raise what went wrong."""
    paths = write_results(folder, summary, errors, title)
    if as_json:
        click.echo(json.dumps(summary))
    elif len(errors):
        console = Console()
        console.print(table_of(summary))
        for line in lines_of(summary):
            console.print(line, highlight=False, soft_wrap=True)
        for path in paths:
            console.print(f"  {path}", highlight=False, soft_wrap=True)
    if failure is not None:
        raise failure


def rehearse(
    name: str,
    scenario: Scenario,
    overrides: tuple[str, ...],
    bus: Bus,
    speed: float | None,
    out: Path | None,
    record: Path | None,
    as_json: bool,
) -> None:
    """Do `rrins rehearse`."""
    address = default_address(bus.interface, bus.channel, bus.bitrate)
    folder = _folder(out, name)
    rehearsal = Rehearsal(name, scenario, overrides, address, speed, folder, record)
    console = Console(stderr=True)
    with RunDisplay(scenario, console, quiet=as_json) as display:
        display.say(f"starting on {address}")
        outcome = rehearsal.run(display.report)
    errors = collect(folder, scenario.rate_hz)
    stopped = None if outcome.failure is None else str(outcome.failure)
    summary = summarise(
        name,
        scenario,
        address.interface,
        outcome.wall_s,
        outcome.firmware,
        outcome.hardware,
        errors,
        stopped,
    )
    summary["speed"] = "max" if speed is None else speed
    _finish(summary, errors, folder, scenario.title or name, as_json, outcome.failure)


def simulate(name: str, scenario: Scenario, out: Path | None, as_json: bool) -> None:
    """Do `rrins simulate`."""
    folder = _folder(out, name)
    console = Console(stderr=True)
    failure: RehearsalError | None = None
    firmware: dict[str, Any] = {}
    hardware: dict[str, Any] = {}
    with RunDisplay(scenario, console, quiet=as_json) as display:
        start = time.monotonic()
        try:
            display.report({"kind": "preparing", "side": "firmware"})
            sides.prepare_firmware(scenario)
            sides.prepare_hardware(scenario)
            display.report({"kind": "started", "side": "hardware"})
            start = time.monotonic()
            firmware, hardware, _ = run_direct(scenario, folder, display.progress)
        except KeyboardInterrupt:
            failure = Interrupted("stopped by the user")
        wall_s = time.monotonic() - start
    errors = collect(folder, scenario.rate_hz)
    stopped = None if failure is None else str(failure)
    summary = summarise(name, scenario, "direct", wall_s, firmware, hardware, errors, stopped)
    _finish(summary, errors, folder, scenario.title or name, as_json, failure)


def run_side(
    side: str, scenario: Scenario, bus: Bus, speed: float | None, as_json: bool, **job: Any
) -> None:
    """Do `rrins firmware` or `rrins hardware`."""
    address = default_side_address(bus)
    run = {"firmware": sides.run_firmware, "hardware": sides.run_hardware}[side]
    if job["report_fd"] is None:
        kind = "real time" if speed == sides.REALTIME else "lockstep"
        click.echo(f"rrins: {side} on {address}, {kind}; Ctrl-C stops", err=True)
    summary = run(sides.Job(scenario, address, speed, **job))
    if as_json:
        click.echo(json.dumps(summary))
    elif job["report_fd"] is None:
        for key, value in summary.items():
            click.echo(f"{key:>18}: {value}")


def default_side_address(bus: Bus) -> Address:
    """Return the bus of a side alone: both sides must mean the same one by default."""
    channel = bus.channel
    if channel is None and bus.interface == "rrins":
        channel = "rrins0"
    return default_address(bus.interface, channel, bus.bitrate)


def report_error(report_fd: int, side: str, error: RehearsalError) -> None:
    """Tell the rehearsal why a side fails."""
    Report(report_fd).send("error", side=side, message=str(error), exit_status=error.exit_status)
