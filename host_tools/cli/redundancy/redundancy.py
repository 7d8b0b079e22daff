"""`rrins redundancy`: what redundant sensors can find."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.options import (
    FOLDER,
    Number,
    format_option,
    json_option,
    many,
    option,
    seed_option,
)
from rrins.host_tools.cli.output import make_folder, print_results, stopping

if TYPE_CHECKING:
    from rich.table import Table


@click.command()
@click.argument("scenario", required=False)
@many(
    "--rimu geometries",
    "Built-in geometry, or TOML file with the sensor axes; repeat to compare.",
    "GEOMETRY",
)
@option("--preset", "Sensor preset, as for `sensors` in a scenario.", metavar="NAME")
@option(
    "--false-alarms false_alarms_per_1000_h",
    "False alarms allowed in 1000 h.  [default: 0.05, or the scenario's]",
    Number(0, 1000, min_open=True),
)
@many("--gyro gyro_dph", "Step of a gyro to try, °/h; repeatable.", kind=Number(1e-6, 1e6))
@many(
    "--accelerometer accelerometer_ug",
    "Step of an accelerometer to try, µg; repeatable.",
    kind=Number(1e-3, 1e7),
)
@option("--runs", "Number of runs of the Monte Carlo.", click.IntRange(1, 100_000), 20)
@seed_option("the first run")
@json_option
@format_option
@option("--out", "Folder for the report and its picture.", FOLDER, Path("out/redundancy"))
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
    from rrins.host_tools.cli.redundancy import tables
    from rrins.host_tools.redundancy.candidates import candidates_of, title_of
    from rrins.host_tools.redundancy.report import write
    from rrins.host_tools.redundancy.survey import Study
    from rrins.host_tools.terminal import new_console, progress_line

    candidates = candidates_of(scenario, geometries, preset, false_alarms_per_1000_h)
    make_folder(out)
    sizes = {"gyros": sorted(set(gyro_dph)), "accelerometers": sorted(set(accelerometer_ug))}
    with progress_line(new_console(stderr=True)) as progress:
        task = progress.add_task("preparing", total=Study.steps(len(candidates), runs))

        def advance(what: str) -> None:
            progress.update(task, advance=1, description=what)

        study = Study(candidates, sizes, advance)
        with stopping() as stop:
            study.run(runs, seed, stop)
    report, picture = map(str, write(out, study, runs, title_of(scenario, preset)))
    parts: list[Table | str] = [tables.smallest_table(study, number) for number in range(2)]
    if len(study.surveys) > 1:
        parts += [tables.side_by_side_table(study, number) for number in range(2)]
    else:
        (survey,) = study.surveys
        parts += [
            tables.delay_table(study, survey, one, group)
            for one in survey.sets
            if study.sizes[one.kind.name]
            for group in one.groups
        ]
    result = {"runs": runs, "seed": seed, "report": report, "picture": picture} | study.values()
    print_results(as_json, result, [*parts, *tables.lines_below(study), report, picture])
