"""A run of a scenario from start to end: simulated in this process, or rehearsed as two."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rrins.compiled.compile_events import compiling_watched
from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.firmware_py.serial.settings import NO_LINES, SerialSettings
from rrins.host_tools import interruption
from rrins.host_tools.bridges import slcan
from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.bus.channel import HostedError, Reservation
from rrins.host_tools.errors import FirmwareFaultError, RehearsalError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import check_path
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.programs.own_hardware import check_faults
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.runs.rehearsal import (
    CHANNEL,
    Interrupted,
    OnReport,
    Rehearsal,
    Start,
    default_address,
)
from rrins.host_tools.runs.results.outcome import Outcome
from rrins.host_tools.runs.results.results import Errors, compare, read_samples_of
from rrins.host_tools.runs.results.samples import SamplesError
from rrins.host_tools.runs.results.seconds_log import Seconds, take_seconds
from rrins.host_tools.runs.results.stalls import stall_words
from rrins.host_tools.runs.results.summary import summarise, write_results
from rrins.host_tools.runs.results.summary_types import AnySummary, Summary
from rrins.host_tools.runs.set_up.settings import (
    check_files,
    firmware_settings,
    hardware_settings,
    scenario_wire,
)
from rrins.host_tools.runs.sides.job import check_code_folder, prepare_firmware, prepare_hardware
from rrins.host_tools.runs.sides.starting import start_program
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.serial.arguments import arguments_of
from rrins.host_tools.terminal import new_console
from rrins.host_tools.wire.fault_kinds import FaultKind

_ATTEMPTS = 5
_PROBE_S = 60.0  # simulated
_BEFORE_START = ("compiling", "note")


@dataclass(frozen=True)
class RunResult:
    """Results of a run."""

    name: str  #: of the scenario
    scenario: Scenario
    #: one object with the same keys whichever way it was run; see `docs/scenarios.md`.
    summary: Summary
    errors: Errors  #: navigation minus truth
    navigation: Records[NavigationOutput]  #: at 10 Hz or less
    truth: Records[Truth]  #: in the same epochs
    failure: RehearsalError | None  #: why the run did not come to its end, or went wrong beside it
    #: parity and residuals of the sensors that are compared, and what the estimator knew
    seconds: Seconds

    @property
    def title(self) -> str:
        """Title of the tables and pictures of the run."""
        return self.scenario.title or self.name

    def write(self, folder: Path) -> list[Path]:
        """Write summary, errors and pictures into a folder; return their paths.

        Raises
        ------
        RehearsalError
            When one cannot be written.
        """
        return write_results(folder, self.summary, self.errors, self.title, self.seconds)

    def check(self) -> None:
        """Raise what went wrong.

        Raises
        ------
        RehearsalError
            `failure`.
        FirmwareFaultError
            When the firmware never navigated, or ended in FAULT.
        """
        if self.failure is not None:
            raise self.failure
        firmware = self.summary["firmware"]
        fault = firmware.get("fault", "NONE")
        stall = self.summary["stall"]
        why = "" if stall is None else f"; {stall_words(stall)}"
        if not firmware.get("epochs_navigated"):
            raise FirmwareFaultError(f"the firmware never navigated{_reason(firmware)}{why}")
        if fault != "NONE":
            raise FirmwareFaultError(f"the firmware ended in FAULT: {fault}{why}")


def _reason(firmware: AnySummary) -> str:
    fault = firmware.get("fault", "NONE")
    if fault != "NONE":
        return f": {fault}"
    faults = [f"{name} {count}" for name, count in firmware.get("faults", {}).items() if count]
    return f"; counted: {', '.join(faults)}" if faults else ""


def _result(
    name: str, scenario: Scenario, way: str, folder: Path, outcome: Outcome, stopped: str | None
) -> RunResult:
    """Return what the sides left in a folder, and remove their samples from there."""
    navigation, truth = read_samples_of(folder)
    errors = compare(navigation, truth, scenario.rate_hz)
    summary = summarise(name, scenario, way, outcome, errors, stopped)
    seconds = take_seconds(folder)
    return RunResult(name, scenario, summary, errors, navigation, truth, outcome.failure, seconds)


def folder_of(out: Path | None, name: str) -> Path:
    """Return the folder of a run, made if need be.

    Raises
    ------
    RehearsalError
        When it cannot be made.
    """
    folder = out if out is not None else Path("out") / Path(name).stem
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be made: {error.strerror}") from error
    return folder


def _samples_in(folder: Path | None) -> AbstractContextManager[str]:
    """Return where the sides put their samples: a folder that stays, or one for the run alone."""
    if folder is not None:
        return nullcontext(str(folder))
    return tempfile.TemporaryDirectory(prefix="rrins-")


@dataclass(frozen=True)
class Overrides:
    """Differences from the scenario's file."""

    duration_s: float | None = None
    seed: int | None = None

    def options(self) -> tuple[str, ...]:
        """Return the command-line options that say so."""
        named = (("duration", self.duration_s), ("seed", self.seed))
        return tuple(f"--{name}={value!r}" for name, value in named if value is not None)


@dataclass(frozen=True)
class BusOptions:
    """The bus as the options name it."""

    interface: str = "rrins"
    channel: str | None = None
    bitrate: int | None = None

    def address(self) -> Address:
        """Return the bus that is meant; a free channel where none is named."""
        return default_address(self.interface, self.channel, self.bitrate)

    @property
    def is_free_to_choose(self) -> bool:
        """Whether any channel of the embedded bus will do."""
        return self.interface == EMBEDDED and self.channel is None

    @contextmanager
    def reserved(self) -> Iterator[Address]:
        """Give the bus that is meant; a free channel stays reserved until the end."""
        if not self.is_free_to_choose:
            yield self.address()
            return
        with Reservation(CHANNEL) as reservation:
            yield replace(self, channel=reservation.channel).address()


@dataclass(frozen=True)
class Plan:
    """A rehearsal to run: scenario, bus, speed, programs."""

    name: str  #: Built-in scenario or file: both sides load it themselves
    scenario: Scenario  #: the same, with `overrides` applied
    overrides: Overrides = Overrides()
    bus: BusOptions = BusOptions()
    #: 1.0 is real time, another factor limits lockstep, None is as fast as it goes
    speed: float | None = None
    serial: SerialSettings = NO_LINES  #: the firmware's serial lines
    #: whether others on the embedded bus may send what the contract gives to a side
    foreign_senders: bool = False
    timestamps: Literal["bus", "unix"] = "bus"  #: time of the frames in a recording
    firmware: Program | None = None  #: the user's own program as the firmware
    #: longest silence of a program of the user's in wall clock time; 0 waits for ever
    patience_s: float = 10.0
    #: file by which somebody steers how fast it goes (`rrins.host_tools.runs.sides.steering`).
    steer: Path | None = None
    hardware: Program | None = None  #: the user's own program as the sensors and the table
    restarts: int = 0  #: how often the user's firmware is started again when it fails

    def lasting(self, duration_s: float) -> Plan:
        """Return the same with another duration."""
        return replace(
            self,
            scenario=self.scenario.model_copy(update={"duration_s": duration_s}),
            overrides=replace(self.overrides, duration_s=duration_s),
        )

    def _hardware_options(self) -> tuple[str, ...]:
        options = ["--foreign-senders"] if self.foreign_senders else []
        if self.steer is not None:
            options += ["--steer", str(self.steer)]
        if self.hardware is not None:
            options += ["--program", str(self.hardware), "--patience", f"{self.patience_s:g}"]
        return tuple(options)

    def _firmware(self) -> Program | None:
        """Return the program that is the firmware: ours, too, where a fault takes its power."""
        loses_power = any(fault.kind == FaultKind.POWER_OFF.word for fault in self.scenario.faults)
        if self.firmware is not None or not loses_power:
            return self.firmware
        words = (self.name, *self.overrides.options(), *arguments_of(self.serial))
        return Program((sys.executable, "-m", "rrins", "firmware", *words), "rrins firmware")

    def rehearsal(
        self, address: Address, folder: Path, record: Path | None, start: Start
    ) -> Rehearsal:
        """Return the rehearsal, ready to run."""
        return Rehearsal(
            self.name,
            self.scenario,
            self.overrides.options(),
            address,
            self.speed,
            folder,
            record,
            arguments_of(self.serial),
            self._hardware_options(),
            start,
            self.timestamps,
            self._firmware(),
            self.patience_s if self.firmware is not None else 0.0,  # ours may compile
            self.restarts,
        )


def check(plan: Plan, record: Path | None = None) -> Address:
    """Return the bus of a plan, when everything that it names is there.

    Raises
    ------
    RehearsalError
        One line: what cannot be had, or cannot be written.
    """
    if record is not None:
        check_path(record)
    check_files(plan.scenario)
    if plan.restarts and plan.firmware is None:
        raise RehearsalError("--restart is for a program of your own: name it with --firmware")
    if plan.hardware is not None:
        check_faults(plan.hardware, plan.scenario)
    check_code_folder()
    address = plan.bus.address()
    slcan.refuse_one_for_two(address)
    return address


def _run(
    plan: Plan,
    folder: Path,
    record: Path | None,
    on_report: OnReport,
    on_bus: Callable[[Address], None] = lambda address: None,
    start: Start = start_program,
) -> tuple[Address, Outcome]:
    """Run both sides; return where, and what came of it.

    Both sides may compile for a minute before they open the bus. If no channel was asked for and
    somebody who asked for just the free one has taken it meanwhile, they begin again on another.
    """
    for attempt in range(1, _ATTEMPTS + 1):
        with plan.bus.reserved() as address:
            on_bus(address)
            outcome = plan.rehearsal(address, folder, record, start).run(on_report)
        is_taken = isinstance(outcome.failure, HostedError) and not outcome.hardware
        if not (is_taken and plan.bus.is_free_to_choose) or attempt == _ATTEMPTS:
            break
    return address, outcome


def fit(plan: Plan, limit_s: float) -> Plan:
    """Return the plan, shortened to whole cycles of the scheme if it would take too long.

    A short rehearsal on the same bus measures how long it would take.
    """
    probe = plan.lasting(min(_PROBE_S, plan.scenario.duration_s))
    probe = replace(probe, serial=NO_LINES)
    with (
        tempfile.TemporaryDirectory(prefix="rrins-") as folder,
        RunDisplay(probe.scenario, new_console(stderr=True)) as display,
    ):
        display.say("measuring the speed")
        _, outcome = _run(
            probe,
            Path(folder),
            None,
            lambda report: display.report(report) if report["kind"] in _BEFORE_START else None,
        )
    if outcome.failure is not None:
        raise outcome.failure
    expected_s = outcome.wall_s * plan.scenario.epochs / probe.scenario.epochs
    if expected_s <= limit_s:
        return plan
    cycle_s = plan.scenario.scheme.cycle_s
    cycles = max(1, int(plan.scenario.duration_s * limit_s / expected_s / cycle_s))
    return plan.lasting(min(plan.scenario.duration_s, cycles * cycle_s))


def rehearse(
    plan: Plan,
    display: RunDisplay,
    folder: Path | None = None,
    record: Path | None = None,
    name: str | None = None,
    start: Start = start_program,
    on_started: Callable[[], None] = lambda: None,
) -> RunResult:
    """Rehearse: both sides as processes on one bus.

    Parameters
    ----------
    display : RunDisplay
        Shows progress; entered.
    folder : Path, optional
        Where the sides put their samples as they run.
    record : Path, optional
        Log of the bus, in the format that its ending names.
    name : str, optional
        What the scenario is called in the results; the plan's without it.
    start : callable, optional
        Starts a side (`rrins.host_tools.runs.sides.starting`).
    on_started : callable, optional
        Called when both sides run.

    Raises
    ------
    RehearsalError
        When the rehearsal cannot begin. What goes wrong later is the result's `failure`.
    """

    def on_report(report: JsonObject) -> None:
        display.report(report)
        if report["kind"] == "started":
            on_started()

    check(plan, record)
    with _samples_in(folder) as samples:
        address, outcome = _run(
            plan,
            Path(samples),
            record,
            on_report,
            lambda address: display.say(f"starting on {address}"),
            start,
        )
        failed_beside = outcome.failure is None or isinstance(outcome.failure, RecordError)
        stopped = None if failed_beside else str(outcome.failure)
        result = _result(
            name or plan.name, plan.scenario, address.interface, Path(samples), outcome, stopped
        )
    result.summary["speed"] = "max" if plan.speed is None else plan.speed
    return result


def simulate(
    name: str,
    scenario: Scenario,
    display: RunDisplay,
    folder: Path | None = None,
    with_frames: bool = False,
    serial: SerialSettings = NO_LINES,
) -> RunResult:
    """Run both sides in this process, without a bus.

    Parameters
    ----------
    name : str
        Of the scenario.
    display : RunDisplay
        Shows progress; entered.
    folder : Path, optional
        Where the sides put their samples as they run.
    with_frames : bool
        Whether frames are passed even if nothing requires them; faults on the wire and serial
        lines do.
    serial : SerialSettings
        The firmware's NMEA output.

    Raises
    ------
    RehearsalError
        When the run cannot begin. What goes wrong later is the result's `failure`.
    """
    needs_frames = with_frames or scenario_wire(scenario) is not None or serial.nmea is not None
    display.report({"kind": "preparing", "side": "firmware"})
    check_code_folder()
    with compiling_watched(lambda functions: display.compiling("both sides", functions)):
        if needs_frames:
            prepare_firmware(scenario)
            prepare_hardware(scenario)
        else:
            FastRun.of(firmware_settings(scenario), hardware_settings(scenario)).run(2)
    with interruption.as_event() as stop, _samples_in(folder) as samples:
        display.report({"kind": "started", "side": "hardware"})
        try:
            if needs_frames:
                outcome = run_direct(
                    scenario, Path(samples), display.progress, stop.is_set, serial, display.note
                )
            else:
                outcome = run_without_frames(scenario, Path(samples), display.progress, stop.is_set)
        except SamplesError as error:  # what was written until then is worth a picture
            outcome = Outcome(failure=error)
        if outcome.failure is None and stop.is_set():
            outcome = replace(outcome, failure=Interrupted("stopped by the user"))
        stopped = None if outcome.failure is None else str(outcome.failure)
        way = "direct" if needs_frames else "fast"
        return _result(name, scenario, way, Path(samples), outcome, stopped)
