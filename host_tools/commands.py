"""The commands that run and list scenarios: both sides, one side, a bench, a bus for others."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import click

from host_tools.errors import RehearsalError
from host_tools.interruption import INTERRUPTED, heed_sigterm
from host_tools.scenario import Scenario, load, names, text_of
from host_tools.serial.options import nmea_options, serial_options, settings_of

DEFAULT_SCENARIO = "rimu_rotating"


class _Speed(click.ParamType[float | None]):
    """1 for real time, another factor or `max` for lockstep."""

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
            self.fail(f"{value} is not above 0", param, ctx)
        return speed


def _options(*options: Callable[..., Any]) -> Callable[..., Any]:
    """Return one decorator that stands for several."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


_scenario_options = _options(
    click.argument("scenario", default=DEFAULT_SCENARIO, metavar="[SCENARIO]"),
    click.option("--duration", "duration_s", type=float, help="Seconds to navigate."),
    click.option("--seed", type=int, help="Seed of all noise."),
)
_bus_options = _options(
    click.option(
        "--interface", default="rrins", show_default=True, help="python-can interface name."
    ),
    click.option("--channel", help="Channel of the interface, such as vcan0."),
    click.option("--bitrate", type=click.IntRange(1), help="For interfaces that set it."),
)
_out_option = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for pictures and summary.  [default: out/SCENARIO]",
)
_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


@click.command()
@_scenario_options
@click.option("--speed", type=_Speed(), default="max", show_default=True, help="1 is real time.")
@_bus_options
@click.option(
    "--limit",
    "limit_s",
    type=click.FloatRange(min=0, min_open=True),
    help="Shorten the run to whole cycles of the scheme where it would take more seconds.",
)
@_out_option
@click.option("--record", type=click.Path(dir_okay=False, path_type=Path), help="Log of the bus.")
@serial_options
@_json_option
def rehearse(
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
    as_json: bool,
    **serial: Any,
) -> None:
    """Run firmware and hardware as two processes on one bus.

    SCENARIO is the name of a built-in one (see `rrins scenarios`) or a TOML file. The embedded
    bus is used unless an interface is named. Ctrl-C stops both sides and keeps what was recorded.
    """
    from host_tools import runs

    loaded = load(scenario, duration_s=duration_s, seed=seed)
    heed_sigterm()
    plan = runs.Plan(
        scenario,
        loaded,
        runs.Overrides(duration_s, seed),
        runs.Bus(interface, channel, bitrate),
        speed,
        settings_of(serial),
    )
    if limit_s is not None:
        plan = runs.fit(plan, limit_s)
    runs.rehearse(plan, out, record, as_json)


@click.command()
@_scenario_options
@_out_option
@nmea_options
@click.option(
    "--frames", is_flag=True, help="Pass frames, as a bus would, where nothing needs them."
)
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
    """Run both sides in this process, without a bus: the same steps, the same navigation."""
    from host_tools import runs

    loaded = load(scenario, duration_s=duration_s, seed=seed)
    heed_sigterm()
    runs.simulate(scenario, loaded, out, as_json, frames, settings_of(serial))


@click.command()
@_json_option
@click.option("--quick", is_flag=True, help="Shorter samples and no cold start: some 20 s.")
def bench(as_json: bool, quick: bool) -> None:
    """Measure what a rehearsal costs on this machine: speeds, steps, codec, lateness, start."""
    from host_tools.bench import suite

    heed_sigterm()
    suite.bench(quick, as_json)


_side_options = _options(
    _scenario_options,
    click.option(
        "--speed", type=_Speed(), default="1", show_default=True, help="As the other side's."
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
@click.option("--attach-wait", type=float, default=0.0, help="Seconds to wait for the bus.")
@click.option(
    "--parameters",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File of the parameter memory; made when there is none. Its values go before those of "
    "the scenario.",
)
def firmware(attach_wait: float, **options: Any) -> None:
    """Run the navigation computer alone, on a bus that the hardware is on."""
    serial = settings_of(options)
    _run_side("firmware", attach_wait_s=attach_wait, serial=serial, **options)


@click.command()
@_side_options
@click.option("--await-peer", multiple=True, hidden=True)
def hardware(await_peer: tuple[str, ...], **options: Any) -> None:
    """Run the emulated RIMU and turntable alone; it hosts the embedded bus."""
    _run_side("hardware", await_peers=await_peer, **options)


def _run_side(
    side: Literal["firmware", "hardware"],
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
    from host_tools import runs

    report_fd = job["report_fd"]
    heed_sigterm()
    if report_fd is not None:  # what goes wrong is reported, not logged beside it
        logging.getLogger().setLevel(logging.CRITICAL)
    try:
        loaded = load(scenario, duration_s=duration_s, seed=seed)
        bus = runs.Bus(interface, channel, bitrate)
        runs.run_side(side, loaded, bus, speed, as_json, folder=log, **job)
    except RehearsalError as error:
        if report_fd is None:
            raise
        runs.report_error(report_fd, side, error)
        sys.exit(error.exit_status)
    except BrokenPipeError:  # the rehearsal is gone
        sys.exit(RehearsalError.exit_status)
    except KeyboardInterrupt:
        if report_fd is None:
            raise
        sys.exit(INTERRUPTED)


@click.command()
@click.option("--channel", default="rrins0", show_default=True, help="Channel of the embedded bus.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=29536,
    show_default=True,
    help="TCP port; 0 takes a free one.",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Loopback address.")
def socketcand(channel: str, port: int, host: str) -> None:
    """Offer the embedded bus to socketcand clients, such as SavvyCAN.

    Everybody on this machine may connect while it runs. It ends with the bus, or by Ctrl-C.
    """
    from host_tools.bus.socketcand import serve

    def on_ready(taken: int) -> None:
        click.echo(f"rrins: channel {channel!r} is on {host} port {taken}; Ctrl-C stops", err=True)

    heed_sigterm()
    click.echo(f"rrins: {serve(channel, host, port, on_ready=on_ready)}", err=True)


@click.group(invoke_without_command=True)
@click.pass_context
def scenarios(context: click.Context) -> None:
    """List the built-in scenarios, a line each."""
    if context.invoked_subcommand is None:
        for name in names():
            click.echo(f"{name:<28} {load(name).title}")


@scenarios.command("show")
@click.argument("name")
def show_scenario(name: str) -> None:
    """Print a scenario's TOML, to copy and change."""
    click.echo(text_of(name), nl=False)


@scenarios.command("schema")
def show_schema() -> None:
    """Print the JSON schema of a scenario: every key, its limits and default."""
    click.echo(json.dumps(Scenario.model_json_schema(), indent=2))
