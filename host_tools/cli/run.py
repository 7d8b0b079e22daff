"""`rrins rehearse`, `simulate`, `firmware` and `hardware`: run both sides, or one."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.numbers import BIT_RATE, NumberRange
from rrins.host_tools.cli.options import timestamps_option
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.cli.serial_options import nmea_options, serial_options, settings_of
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.interruption import INTERRUPTED, heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.bus.port import Side
    from rrins.host_tools.files import JsonObject
    from rrins.host_tools.runs.display import RunDisplay
    from rrins.host_tools.runs.run import RunResult
    from rrins.host_tools.runs.sides.starting import Command
    from rrins.host_tools.scenario.scenario import Scenario

DEFAULT_SCENARIO = "rimu_rotating"


class _Speed(click.ParamType[float | None]):
    """1 for real time; another factor, or `max`, for lockstep."""

    name = "1|N|max"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | None:
        if value == "max" or value is None:
            return None
        try:
            speed = float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number nor 'max'", param, ctx)
        if not 0 < speed < 1e9:
            self.fail(f"{value} is not greater than 0", param, ctx)
        return speed


def _options(*options: Callable[..., Any]) -> Callable[..., Any]:
    """Return one decorator that applies several."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


_scenario_options = _options(
    click.argument(
        "scenario",
        default=DEFAULT_SCENARIO,
        metavar="[SCENARIO]",
        shell_complete=complete_scenarios,
    ),
    click.option("--duration", "duration_s", type=float, help="Navigate for this many seconds."),
    click.option("--seed", type=int, help="Seed of the sensor noise."),
)
_bus_options = _options(
    click.option("--interface", default="rrins", show_default=True, help="python-can interface."),
    click.option("--channel", help="Channel of the interface, such as vcan0."),
    click.option("--bitrate", type=BIT_RATE, help="Bit rate, if the interface sets it."),
)
_out_option = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the results.  [default: out/SCENARIO]",
)
_foreign_option = click.option(
    "--foreign-senders",
    is_flag=True,
    help="On the embedded bus, accept the messages of a side from any sender; for tests.",
)
_steer_option = click.option(
    "--steer", type=click.Path(dir_okay=False, path_type=Path), hidden=True
)
_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


@click.command()
@_scenario_options
@click.option(
    "--speed",
    type=_Speed(),
    default="max",
    show_default=True,
    help="1: real time; N: up to N times real time; max: as fast as possible.",
)
@_bus_options
@click.option(
    "--limit",
    "limit_s",
    type=NumberRange(min=0, min_open=True),
    help="Limit the run to this many seconds, in whole cycles of the scheme.",
)
@_out_option
@click.option(
    "--record", type=click.Path(dir_okay=False, path_type=Path), help="Record the bus to this file."
)
@timestamps_option
@serial_options
@_foreign_option
@click.option("--firmware", "program", help="Your own program as the firmware.")
@click.option("--hardware", "model", help="Your own program as the sensors and the table.")
@click.option(
    "--patience",
    "patience_s",
    type=NumberRange(min=0),
    default=10.0,
    show_default=True,
    help="Longest silence of your program; 0 waits forever, for debugging.",
)
@_steer_option
@_json_option
@click.pass_obj
def rehearse(
    command: Command | None,
    /,
    scenario: str,
    duration_s: float | None,
    seed: int | None,
    speed: float | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    limit_s: float | None,
    out: Path | None,
    record: Path | None,
    timestamps: Literal["bus", "unix"],
    foreign_senders: bool,
    program: str | None,
    model: str | None,
    patience_s: float,
    steer: Path | None,
    as_json: bool,
    **serial: Any,
) -> None:
    """Run firmware and hardware as two processes on one bus.

    SCENARIO is a built-in name (see `rrins scenarios`) or a TOML file; without one it is
    rimu_rotating. The default is the embedded bus. Ctrl-C stops both sides and keeps the recording.
    If the file of --record exists, it is moved into the folder `previous` beside it.
    """
    from rrins.host_tools.runs import run
    from rrins.host_tools.runs.programs.program import Program
    from rrins.host_tools.runs.results.picture_loading import PictureLoading
    from rrins.host_tools.runs.sides.job import REALTIME
    from rrins.host_tools.runs.sides.starting import Forks
    from rrins.host_tools.scenario.scenario import load

    loaded = load(scenario, duration_s=duration_s, seed=seed)
    heed_sigterm()
    _warn(loaded)
    plan = run.Plan(
        scenario,
        loaded,
        run.Overrides(duration_s, seed),
        run.BusOptions(interface, channel, bitrate),
        speed,
        settings_of(serial),
        foreign_senders,
        timestamps,
        None if program is None else Program.parse(program),
        patience_s,
        steer,
        None if model is None else Program.parse(model),
    )
    if limit_s is not None:
        plan = run.fit(plan, limit_s)
    run.check(plan, record)
    folder = run.folder_of(out, scenario)
    # The forks come first: the display may have a thread.
    with (
        Forks(command) as forks,
        _display(plan.scenario, as_json) as display,
        PictureLoading() as pictures,
    ):
        # In real time a recorder in this process must not wait for an import.
        on_started = pictures.begin if speed != REALTIME else _nothing
        result = run.rehearse(
            plan, display, folder, record, start=forks.start, on_started=on_started
        )
    _finish(result, folder, as_json)


@click.command()
@_scenario_options
@_out_option
@nmea_options
@click.option("--frames", is_flag=True, help="Exchange CAN frames even if nothing requires them.")
@_json_option
def simulate(
    scenario: str,
    duration_s: float | None,
    seed: int | None,
    out: Path | None,
    frames: bool,
    as_json: bool,
    **serial: Any,
) -> None:
    """Run both sides in one process, without a bus: same steps, same navigation.

    SCENARIO is a built-in name (see `rrins scenarios`) or a TOML file; without one it is
    rimu_rotating.
    """
    from rrins.host_tools.runs import run
    from rrins.host_tools.scenario.scenario import load

    loaded = load(scenario, duration_s=duration_s, seed=seed)
    heed_sigterm()
    _warn(loaded)
    folder = run.folder_of(out, scenario)
    with _display(loaded, as_json) as display:
        result = run.simulate(scenario, loaded, display, folder, frames, settings_of(serial))
    _finish(result, folder, as_json)


def _nothing() -> None:
    """Do nothing."""


def _warn(scenario: Scenario) -> None:
    """Say what the scenario will not do as one may expect."""
    from rrins.host_tools.runs.set_up.load_warnings import warnings_of

    for warning in warnings_of(scenario):
        print_note(f"warning: {warning}")


def _display(scenario: Scenario, quiet: bool) -> RunDisplay:
    """Return the progress display of a run, on standard error."""
    from rrins.host_tools.runs.display import RunDisplay
    from rrins.host_tools.terminal import new_console

    return RunDisplay(scenario, new_console(stderr=True), quiet)


def _finish(result: RunResult, folder: Path, as_json: bool) -> None:
    """Write and show the results, then raise the error of the run, if any."""
    from rrins.host_tools.runs.results.keeping import place_for
    from rrins.host_tools.runs.results.summary import lines_of, table_of
    from rrins.host_tools.terminal import new_console, print_table

    paths: list[Path] = []
    failure: RehearsalError | None = None
    summary = result.summary
    try:
        place, note = place_for(folder, summary)
        if note is not None:
            print_note(note)
        paths = result.write(place)
    except RehearsalError as error:
        failure = error
    if as_json:
        click.echo(json.dumps(summary))
    else:
        console = new_console()
        if len(result.errors):
            print_table(table_of(summary), console)
        for line in lines_of(summary) if summary["epochs"] else ():
            console.print(line, highlight=False, soft_wrap=True)
        for path in paths if summary["epochs"] else ():
            console.print(f"  {path}", highlight=False, soft_wrap=True)
    if failure is not None and result.failure is None:
        raise failure
    result.check()


_side_options = _options(
    _scenario_options,
    click.option(
        "--speed", type=_Speed(), default="1", show_default=True, help="Must match the other side."
    ),
    _bus_options,
    _json_option,
    click.option("--log", type=click.Path(file_okay=False, path_type=Path), hidden=True),
    click.option("--report-fd", type=int, hidden=True),
    click.option("--core", type=int, hidden=True),
)


@click.command()
@_side_options
@serial_options
@click.option(
    "--attach-wait", type=float, default=0.0, help="Wait up to this many seconds for the bus."
)
@click.option(
    "--parameters",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Parameter memory; created if missing. Its values override the scenario's.",
)
def firmware(attach_wait: float, **options: Any) -> None:
    """Run the navigation computer alone, on the hardware's bus.

    SCENARIO is as for `rrins rehearse`, rimu_rotating by default, and the same on both sides.
    """
    serial = settings_of(options)
    _run_side("firmware", attach_wait_s=attach_wait, serial=serial, **options)


@click.command()
@_side_options
@_foreign_option
@_steer_option
@click.option("--await-peer", multiple=True, hidden=True)
@click.option("--follow", hidden=True)
@click.option("--patience", "patience_s", type=float, default=0.0, hidden=True)
@click.option("--program", help="Your own program as the sensors and the table.")
def hardware(await_peer: tuple[str, ...], program: str | None, **options: Any) -> None:
    """Run the emulated RIMU and turntable alone; it hosts the embedded bus.

    SCENARIO is as for `rrins rehearse`, rimu_rotating by default, and the same on both sides.
    """
    from rrins.host_tools.runs.programs.program import Program

    model = None if program is None else Program.parse(program)
    _run_side("hardware", await_peers=await_peer, program=model, **options)


def _run_side(
    side: Side,
    scenario: str,
    duration_s: float | None,
    seed: int | None,
    speed: float | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    as_json: bool,
    log: Path | None,
    **job: Any,
) -> None:
    from rrins.host_tools.runs.results.pipe import NoteHandler, ReportPipe
    from rrins.host_tools.runs.side import address_of, check_line, run_side
    from rrins.host_tools.runs.sides.job import REALTIME, Job
    from rrins.host_tools.scenario.scenario import load

    report_fd = job["report_fd"]
    heed_sigterm()
    if report_fd is not None:  # errors go into the report, not into a log as well
        logging.getLogger().setLevel(logging.CRITICAL)
        of_code = logging.getLogger("rrins.compiled")
        of_code.setLevel(logging.WARNING)
        of_code.propagate = False
        of_code.addHandler(NoteHandler(ReportPipe(report_fd), side))
    try:
        loaded = load(scenario, duration_s=duration_s, seed=seed)
        address = address_of(interface, channel, bitrate)
        own = Job(loaded, address, speed, log, **job)
        check_line(side, own)
        if report_fd is None:
            _warn(loaded)
            kind = "real time" if speed == REALTIME else "lockstep"
            click.echo(f"rrins: {side} on {address}, {kind}; Ctrl-C stops", err=True)
        _show_side(run_side(side, own), as_json, report_fd)
    except RehearsalError as error:
        if report_fd is None:
            raise
        ReportPipe(report_fd).fail(side, error)
        sys.exit(error.exit_status)
    except BrokenPipeError:  # the rehearsal has ended
        sys.exit(RehearsalError.exit_status)
    except KeyboardInterrupt:
        if report_fd is None:
            raise
        sys.exit(INTERRUPTED)


def _show_side(summary: JsonObject, as_json: bool, report_fd: int | None) -> None:
    """Print a side's summary, unless it goes to a rehearsal."""
    if as_json:
        click.echo(json.dumps(summary))
    elif report_fd is None:
        for key, value in summary.items():
            click.echo(f"{key:>18}: {value}")
