"""The command `rrins dashboard`."""

from __future__ import annotations

import contextlib
import importlib.util
import sys
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.numbers import BIT_RATE, NumberRange
from rrins.host_tools.cli.options import together
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.dashboard.source import Source

_DEFAULT_SCENARIO = "rimu_rotating"
_PORT = 8350
_NEEDED = ("starlette", "uvicorn", "websockets")
_SWITCH_S = 0.0005

_rehearsal_options = together(
    click.option("--duration", "duration_s", type=float, help="Navigate for this many seconds."),
    click.option("--seed", type=int, help="Seed of the sensor noise."),
    click.option(
        "--speed",
        type=NumberRange(min=0),
        default=1.0,
        show_default=True,
        help="Factor of real time at first, or of a playback; 0: as fast as possible.",
    ),
    click.option(
        "--out",
        type=click.Path(file_okay=False, path_type=Path),
        help="Folder for the results.  [default: out/SCENARIO]",
    ),
    click.option(
        "--record",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Record the bus to this file.",
    ),
)
_bus_options = together(
    click.option("--interface", default="rrins", show_default=True, help="python-can interface."),
    click.option("--channel", help="Attach to what runs on this channel, instead of starting."),
    click.option("--bitrate", type=BIT_RATE, help="Bit rate, if the interface sets it."),
    click.option("--control", is_flag=True, help="Allow orders to what is attached to."),
    click.option(
        "--log-channel", metavar="NAME", help="Use only the frames of this channel of a log."
    ),
)


@click.command()
@click.argument("what", metavar="[SCENARIO|LOG]", required=False, shell_complete=complete_scenarios)
@_rehearsal_options
@_bus_options
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to serve at.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=_PORT, show_default=True, help="0: any."
)
@click.option("--open", "opens", is_flag=True, help="Open the page in a browser.")
def dashboard(
    what: str | None,
    duration_s: float | None,
    seed: int | None,
    speed: float,
    out: Path | None,
    record: Path | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    control: bool,
    log_channel: str | None,
    host: str,
    port: int,
    opens: bool,
) -> None:
    """Show a rehearsal in a browser: table, plots, map, bus, events, controls.

    SCENARIO is rehearsed (rimu_rotating by default). With --channel the dashboard attaches to what
    runs there; SCENARIO then says what that is, for errors against the truth. A LOG is played back.
    """
    _check_packages()
    from rrins.host_tools.dashboard.feed import Feed
    from rrins.host_tools.dashboard.guarding import Guard
    from rrins.host_tools.dashboard.server import bound, serve, url_of

    heed_sigterm()
    guard = Guard.of(host)
    with bound(host, port) as listening, contextlib.ExitStack() as stack:
        if channel is None and what is not None and _is_log(what):
            source = stack.enter_context(_playing(what, log_channel, speed))
        elif channel is not None or interface != "rrins":
            source = stack.enter_context(
                _watching(what, interface, channel, bitrate, duration_s, seed, control)
            )
        else:
            name = what or _DEFAULT_SCENARIO
            source = stack.enter_context(_rehearsing(name, duration_s, seed, speed, out, record))
        url = url_of(listening, guard)

        def on_serving() -> None:
            click.echo(f"rrins: dashboard at {url}; Ctrl-C stops", err=True)
            if opens:
                webbrowser.open(url)

        # Frames must be received while the same interpreter serves.
        sys.setswitchinterval(_SWITCH_S)
        may_control = bool(source.orders)
        with contextlib.suppress(KeyboardInterrupt):
            serve(Feed(source, may_control), guard, listening, on_serving)


def _check_packages() -> None:
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise RehearsalError(f"the dashboard needs more packages: pip install {' '.join(missing)}")


def _is_log(what: str) -> bool:
    """Return whether an argument names a recording, not a scenario."""
    from rrins.host_tools.recording.formats import ending_of

    if what.endswith(".toml"):
        return False
    return Path(what).is_file() or ending_of(Path(what))[0] != ""


@contextlib.contextmanager
def _playing(name: str, channel: str | None, speed: float) -> Iterator[Source]:
    from rrins.host_tools.cli.log_files import reading_progress
    from rrins.host_tools.dashboard.log_source import LogSource

    path = Path(name)
    with reading_progress("reading", path.stat().st_size if path.exists() else 1) as on_progress:
        source = LogSource(path, channel, on_progress=on_progress, speed=speed)
    if source.damage is not None:
        print_note(f"{source.damage}; used what could be read")
    with contextlib.closing(source):
        yield source


@contextlib.contextmanager
def _watching(
    name: str | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    duration_s: float | None,
    seed: int | None,
    control: bool,
) -> Iterator[Source]:
    from rrins.host_tools.dashboard.bus_source import BusSource
    from rrins.host_tools.runs.rehearsal import default_address
    from rrins.host_tools.scenario.scenario import load

    scenario = None if name is None else load(name, duration_s=duration_s, seed=seed)
    address = default_address(interface, channel, bitrate)
    with contextlib.closing(BusSource(address, scenario, control)) as source:
        yield source


@contextlib.contextmanager
def _rehearsing(
    name: str,
    duration_s: float | None,
    seed: int | None,
    speed: float,
    out: Path | None,
    record: Path | None,
) -> Iterator[Source]:
    from rrins.host_tools.bus.port import EMBEDDED, Address
    from rrins.host_tools.dashboard.bus_source import RehearsalSource
    from rrins.host_tools.dashboard.child import Start
    from rrins.host_tools.runs.rehearsal import free_channel
    from rrins.host_tools.runs.run import Overrides
    from rrins.host_tools.runs.settings import check_files
    from rrins.host_tools.runs.steering import UNLIMITED
    from rrins.host_tools.scenario.scenario import load

    scenario = load(name, duration_s=duration_s, seed=seed)
    check_files(scenario)
    named = (("--out", out), ("--record", record))
    options = [word for option, path in named if path is not None for word in (option, str(path))]
    start = Start(
        name,
        scenario,
        (*Overrides(duration_s, seed).options(), *options),
        Address(EMBEDDED, free_channel()),
    )
    with contextlib.closing(RehearsalSource(start, speed or UNLIMITED)) as source:
        yield source
