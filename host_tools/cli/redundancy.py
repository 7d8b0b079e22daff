"""`rrins redundancy`: what redundant sensors can find."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import json_option
from rrins.host_tools.errors import RehearsalError


@click.command()
@click.argument("scenario", required=False)
@click.option(
    "--rimu",
    "geometries",
    metavar="GEOMETRY",
    multiple=True,
    help="Built-in geometry, or TOML file with the sensor axes; repeat to compare.",
)
@click.option("--preset", metavar="NAME", help="Sensor preset, as for `sensors` in a scenario.")
@click.option(
    "--false-alarms",
    "false_alarms_per_1000_h",
    type=NumberRange(0, 1000, min_open=True),
    help="False alarms allowed in 1000 h.  [default: 0.05, or the scenario's]",
)
@click.option(
    "--gyro",
    "gyro_dph",
    type=NumberRange(1e-6, 1e6),
    multiple=True,
    help="Step of a gyro to try, °/h; repeatable.",
)
@click.option(
    "--accelerometer",
    "accelerometer_ug",
    type=NumberRange(1e-3, 1e7),
    multiple=True,
    help="Step of an accelerometer to try, µg; repeatable.",
)
@click.option(
    "--runs",
    type=click.IntRange(0, 100_000),
    default=20,
    show_default=True,
    help="Number of runs of the Monte Carlo; 0: theory alone.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the first run."
)
@json_option
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/redundancy"),
    show_default=True,
    help="Folder for the report and its picture.",
)
def redundancy(
    scenario: str | None,
    geometries: tuple[str, ...],
    preset: str | None,
    false_alarms_per_1000_h: float | None,
    gyro_dph: tuple[float, ...],
    accelerometer_ug: tuple[float, ...],
    runs: int,
    seed: int,
    as_json: bool,
    out: Path,
) -> None:
    """Show which faults a set of redundant sensors can find, and how soon.

    SCENARIO gives sensors, noise, motion and the allowed false alarms. Without one, geometries with
    the sensors of a preset are compared, at rest on the turning table. Theory first, then a Monte
    Carlo of whole runs, each with a fault that begins once the parity has been learned. Writes
    report.html and a picture.
    """
    from rrins.host_tools.cli import redundancy_tables as tables
    from rrins.host_tools.interruption import as_event
    from rrins.host_tools.redundancy.candidates import candidates_of, title_of
    from rrins.host_tools.redundancy.report import write
    from rrins.host_tools.redundancy.survey import Study
    from rrins.host_tools.terminal import new_console, print_table, progress_line

    candidates = candidates_of(scenario, geometries, preset, false_alarms_per_1000_h)
    _make(out)
    sizes = {"gyros": sorted(set(gyro_dph)), "accelerometers": sorted(set(accelerometer_ug))}
    console = new_console(stderr=True)
    with progress_line(console) as progress:
        total = Study.steps(len(candidates), runs)
        task = progress.add_task("preparing", total=total)
        done = 0

        def advance(what: str) -> None:
            nonlocal done
            done += 1
            progress.update(task, completed=done, description=what)

        study = Study(candidates, sizes, advance)
        if runs:
            with as_event() as stop:
                study.run(runs, seed, stop)
            if stop.is_set():
                raise KeyboardInterrupt
    paths = write(out, study, runs, title_of(scenario, preset))
    if as_json:
        result = {"runs": runs, "seed": seed} | study.values()
        click.echo(json.dumps(result | {"report": str(paths[0]), "picture": str(paths[1])}))
        return
    shown = new_console()
    for number in range(2):
        print_table(tables.smallest_table(study, number), shown)
    if len(study.surveys) > 1:
        for number in range(2):
            print_table(tables.side_by_side_table(study, number), shown)
    else:
        (survey,) = study.surveys
        for one in survey.sets:
            for group in one.groups if study.sizes[one.kind.name] else ():
                print_table(tables.delay_table(study, survey, one, group), shown)
    for line in (*tables.false_alarm_lines(study), *(str(path) for path in paths)):
        shown.print(line, highlight=False, soft_wrap=True)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be created: {error.strerror}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise RehearsalError(f"--out {folder}: cannot be written to")
