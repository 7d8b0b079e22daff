"""The command `rrins dashboard`."""

from __future__ import annotations

import contextlib
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.numbers import BIT_RATE, NumberRange
from rrins.host_tools.cli.options import together
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.dashboard.opening import Subject
    from rrins.host_tools.dashboard.source import Source

_PORT = 8350

_rehearsal_options = together(
    click.option("--duration", "duration_s", type=float, help="Navigate for this many seconds."),
    click.option("--seed", type=int, help="Seed of the sensor noise."),
    click.option(
        "--speed",
        type=NumberRange(min=0),
        default=1.0,
        show_default=True,
        help="Initial speed, in multiples of real time; 0: as fast as possible.",
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
    click.option("--control", is_flag=True, help="Allow control of the rehearsal it attaches to."),
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
    "--port", type=click.IntRange(0, 65535), default=_PORT, show_default=True, help="Port; 0: any."
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

    SCENARIO is rehearsed (rimu_rotating by default). With --channel the dashboard attaches to the
    rehearsal on that channel; if SCENARIO names what runs there, errors are shown, too. A LOG is
    played back.
    """
    from rrins.host_tools.dashboard.opening import Subject, check_packages

    check_packages()
    from rrins.host_tools.dashboard.feed import Feed
    from rrins.host_tools.dashboard.guarding import Guard
    from rrins.host_tools.dashboard.server import bound, serve, url_of

    heed_sigterm()
    guard = Guard.of(host)
    subject = Subject(
        what,
        duration_s,
        seed,
        speed,
        out,
        record,
        interface,
        channel,
        bitrate,
        control,
        log_channel,
    )
    with bound(host, port) as listening, _shown(subject) as source:
        url = url_of(listening, guard)

        def on_serving() -> None:
            click.echo(f"rrins: dashboard at {url}; Ctrl-C stops", err=True)
            if opens:
                webbrowser.open(url)

        with contextlib.suppress(KeyboardInterrupt):
            serve(Feed(source, bool(source.orders)), guard, listening, on_serving)


@contextlib.contextmanager
def _shown(subject: Subject) -> Iterator[Source]:
    """Open what is to be shown; the reading of a log has a progress bar."""
    from rrins.host_tools.cli.log_files import reading_progress
    from rrins.host_tools.dashboard.log_source import LogSource
    from rrins.host_tools.dashboard.opening import opened

    path = subject.log
    size = path.stat().st_size if path is not None and path.exists() else 1
    with contextlib.ExitStack() as stack:
        with reading_progress("reading", size, quiet=path is None) as on_read:
            source = stack.enter_context(opened(subject, on_read))
        if isinstance(source, LogSource) and source.damage is not None:
            print_note(f"{source.damage}; used what could be read")
        yield source
