"""`rrins reproduce`: the paper's experiments, run and reported."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click
from rich.table import Table

from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.experiments.paper import EXPERIMENTS, reproduce_sections, runs_of
from rrins.host_tools.experiments.report import table_3, write
from rrins.host_tools.experiments.sections import FigureRow, Section, figure
from rrins.host_tools.terminal import new_console, print_table, progress_line


def _table_3(sections: list[Section]) -> Table:
    table = Table(title="Table 3: ours, the paper's, the ratio", title_justify="left")
    table.add_column("")
    for name in ("4.3 east", "4.3 north", "4.4 east", "4.4 north", "4.5 end"):
        table.add_column(name, justify="right", no_wrap=True)
    for name, cells in table_3(sections):
        shown = ("" if row is None else _beside(row) for row in cells)
        table.add_row(name, *shown, end_section=True)
    return table


def _beside(row: FigureRow) -> str:
    mark = " !" if row.differs else ""
    return f"{figure(row.ours)} m\n{figure(row.paper)} m\n× {figure(row.ratio)}{mark}"


@click.command()
@click.argument(
    "experiment", type=click.Choice((*EXPERIMENTS, "all")), default="all", metavar="[EXPERIMENT]"
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100_000),
    default=20,
    show_default=True,
    help="Number of noise seeds.",
)
@click.option(
    "--motion",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Recorded motion for `drive`, in addition to the synthetic one: .csv or .pos.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/reproduce"),
    show_default=True,
    help="Folder for the report and its plots.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object with the rows of the report."
)
def reproduce(experiment: str, seeds: int, motion: Path | None, out: Path, as_json: bool) -> None:
    """Run the paper's experiments and compare the results with its figures.

    EXPERIMENT is scheme (section 4.2), static (4.3.1), rotating (4.3.2), experiment (4.4), drive
    (4.5) or all. Writes report.html and plots.
    """
    which = EXPERIMENTS if experiment == "all" else (experiment,)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {out}: cannot be created: {error.strerror}") from error
    if not os.access(out, os.W_OK | os.X_OK):
        raise RehearsalError(f"--out {out}: cannot be written to")
    console = new_console(stderr=True)
    with progress_line(console) as progress:
        total = runs_of(which, seeds, motion)
        task = progress.add_task("preparing", total=total)
        done = 0

        def advance() -> None:
            nonlocal done
            done += 1
            progress.update(task, completed=done, state=(f"{done} of {total} runs",))

        def say(name: str) -> None:
            progress.update(task, description=name)
            if not console.is_terminal:
                console.print(f"{name} …", highlight=False, soft_wrap=True)

        sections = reproduce_sections(which, seeds, motion, advance, say)
        paths = write(out, sections)
    if as_json:
        rows = [row.values() for section in sections for row in section.rows]
        click.echo(json.dumps({"seeds": seeds, "rows": rows, "report": str(paths[0])}))
        return
    shown = new_console()
    if table_3(sections):
        print_table(_table_3(sections), shown)
    for section in sections:
        for line in section.findings:
            shown.print(f"{section.experiment}: {line}", highlight=False, soft_wrap=True)
    for path in paths:
        shown.print(f"  {path}", highlight=False, soft_wrap=True)
