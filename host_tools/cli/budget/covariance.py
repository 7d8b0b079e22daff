"""`rrins covariance`: the linear covariance analysis of a scenario or a campaign."""

from __future__ import annotations

from pathlib import Path

import click

from rrins.host_tools.cli.options import (
    FOLDER,
    duration_option,
    format_option,
    json_option,
    many,
    option,
)
from rrins.host_tools.cli.output import print_results


@click.command()
@click.argument("source")
@many("--vary", "As for `rrins campaign`.", "'KEY=DISTRIBUTION'")
@many("--set fixed", "Set a key of the scenario.", "KEY=VALUE")
@many("--true", "Set a key of the sensors or aids that the filter is not told of.", "KEY=VALUE")
@duration_option
@format_option
@option("--out", "Folder for covariance.csv and the plot.", FOLDER)
@json_option
def covariance(
    source: str,
    vary: tuple[str, ...],
    fixed: tuple[str, ...],
    true: tuple[str, ...],
    duration_s: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Analyse σ of the navigation over time, and the share of each error source.

    With the estimator, σ of its errors as they are, beside the σ that it has of them itself.

    SOURCE is a scenario, a campaign's TOML file, or the folder of a campaign, whose runs are then
    compared with the analysis. Only one run is made, for the trajectory.
    """
    from rrins.host_tools.campaigns import covariance_report as report
    from rrins.host_tools.campaigns import words
    from rrins.host_tools.campaigns.definition import Wishes, load
    from rrins.host_tools.campaigns.store import Store, is_campaign
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.terminal import new_table

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
    analysis = report.analysis_of(definition, words.settings_of(true, "true"))
    paths = [] if out is None else [str(path) for path in report.write(analysis, out, beside)]
    title = f"σ of the position after {analysis.times_s[-1]:g} s / m"
    table = new_table(title, "error source", "east", "north", "largest on the way", "share")
    for one in analysis.sources:
        figures = [shown(value) for value in (*one.end, one.largest)]
        table.add_row(one.name, *figures, f"{analysis.share(one):.1%}")
    table.add_section()
    total = [shown(value) for value in (*analysis.sigma[-1], analysis.sigma.max())]
    table.add_row("all", *total, "")
    result = analysis.values()
    lines = [f"not considered: {', '.join(analysis.left_out)}"] if analysis.left_out else []
    if analysis.fixed:
        mean = [shown(value) for value in (*analysis.mean[-1], abs(analysis.mean).max())]
        table.add_row("mean error of fixed constants", *mean, "")
        lines.append(
            f"fixed, so in the mean error and not in σ: {', '.join(analysis.fixed)}; "
            "--vary 'KEY=normal(…)' says how they vary"
        )
    if beside is not None:
        table.add_row(*beside.cells())
        result["runs"] = beside.values()
        lines.append(beside.words(analysis))
    tables = [table]
    if analysis.filter_sigmas is not None:
        heads = ("error of", "σ", "the filter's σ", "true / filter", "on the way")
        tables.append(new_table("σ at the end", *heads))
        for row in report.quantity_rows(analysis):
            tables[-1].add_row(*row)
        lines.append(report.confidence(analysis))
    print_results(as_json, result | {"files": paths}, [*tables, *lines, *paths])
