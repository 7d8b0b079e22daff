"""`rrins covariance`: the linear covariance analysis of a scenario or a campaign."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import json_option


@click.command()
@click.argument("source")
@click.option(
    "--vary", metavar="'KEY=DISTRIBUTION'", multiple=True, help="As for `rrins campaign`."
)
@click.option(
    "--set", "fixed", metavar="KEY=VALUE", multiple=True, help="Set a key of the scenario."
)
@click.option(
    "--duration",
    "duration_s",
    type=NumberRange(0, min_open=True),
    help="Navigate for this many seconds.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for covariance.csv and covariance.png.",
)
@json_option
def covariance(
    source: str,
    vary: tuple[str, ...],
    fixed: tuple[str, ...],
    duration_s: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Analyse σ of the position over time, and the share of each error source.

    SOURCE is a scenario, a campaign's TOML file, or the folder of a campaign, whose runs are then
    compared with the analysis. Only one run is made, for the trajectory.
    """
    from rich.table import Table

    from rrins.host_tools.campaigns import covariance_report as report
    from rrins.host_tools.campaigns import words
    from rrins.host_tools.campaigns.definition import Wishes, load
    from rrins.host_tools.campaigns.store import Store, is_campaign
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.covariance.analysis import analyse
    from rrins.host_tools.terminal import new_console, print_table

    if is_campaign(Path(source)):
        if vary or fixed or duration_s is not None:
            raise click.UsageError("A stored campaign is as it is; name a scenario or its file.")
        store = Store.open(Path(source))
        definition = store.definition
        beside = report.beside_runs(store)
    else:
        wishes = Wishes(
            duration_s=duration_s,
            set=words.settings_of(fixed),
            vary=words.variations_of(vary),
            design="random",
        )
        definition = load(source, wishes)
        beside = None
    analysis = analyse(definition.scenario, definition.varied())
    paths = [] if out is None else report.write(analysis, out, beside)
    if as_json:
        runs = {} if beside is None else {"runs": beside.values()}
        files = {"files": [str(path) for path in paths]}
        click.echo(json.dumps(analysis.values() | runs | files))
        return
    title = f"σ of the position after {analysis.times_s[-1]:g} s / m"
    table = Table(title=title, title_justify="left")
    table.add_column("error source", no_wrap=True)
    for name in ("east", "north", "largest on the way", "share"):
        table.add_column(name, justify="right")
    for one in analysis.sources:
        figures = [shown(value) for value in (*one.end, one.largest)]
        table.add_row(one.name, *figures, f"{analysis.share(one):.1%}")
    table.add_section()
    total = [shown(value) for value in (*analysis.sigma[-1], analysis.sigma.max())]
    table.add_row("all", *total, "")
    if beside is not None:
        table.add_row(*beside.cells())
    console = new_console()
    print_table(table, console)
    lines = [f"not considered: {', '.join(analysis.left_out)}"] if analysis.left_out else []
    if beside is not None:
        lines.append(beside.words(analysis))
    for text in (*lines, *map(str, paths)):
        console.print(text, highlight=False, soft_wrap=True)
