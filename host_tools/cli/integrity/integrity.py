"""`rrins integrity`: whether the error stays within the bound that the unit states."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.completion import complete_scenarios
from rrins.host_tools.cli.options import (
    FOLDER,
    format_option,
    json_option,
    option,
    seed_option,
    workers_option,
)
from rrins.host_tools.cli.output import make_folder, print_results, stepping, stopping
from rrins.host_tools.rounding import rounded

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.integrity.study import Study

_MOST_LISTED = 10


@click.command()
@click.argument("scenarios", metavar="[SCENARIO]...", nargs=-1, shell_complete=complete_scenarios)
@option("--cases", "Number of cases.", click.IntRange(1, 1_000_000), 200)
@seed_option("the cases")
@workers_option
@format_option
@option("--out", "Folder for page, picture and cases.", FOLDER, Path("out/integrity"))
@json_option
def integrity(
    scenarios: tuple[str, ...],
    cases: int,
    seed: int,
    workers: int | None,
    out: Path,
    as_json: bool,
) -> None:
    """Compare the error with its protection level in random cases, faults included.

    Site, motion, sensors, aids and faults are drawn; with a SCENARIO, seed and faults alone, and
    several take turns. Writes report.html, the Stanford diagram, and the scenarios of the cases to
    look at. Ends with status 14 if the error exceeded its level while the unit called itself
    available. Ctrl-C keeps what is done.
    """
    from rrins.host_tools.campaigns.engines import processors
    from rrins.host_tools.errors import MisleadingError
    from rrins.host_tools.integrity.study import Study
    from rrins.host_tools.scenario.scenario import load

    study = Study(cases, seed, [(name, load(name)) for name in scenarios])
    for number in range(max(1, len(scenarios))):
        study.case(number)  # a scenario that is impossible with a fault is refused here
    make_folder(out)
    with stopping() as stop:
        with stepping("cases", cases) as on_done:
            study.run(workers or processors(), stop, on_done)
        if not study.results:
            return
        paths, commands = study.write(out)
        report, picture = map(str, paths)
        values = study.values() | {"report": report, "picture": picture, "repeat": commands}
        tables = [_table(study), _healthy(study)]
        print_results(as_json, values, [*tables, *_lines(study, commands), report, picture])
    if study.misleading:
        raise MisleadingError(
            f"the error exceeded its protection level in {len(study.misleading)} of "
            f"{len(study.results)} cases; {report} lists them"
        )


def _table(study: Study) -> Table:
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.integrity.words import percent
    from rrins.host_tools.terminal import new_table

    heads = (
        "cases",
        "misleading",
        "share / %",
        "prior\n/ (1/h)",
        "available\n/ %",
        "degraded\n/ %",
    )
    table = new_table("Error against protection level, by kind of fault", "faults", *heads)
    for one in study.strata:
        prior = "–" if one.prior_per_h is None else shown(one.prior_per_h)
        shares = [shown(100 * share) for share in study.availability(one.kind).values()][:2]
        cells = (str(one.cases), str(one.misleading), percent(one.share), prior, *shares)
        table.add_row(one.kind, *cells)
    return table


def _healthy(study: Study) -> Table:
    from rrins.host_tools.campaigns.summary import shown
    from rrins.host_tools.integrity.stanford import SCALES
    from rrins.host_tools.terminal import new_table

    title = "Error over σ of the healthy cases, root mean square"
    table = new_table(title, "preset, or aids", "cases", *(scale.name for scale in SCALES))
    for one in study.healthy:
        table.add_row(one.group, str(one.cases), *map(shown, one.error_over_sigma.values()))
    return table


def _lines(study: Study, commands: dict[int, str]) -> list[str]:
    from rrins.host_tools.campaigns.summary import shown

    rate, alerts = study.hourly, study.to_alert_s()
    medians = study.healthy[0].level_over_sigma.items()
    levels = ", ".join(f"{name} {shown(value)}" for name, value in medians)
    beyond = len(study.misleading_beyond)
    lines = [
        f"{len(study.misleading)} of {len(study.results)} cases misleading in "
        f"{rounded(study.hours)} h: "
        f"{shown(rate.value)} per hour by the prior rates, 95 %: {shown(rate.low)} to "
        f"{shown(rate.high)}; stated {shown(study.risk_per_h)}",
        f"{beyond} more by faults that the unit assumes never to happen (rate 0)",
        f"sound sensors left out in {len(study.sound_left_out)} cases; "
        f"longest time to alert {shown(alerts[0] if alerts else 0.0)} s",
        f"level over σ, median of the healthy: {levels}",
    ]
    listed = study.listed()
    lines += [
        f"case {one.case.number}, {one.case.kind}: {one.case.words}: {commands[one.case.number]}"
        for one in listed[:_MOST_LISTED]
    ]
    return lines + ([f"… {len(listed)} in all"] if len(listed) > _MOST_LISTED else [])
