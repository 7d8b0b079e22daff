"""The command `rrins dashboard`."""

from __future__ import annotations

import contextlib
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.options import (
    FOLDER,
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
@option("--static", "Write the page as static files: it rehearses in the browser.", FOLDER)
@click.pass_context
def dashboard(
    context: click.Context,
    /,
    host: str,
    port: int,
    opens: bool,
    static: Path | None,
    **subject: Any,
) -> None:
    """Show a rehearsal in a browser: table, plots, map, bus, events, controls.

    SCENARIO is rehearsed (rimu_rotating by default). With --channel the dashboard attaches to the
    rehearsal on that channel; if SCENARIO names what runs there, errors are shown, too. A LOG is
    played back.

    With --static nothing is served: any web server can carry the folder, and the firmware and the
    hardware run in the browser as WebAssembly. SCENARIO is the only one there; without it there are
    several to choose from.
    """
    if static is not None:
        _refuse_others(context)
        _write(static, subject["what"])
        return
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


def _refuse_others(context: click.Context) -> None:
    """Refuse options that say how to serve, or what to watch."""
    for parameter in context.command.params:
        name = parameter.name or ""
        is_given = context.get_parameter_source(name) is ParameterSource.COMMANDLINE
        if is_given and name not in ("static", "what"):
            raise click.UsageError(f"{parameter.opts[0]}: not with --static")


def _write(folder: Path, scenario: str | None) -> None:
    from rrins.host_tools.dashboard.static_page import write_static_page

    page = write_static_page(folder, [] if scenario is None else [scenario], print_note)
    print_note(f"{page.folder}: {page.size / 1e6:.1f} MB; to look at it:")
    click.echo(f"python3 -m http.server --directory {page.folder}")


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
