"""`rrins rehearse`, `simulate`, `firmware` and `hardware`: run both sides, or one."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.options import (
    FILE,
    FOLDER,
    NOT_NEGATIVE,
    POSITIVE,
    Bus,
    Speed,
    bitrate_option,
    flag,
    free_duration_option,
    gathered,
    interface_option,
    json_option,
    noise_seed_option,
    option,
    record_option,
    results_option,
    scenario_argument,
    timestamps_option,
    together,
)
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.cli.run.serial_options import nmea_options, serial_options
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.interruption import INTERRUPTED, heed_nothing, heed_sigterm

if TYPE_CHECKING:
    from rrins.firmware_py.serial.settings import SerialSettings
    from rrins.host_tools.bus.address import Side
    from rrins.host_tools.runs.display import RunDisplay
    from rrins.host_tools.runs.programs.program import Program
    from rrins.host_tools.runs.run import RunResult
    from rrins.host_tools.runs.sides.starting import Command
    from rrins.host_tools.scenario.scenario import Scenario


@dataclass(frozen=True)
class Selection:
    """The scenario that the options select."""

    scenario: str
    duration_s: float | None
    seed: int | None

    def load(self) -> Scenario:
        """Return the scenario."""
        from rrins.host_tools.scenario.scenario import load

        return load(self.scenario, duration_s=self.duration_s, seed=self.seed)


_scenario_options = gathered(
    "selection", Selection, scenario_argument, free_duration_option, noise_seed_option
)
_bus_options = gathered(
    "bus",
    Bus,
    interface_option,
    option("--channel", "Channel of the interface, such as vcan0."),
    bitrate_option,
)
_foreign_option = flag(
    "--foreign-senders",
    "On the embedded bus, accept the messages of a side from any sender; for tests.",
)
_steer_option = click.option("--steer", type=FILE, hidden=True)


def _program(_: click.Context, __: click.Parameter, text: str | None) -> Program | None:
    """Return the program that an option names."""
    from rrins.host_tools.runs.programs.program import Program

    return None if text is None else Program.parse(text)


@click.command()
@_scenario_options
@option(
    "--speed", "1: real time; N: up to N times real time; max: as fast as possible.", Speed(), "max"
)
@_bus_options
@option(
    "--limit limit_s",
    "Limit the run to this many seconds, in whole cycles of the scheme.",
    POSITIVE,
)
@results_option
@record_option
@timestamps_option
@serial_options
@_foreign_option
@option("--firmware", "Your own program as the firmware.", callback=_program)
@option("--hardware", "Your own program as the sensors and the table.", callback=_program)
@option(
    "--patience patience_s",
    "Longest silence of your program; 0 waits forever, for debugging.",
    NOT_NEGATIVE,
    10.0,
)
@option(
    "--restart restarts",
    "Start your firmware again when it fails, at most this many times.",
    click.IntRange(min=0),
    0,
)
@_steer_option
@json_option
@click.pass_obj
def rehearse(
    command: Command | None,
    /,
    selection: Selection,
    speed: float | None,
    bus: Bus,
    limit_s: float | None,
    out: Path | None,
    record: Path | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Run firmware and hardware as two processes on one bus.

    SCENARIO is a built-in name (see `rrins scenarios`) or a TOML file; without one it is
    rimu_rotating. The default is the embedded bus. Ctrl-C stops both sides and keeps the recording.
    If the file of --record exists, it is moved into the folder `previous` beside it.
    """
    from rrins.host_tools.runs import run
    from rrins.host_tools.runs.results.picture_loading import PictureLoading
    from rrins.host_tools.runs.sides.job import REALTIME
    from rrins.host_tools.runs.sides.starting import Forks

    loaded = selection.load()
    heed_sigterm()
    _warn(loaded)
    overrides = run.Overrides(selection.duration_s, selection.seed)
    options = run.BusOptions(bus.interface, bus.channel, bus.bitrate)
    plan = run.Plan(selection.scenario, loaded, overrides, options, speed, **settings)
    if limit_s is not None:
        plan = run.fit(plan, limit_s)
    run.check(plan, record)
    folder = run.folder_of(out, selection.scenario)
    # The forks come first: the display may have a thread.
    with (
        Forks(command) as forks,
        _display(plan.scenario, as_json) as display,
        PictureLoading() as pictures,
    ):
        # In real time a recorder in this process must not wait for an import.
        on_started = pictures.begin if speed != REALTIME else lambda: None
        result = run.rehearse(
            plan, display, folder, record, start=forks.start, on_started=on_started
        )
    _finish(result, folder, as_json)


@click.command()
@_scenario_options
@results_option
@nmea_options
@flag("--frames", "Exchange CAN frames even if nothing requires them.")
@json_option
def simulate(
    selection: Selection, out: Path | None, frames: bool, as_json: bool, serial: SerialSettings
) -> None:
    """Run both sides in one process, without a bus: same steps, same navigation.

    SCENARIO is a built-in name (see `rrins scenarios`) or a TOML file; without one it is
    rimu_rotating.
    """
    from rrins.host_tools.runs import run

    loaded = selection.load()
    heed_sigterm()
    _warn(loaded)
    folder = run.folder_of(out, selection.scenario)
    with _display(loaded, as_json) as display:
        result = run.simulate(selection.scenario, loaded, display, folder, frames, serial)
    _finish(result, folder, as_json)


def _warn(scenario: Scenario) -> None:
    """Print warnings about settings that may surprise."""
    from rrins.host_tools.runs.set_up.load_warnings import warnings_of

    for warning in warnings_of(scenario):
        print_note(f"warning: {warning}")


def _display(scenario: Scenario, quiet: bool) -> RunDisplay:
    """Return the progress display of a run, on standard error."""
    from rrins.host_tools.runs.display import RunDisplay
    from rrins.host_tools.terminal import new_console

    return RunDisplay(scenario, new_console(stderr=True), quiet)


def _finish(result: RunResult, folder: Path, as_json: bool) -> None:
    """Show and write the results, then raise the error of the run, if any.

    The table comes before the pictures, which take longer than a short run; JSON after them.
    """
    from rrins.host_tools.runs.results.keeping import place_for
    from rrins.host_tools.runs.results.summary import lines_of, table_of

    summary = result.summary
    if not as_json:
        table = [table_of(summary)] if len(result.errors) else []
        print_results(False, summary, [*table, *(lines_of(summary) if summary["epochs"] else ())])
    failure: RehearsalError | None = None
    paths: list[Path] = []
    try:
        place, note = place_for(folder, summary)
        if note is not None:
            print_note(note)
        paths = result.write(place)
    except RehearsalError as error:
        failure = error
    if as_json or summary["epochs"]:
        print_results(as_json, summary, (f"  {path}" for path in paths))
    if failure is not None and result.failure is None:
        raise failure
    result.check()


_side_options = together(
    _scenario_options,
    option("--speed", "Must match the other side.", Speed(), "1"),
    _bus_options,
    json_option,
    click.option("--log", "folder", type=FOLDER, hidden=True),
    click.option("--report-fd", type=int, hidden=True),
    click.option("--core", type=int, hidden=True),
)


@click.command()
@_side_options
@serial_options
@click.option(
    "--attach-wait",
    "attach_wait_s",
    type=float,
    default=0.0,
    help="Wait up to this many seconds for the bus.",
)
@option(
    "--parameters",
    "Parameter memory; created if missing. Its values override the scenario's.",
    FILE,
)
@click.option("--setup", hidden=True, expose_value=False)  # given to any program by a rehearsal
def firmware(**options: Any) -> None:
    """Run the navigation computer alone, on the hardware's bus.

    SCENARIO is as for `rrins rehearse`, rimu_rotating by default, and the same on both sides.
    """
    _run_side("firmware", **options)


@click.command()
@_side_options
@_foreign_option
@_steer_option
@click.option("--await-peer", "await_peers", multiple=True, hidden=True)
@click.option("--follow", hidden=True)
@click.option("--patience", "patience_s", type=float, default=0.0, hidden=True)
@option("--program", "Your own program as the sensors and the table.", callback=_program)
@flag("--keep", "Go on when the firmware has gone, and take the next one that comes.")
def hardware(**options: Any) -> None:
    """Run the emulated RIMU and turntable alone; it hosts the embedded bus.

    SCENARIO is as for `rrins rehearse`, rimu_rotating by default, and the same on both sides.
    """
    _run_side("hardware", **options)


def _run_side(
    side: Side, selection: Selection, speed: float | None, bus: Bus, as_json: bool, **job: Any
) -> None:
    from rrins.host_tools.runs.results.pipe import NoteHandler, ReportPipe
    from rrins.host_tools.runs.side import check_line, run_side
    from rrins.host_tools.runs.sides.job import REALTIME, Job

    report_fd = job["report_fd"]
    if report_fd is not None:  # errors go into the report, not into a log as well
        logging.getLogger().setLevel(logging.CRITICAL)
        of_code = logging.getLogger("rrins.compiled")
        of_code.setLevel(logging.WARNING)
        of_code.propagate = False
        of_code.addHandler(NoteHandler(ReportPipe(report_fd), side))
    try:
        heed_sigterm()
        loaded = selection.load()
        address = bus.address()
        own = Job(loaded, address, speed, **job)
        check_line(side, own)
        if report_fd is None:
            _warn(loaded)
            kind = "real time" if speed == REALTIME else "lockstep"
            print_note(f"{side} on {address}, {kind}; Ctrl-C stops")
        summary = run_side(side, own)
        if as_json or report_fd is None:
            lines = (f"{key:>18}: {value}" for key, value in summary.items())
            print_results(as_json, summary, lines)
    except RehearsalError as error:
        if report_fd is None:
            raise
        heed_nothing()  # the rehearsal ends both sides, for the same reason perhaps
        ReportPipe(report_fd).fail(side, error)
        sys.exit(error.exit_status)
    except BrokenPipeError:  # the rehearsal has ended
        sys.exit(RehearsalError.exit_status)
    except KeyboardInterrupt:
        if report_fd is None:
            raise
        sys.exit(INTERRUPTED)
