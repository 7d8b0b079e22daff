"""`rrins reproduce`: the paper's experiments, run and reported."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from rrins.host_tools.cli.options import FOLDER, flag, format_option, option
from rrins.host_tools.cli.output import make_folder, print_results
from rrins.host_tools.experiments.paper import EXPERIMENTS, reproduce_sections, runs_of
from rrins.host_tools.experiments.report import table_3, write
from rrins.host_tools.experiments.sections import FigureRow, Section
from rrins.host_tools.rounding import rounded
from rrins.host_tools.terminal import new_console, new_table, progress_line

_RUN_S = 0.67
"""Mean time of a run on two idle cores."""


def _table_3(sections: list[Section]) -> Table:
    heads = ("4.3 east", "4.3 north", "4.4 east", "4.4 north", "4.5 end")
    table = new_table("Table 3: ours, the paper's, the ratio", "", *heads)
    for name, cells in table_3(sections):
        shown = ("" if row is None else _beside(row) for row in cells)
        table.add_row(name, *shown, end_section=True)
    return table


def _beside(row: FigureRow) -> str:
    mark = " !" if row.differs else ""
    return f"{rounded(row.ours)} m\n{rounded(row.paper)} m\n× {rounded(row.ratio)}{mark}"


@click.command()
@click.argument(
    "experiment", type=click.Choice((*EXPERIMENTS, "all")), default="all", metavar="[EXPERIMENT]"
)
@option("--seeds", "Number of noise seeds.", click.IntRange(1, 100_000), 20)
@option(
    "--motion",
    "Recorded motion for `drive`, in addition to the synthetic one: .csv or .pos.",
    click.Path(exists=True, dir_okay=False, path_type=Path),
)
@format_option
@option("--out", "Folder for the report and its plots.", FOLDER, Path("out/reproduce"))
@flag("--json as_json", "Print one JSON object with the rows of the report.")
def reproduce(experiment: str, seeds: int, motion: Path | None, out: Path, as_json: bool) -> None:
    """Run the paper's experiments and compare the results with its figures.

    EXPERIMENT is scheme (section 4.2), static (4.3.1), rotating (4.3.2), experiment (4.4), drive
    (4.5) or all, which takes about 8 min on two idle cores. Writes report.html and plots.
    """
    which = EXPERIMENTS if experiment == "all" else (experiment,)
    make_folder(out)
    console = new_console(stderr=True)
    total = runs_of(which, seeds, motion)
    if total:
        minutes = max(1, round(total * _RUN_S / 60))
        click.echo(f"{total} runs, about {minutes} min on two idle cores", err=True)
    with progress_line(console) as progress:
        task = progress.add_task("preparing", total=total)
        done = 0

        def advance() -> None:
            nonlocal done
            done += 1
            progress.update(task, completed=done, state=(f"{done} of {total} runs",))

        def say(name: str) -> None:
            progress.update(task, description=name)
            if not console.is_terminal:
                click.echo(f"{name} …", err=True)

        sections = reproduce_sections(which, seeds, motion, advance, say)
        paths = write(out, sections)
    findings = [f"{one.experiment}: {line}" for one in sections for line in one.findings]
    tables = [_table_3(sections)] if table_3(sections) else []
    rows = [row.values() for section in sections for row in section.rows]
    result = {"seeds": seeds, "rows": rows, "report": str(paths[0])}
    print_results(as_json, result, [*tables, *findings, *(f"  {path}" for path in paths)])
