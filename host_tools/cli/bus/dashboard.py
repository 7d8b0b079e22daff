"""The command `rrins dashboard`."""

from __future__ import annotations

import contextlib
import webbrowser
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.options import (
    NOT_NEGATIVE,
    PORT,
    bitrate_option,
    flag,
    free_duration_option,
    interface_option,
    noise_seed_option,
    option,
    record_option,
    results_option,
)
from rrins.host_tools.cli.output import counting, print_note
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.dashboard.opening import Subject
    from rrins.host_tools.dashboard.source import Source


@click.command()
@click.argument("what", metavar="[SCENARIO|LOG]", required=False, shell_complete=complete_scenarios)
@free_duration_option
@noise_seed_option
@option(
    "--speed",
    "Initial speed, in multiples of real time; 0: as fast as possible.",
    NOT_NEGATIVE,
    1.0,
)
@results_option
@record_option
@interface_option
@option("--channel", "Attach to what runs on this channel, instead of starting.")
@bitrate_option
@flag("--control", "Allow control of the rehearsal it attaches to.")
@option("--log-channel", "Use only the frames of this channel of a log.", metavar="NAME")
@option("--host", "Address to serve at.", None, "127.0.0.1")
@option("--port", "Port; 0: any.", PORT, 8350)
@flag("--open opens", "Open the page in a browser.")
def dashboard(host: str, port: int, opens: bool, **subject: Any) -> None:
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
    with bound(host, port) as listening, _shown(Subject(**subject)) as source:
        url = url_of(listening, guard)

        def on_serving() -> None:
            print_note(f"dashboard at {url}; Ctrl-C stops")
            if opens:
                webbrowser.open(url)

        with contextlib.suppress(KeyboardInterrupt):
            serve(Feed(source, bool(source.orders)), guard, listening, on_serving)


@contextlib.contextmanager
def _shown(subject: Subject) -> Iterator[Source]:
    """Open what is to be shown; the reading of a log has a progress bar."""
    from rrins.host_tools.dashboard.log_source import LogSource
    from rrins.host_tools.dashboard.opening import opened

    path = subject.log
    size = path.stat().st_size if path is not None and path.exists() else 1
    with contextlib.ExitStack() as stack:
        with counting("reading", size, quiet=path is None) as on_read:
            source = stack.enter_context(opened(subject, on_read))
        if isinstance(source, LogSource) and source.damage is not None:
            print_note(f"{source.damage}; used what could be read")
        yield source
