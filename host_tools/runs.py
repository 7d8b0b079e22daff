"""What the commands do: run, collect, write, show."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from firmware_py.serial_lines import NO_LINES, SerialSettings
from host_tools import interruption, sides
from host_tools.direct import run_direct, run_without_frames
from host_tools.display import RunDisplay
from host_tools.errors import FirmwareFaultError, RehearsalError
from host_tools.fast import FastRun
from host_tools.logs.errors import RecordError
from host_tools.logs.formats import check_path
from host_tools.outfit import check_files, firmware_settings, hardware_settings, scenario_wire
from host_tools.port import Address, Side
from host_tools.rehearsal import Interrupted, Rehearsal, default_address
from host_tools.report import Report
from host_tools.results import Errors
from host_tools.rows import RowsError
from host_tools.scenario import Scenario
from host_tools.serial import slcan
from host_tools.serial.options import arguments_of
from host_tools.summary import collect, lines_of, summarise, table_of, write_results

_PROBE_S = 60.0  # simulated


def _why(firmware: dict[str, Any]) -> str:
    fault = firmware.get("fault", "NONE")
    if fault != "NONE":
        return f": {fault}"
    faults = [f"{name} {count}" for name, count in firmware.get("faults", {}).items() if count]
    return f"; counted: {', '.join(faults)}" if faults else ""


@dataclass(frozen=True)
class Bus:
    """The bus as the options name it."""

    interface: str
    channel: str | None
    bitrate: int | None


def folder_of(out: Path | None, name: str) -> Path:
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
    paths: list[Path] = []
    try:
        paths = write_results(folder, summary, errors, title)
    except RehearsalError as error:
        failure = failure or error
    if as_json:
        click.echo(json.dumps(summary))
    else:
        console = Console()
        if len(errors):
            console.print(table_of(summary))
        for line in lines_of(summary) if summary["epochs"] else ():
            console.print(line, highlight=False, soft_wrap=True)
        for path in paths if summary["epochs"] else ():
            console.print(f"  {path}", highlight=False, soft_wrap=True)
    if failure is not None:
        raise failure
    if not summary["firmware"].get("epochs_navigated"):
        raise FirmwareFaultError(f"the firmware never navigated{_why(summary['firmware'])}")
    if summary["firmware"].get("fault", "NONE") != "NONE":
        raise FirmwareFaultError(f"the firmware ended in FAULT: {summary['firmware']['fault']}")


@dataclass(frozen=True)
class Overrides:
    """By what a run differs from its scenario's file."""

    duration_s: float | None = None
    seed: int | None = None

    def options(self) -> tuple[str, ...]:
        """Return the command-line options that say so."""
        named = (("duration", self.duration_s), ("seed", self.seed))
        return tuple(f"--{name}={value!r}" for name, value in named if value is not None)


@dataclass(frozen=True)
class Plan:
    """What is to be rehearsed, and how."""

    name: str
    scenario: Scenario
    overrides: Overrides
    bus: Bus
    speed: float | None
    serial: SerialSettings = NO_LINES

    def lasting(self, duration_s: float) -> Plan:
        """Return the same with another duration."""
        return replace(
            self,
            scenario=self.scenario.model_copy(update={"duration_s": duration_s}),
            overrides=replace(self.overrides, duration_s=duration_s),
        )

    def rehearsal(self, address: Address, folder: Path, record: Path | None) -> Rehearsal:
        """Return the rehearsal, ready to run."""
        options = self.overrides.options()
        serial = arguments_of(self.serial)
        return Rehearsal(
            self.name, self.scenario, options, address, self.speed, folder, record, serial
        )


def fit(plan: Plan, limit_s: float) -> Plan:
    """Return the plan, shortened to whole cycles of the scheme if it would take too long.

    How long it would take is measured by a short rehearsal on the same bus.
    """
    address = default_address(plan.bus.interface, plan.bus.channel, plan.bus.bitrate)
    probe = plan.lasting(min(_PROBE_S, plan.scenario.duration_s))
    probe = replace(probe, serial=NO_LINES)
    with (
        tempfile.TemporaryDirectory(prefix="rrins-") as folder,
        RunDisplay(probe.scenario, Console(stderr=True)) as display,
    ):
        display.say("measuring the speed (the first start compiles, some 30 s)")
        outcome = probe.rehearsal(address, Path(folder), None).run(lambda report: None)
    if outcome.failure is not None:
        raise outcome.failure
    expected_s = outcome.wall_s * plan.scenario.epochs / probe.scenario.epochs
    if expected_s <= limit_s:
        return plan
    cycle_s = plan.scenario.scheme.cycle_s
    cycles = max(1, int(plan.scenario.duration_s * limit_s / expected_s / cycle_s))
    return plan.lasting(min(plan.scenario.duration_s, cycles * cycle_s))


def rehearse(plan: Plan, out: Path | None, record: Path | None, as_json: bool) -> None:
    """Do `rrins rehearse`."""
    if record is not None:
        check_path(record)
    check_files(plan.scenario)
    address = default_address(plan.bus.interface, plan.bus.channel, plan.bus.bitrate)
    slcan.refuse_one_for_two(address)
    folder = folder_of(out, plan.name)
    scenario = plan.scenario
    with RunDisplay(scenario, Console(stderr=True), quiet=as_json) as display:
        display.say(f"starting on {address}")
        outcome = plan.rehearsal(address, folder, record).run(display.report)
    errors = collect(folder, scenario.rate_hz)
    failed_beside = outcome.failure is None or isinstance(outcome.failure, RecordError)
    stopped = None if failed_beside else str(outcome.failure)
    summary = summarise(
        plan.name,
        scenario,
        address.interface,
        outcome.wall_s,
        outcome.firmware,
        outcome.hardware,
        errors,
        stopped,
    )
    summary["speed"] = "max" if plan.speed is None else plan.speed
    _finish(summary, errors, folder, scenario.title or plan.name, as_json, outcome.failure)


def simulate(
    name: str,
    scenario: Scenario,
    out: Path | None,
    as_json: bool,
    frames: bool = False,
    serial: SerialSettings = NO_LINES,
) -> None:
    """Do `rrins simulate`: without frames where nothing needs them."""
    folder = folder_of(out, name)
    with (
        interruption.as_event() as stop,
        RunDisplay(scenario, Console(stderr=True), quiet=as_json) as display,
    ):
        display.report({"kind": "preparing", "side": "firmware"})
        # Faults act on frames, serial lines at epochs.
        needs_frames = frames or scenario_wire(scenario) is not None or serial.nmea is not None
        if needs_frames:
            sides.prepare_firmware(scenario)
            sides.prepare_hardware(scenario)
        else:
            FastRun.of(firmware_settings(scenario), hardware_settings(scenario)).run(2)
        display.report({"kind": "started", "side": "hardware"})
        failure: RehearsalError | None = None
        try:
            if needs_frames:
                firmware, hardware, wall_s = run_direct(
                    scenario, folder, display.progress, stop.is_set, serial, display.note
                )
            else:
                firmware, hardware, wall_s = run_without_frames(
                    scenario, folder, display.progress, stop.is_set
                )
        except RowsError as error:  # what was written until then is worth a picture
            failure, firmware, hardware, wall_s = error, {}, {}, 0.0
    if failure is None and stop.is_set():
        failure = Interrupted("stopped by the user")
    errors = collect(folder, scenario.rate_hz)
    stopped = None if failure is None else str(failure)
    summary = summarise(
        name,
        scenario,
        "direct" if needs_frames else "fast",
        wall_s,
        firmware,
        hardware,
        errors,
        stopped,
    )
    _finish(summary, errors, folder, scenario.title or name, as_json, failure)


def run_side(
    side: Side, scenario: Scenario, bus: Bus, speed: float | None, as_json: bool, **job: Any
) -> None:
    """Do `rrins firmware` or `rrins hardware`."""
    address = default_side_address(bus)
    warning = slcan.too_slow(address, scenario, side)
    if warning is not None and speed == sides.REALTIME:
        Report(job["report_fd"]).note(side, warning)
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
