"""`rrins tour`: the story of a redundant rotational INS, in a browser or in the terminal."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rrins.host_tools.cli.options import PORT, flag, option
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.interruption import heed_sigterm
from rrins.host_tools.rounding import rounded

if TYPE_CHECKING:
    from rrins.host_tools.dashboard.tour import Step
    from rrins.host_tools.testing.bench import Bench

_WIDTH: Final = 80
_LOOK_S: Final = 2.0
_LONGEST_S: Final = 600.0


@click.command()
@option("--host", "Address to serve at.", None, "127.0.0.1")
@option("--port", "Port; 0: any.", PORT, 8350)
@flag("--no-browser", "Serve the page, but open no browser.")
@flag("--terminal", "Tell the story here, without a page.")
def tour(host: str, port: int, no_browser: bool, terminal: bool) -> None:
    """Tell in five minutes what this is for, with a rehearsal that runs.

    The dashboard opens: standing still it drifts, the table starts, gyro 3 fails, is left out, the
    track is repaired, the trouble code is read. Each step shows its command. Where there is no
    browser, the terminal tells it.
    """
    heed_sigterm()
    if not terminal and not no_browser and not _has_browser():
        print_note("no browser here: the tour in the terminal; --no-browser serves the page")
        terminal = True
    if terminal:
        _tell()
    else:
        _serve(host, port, not no_browser)


def _has_browser() -> bool:
    try:
        webbrowser.get()
    except webbrowser.Error:
        return False
    return True


def _serve(host: str, port: int, opens: bool) -> None:
    from rrins.host_tools.dashboard.opening import Subject, check_packages, opened

    check_packages()
    from rrins.host_tools.dashboard.feed import Feed
    from rrins.host_tools.dashboard.guarding import Guard
    from rrins.host_tools.dashboard.server import bound, serve, url_of
    from rrins.host_tools.dashboard.tour import SCENARIO, SPEED, told

    guard = Guard.of(host)
    with (
        tempfile.TemporaryDirectory(prefix="rrins-tour-") as folder,
        bound(host, port) as listening,
        opened(Subject(SCENARIO, speed=SPEED, out=Path(folder))) as source,
    ):
        url = url_of(listening, guard)

        def on_serving() -> None:
            print_note(f"tour at {url}; Ctrl-C stops")
            if opens:
                webbrowser.open(url)

        with contextlib.suppress(KeyboardInterrupt):
            serve(Feed(source, True, told()), guard, listening, on_serving)


def _tell() -> None:
    """Tell the story in simulated time, with the figures of a rehearsal in this process."""
    from rrins.host_tools.dashboard.tour import SCENARIO, STEPS
    from rrins.host_tools.scenario.scenario import load
    from rrins.host_tools.testing.bench import Bench

    scenario = load(SCENARIO)
    with tempfile.TemporaryDirectory(prefix="rrins-tour-") as folder:
        file = Path(folder) / f"{SCENARIO}.toml"
        file.write_text(scenario.toml(), encoding="utf-8")
        with contextlib.closing(Bench(scenario, file)) as bench:
            kept: dict[str, str] = {}
            for number, step in enumerate(STEPS, 1):
                _print_step(f"{number} of {len(STEPS)}", step, kept)
                _play(bench, step)
                if step.keeps:
                    kept[step.keeps] = _error(bench)
                if number < len(STEPS) and sys.stdin.isatty() and sys.stdout.isatty():
                    click.pause("  Enter goes on, Ctrl-C ends the tour")
    click.echo("Next: docs/first-half-hour.md, from here to your own firmware.")


def _print_step(number: str, step: Step, kept: dict[str, str]) -> None:
    click.secho(f"\n{step.title}  ({number})", bold=True)
    click.echo(click.wrap_text(step.text.format_map(kept), _WIDTH))
    click.secho(f"$ {step.command}", fg="cyan")


def _error(bench: Bench) -> str:
    east, north = bench.errors_m()
    return f"{rounded((east**2 + north**2) ** 0.5)} m"


def _play(bench: Bench, step: Step) -> None:
    """Run the rehearsal to the end of a step, and print what was seen."""
    from rrins.host_tools.dashboard.tour import FAULT, STANDS_UNTIL_S

    if step.order == "inject":
        keys = dict(FAULT)
        bench.inject(str(keys.pop("kind")), **keys)
    while bench.time_s < step.until_s:
        bench.advance(min(60.0, step.until_s - bench.time_s))
        click.echo(f"  {bench.time_s:6.0f} s  position error {_error(bench)}")
    if step.until_event:
        begun_s = bench.time_s
        while not bench.expect("GYRO_REDUNDANCY", within=_LOOK_S)["excluded"]:
            bench.advance(_LOOK_S)
            if bench.time_s > begun_s + _LONGEST_S:
                break
        click.echo(f"  left out after {bench.time_s - begun_s:.0f} s")
    if step.order == "read_codes":
        with bench.tester() as tester:
            for one in tester.troubles(_confirmed()):
                name = one.trouble.name if one.trouble else "not in this table"
                click.echo(f"  {one.code}  {name}")
    if step.command.startswith("rrins explain"):
        _explain(STANDS_UNTIL_S - 10.0)


def _confirmed() -> int:
    from rrins.host_tools.diag.trouble_table import REMEMBERED

    return REMEMBERED


def _explain(time_s: float) -> None:
    from rrins.host_tools.dashboard.tour import SCENARIO
    from rrins.host_tools.explanation import words
    from rrins.host_tools.explanation.explain import explain
    from rrins.host_tools.scenario.scenario import load

    found = explain(load(SCENARIO), time_s, "source", workers=0)
    click.echo(f"  {words.headline(found, SCENARIO, 'position')}")
    unit, rows = words.table_rows(found, "position")
    for name, east, north, _, share in rows:
        click.echo(f"  {name:<24}{east:>8} {unit} east {north:>8} {unit} north {share:>9}")
