"""`rrins motion`: check recorded motion, export true motion."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import json_option
from rrins.host_tools.cli.output import print_note

if TYPE_CHECKING:
    from rrins.host_tools.motion.trajectory import Trajectory
    from rrins.host_tools.scenario.motion import Motion

_FILE_ENDINGS = (".csv", ".pos")


@click.group(cls=Group)
def motion() -> None:
    """Check recorded motion; export true motion."""


def _setting(**keys: str | float | None) -> Motion:
    """Return the `[motion]` table of these options; invalid ones are usage errors."""
    from pydantic import ValidationError

    from rrins.host_tools.scenario.motion import Motion

    try:
        return Motion.model_validate({k: v for k, v in keys.items() if v is not None})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        raise click.UsageError(f"{where}: {message}" if where else message) from error


@motion.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--speed-limit", type=float, help="Speed that the vehicle cannot exceed, m/s.")
@click.option(
    "--jerk-density",
    type=float,
    help="Jerk density, (m/s³)/√Hz; a higher one follows the file more closely.",
)
@click.option(
    "--duration", "duration_s", type=float, help="Use only this many seconds of the file."
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the plot.  [default: out/motion]",
)
@json_option
def check(
    file: Path,
    speed_limit: float | None,
    jerk_density: float | None,
    duration_s: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Check a recorded motion (.csv or .pos).

    Reports duration, rate and speeds, irregular lines and how they are handled, and how far the
    smoothed path deviates from the file. Writes a plot.
    """
    from rrins.host_tools.motion import build, plots
    from rrins.host_tools.motion.findings import findings, table

    setting = _setting(
        kind="file",
        path=str(file),
        speed_limit_mps=speed_limit,
        jerk_density_mps3_per_sqrt_hz=jerk_density,
        duration_s=duration_s,
    )
    recording = build.load_recording(setting, Path())
    smoothed = build.follow(recording, setting, _PERIOD_NS)
    found = findings(recording, smoothed)
    folder = out or Path("out") / "motion"
    picture = folder / f"{file.stem}.png"
    plots.save(plots.draw_check(recording, smoothed), picture)
    found["picture"] = str(picture)
    if as_json:
        click.echo(json.dumps(found, allow_nan=False))
    else:
        click.echo("\n".join([*table(found), f"{'picture':<16} {picture}"]))


_PERIOD_NS = 5_000_000
"""Sampling period of a motion without a scenario."""


def _trajectory(source: str, keys: dict[str, str | float | None]) -> Trajectory:
    """Return the trajectory of a scenario, a file or a synthetic motion."""
    from rrins.host_tools.motion.build import build
    from rrins.host_tools.motion.errors import MotionError
    from rrins.host_tools.scenario.scenario import load
    from rrins.host_tools.scenario.tables import Body, Site

    if source in ("drive", "sway"):
        setting = _setting(kind=source, **keys)
        trajectory = build(setting, Site(), Body(), _PERIOD_NS, Path())
    elif Path(source).suffix.lower() in _FILE_ENDINGS:
        setting = _setting(kind="file", path=source, **keys)
        trajectory = build(setting, Site(), Body(), _PERIOD_NS, Path())
    else:
        loaded = load(source)
        trajectory = build(loaded.motion, loaded.site, loaded.body, loaded.period_ns, Path())
    if trajectory is None:
        raise MotionError(f"motion: the vehicle of scenario {source} is stationary")
    return trajectory


@motion.command()
@click.argument("source", metavar="SCENARIO|FILE|drive|sway")
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path), metavar="OUT.csv|OUT.pos")
@click.option(
    "--rate",
    "rate_hz",
    type=NumberRange(0.1, 1000),
    default=10.0,
    show_default=True,
    help="Rows per second.",
)
@click.option("--duration", "duration_s", type=NumberRange(0.1, 86_400), help="Duration, s.")
@click.option("--seed", type=click.IntRange(0), help="Seed of drive or sway.")
@click.option(
    "--irregularities",
    type=click.Choice(["mend", "refuse"]),
    help="Mend or refuse irregular lines of a file.",
)
@click.option(
    "--picture",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Plot the motion to this PNG file.",
)
def export(
    source: str,
    out: Path,
    rate_hz: float,
    duration_s: float | None,
    seed: int | None,
    irregularities: str | None,
    picture: Path | None,
) -> None:
    """Export the true motion of a scenario, a recorded file or a synthetic source.

    The .csv holds position, velocity, attitude, angular rate and specific force; the .pos holds
    position and velocity. Both can be read back as recorded motion.
    """
    from rrins.host_tools.motion import plots
    from rrins.host_tools.motion.export import check_ending, write_motion

    check_ending(out)
    keys: dict[str, str | float | None] = {"seed": seed, "irregularities": irregularities}
    if source == "drive":
        keys["duration_s"] = duration_s
    trajectory = _trajectory(source, keys)
    write_motion(trajectory, out, rate_hz, duration_s)
    if picture is not None:
        plots.save(plots.draw_motion(trajectory, "\n".join(trajectory.notes)), picture)
    for note in trajectory.notes:
        print_note(note)
