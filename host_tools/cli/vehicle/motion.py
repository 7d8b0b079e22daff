"""`rrins motion`: check recorded motion, export true motion."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import (
    FILE,
    FOLDER,
    PATH,
    Number,
    Picture,
    format_option,
    json_option,
    option,
)
from rrins.host_tools.cli.output import make_folder, print_note, print_results
from rrins.host_tools.drawing.saving import write_picture, write_pictures

if TYPE_CHECKING:
    from rrins.host_tools.motion.trajectory import Trajectory
    from rrins.host_tools.scenario.motion import Motion

_PERIOD_NS = 5_000_000
"""Sampling period of a motion without a scenario."""

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
@click.argument("file", type=PATH)
@option("--speed-limit speed_limit_mps", "Speed that the vehicle cannot exceed, m/s.", float)
@option(
    "--jerk-density jerk_density_mps3_per_sqrt_hz",
    "Jerk density, (m/s³)/√Hz; a higher one follows the file more closely.",
    float,
)
@option("--duration duration_s", "Use only this many seconds of the file.", float)
@option("--out", "Folder for the plot.  [default: out/motion]", FOLDER)
@format_option
@json_option
def check(file: Path, out: Path | None, as_json: bool, **keys: float | None) -> None:
    """Check a recorded motion (.csv or .pos).

    Reports duration, rate and speeds, irregular lines and how they are handled, and how far the
    smoothed path deviates from the file. Writes a plot.
    """
    from rrins.host_tools.motion import build, plots
    from rrins.host_tools.motion.findings import findings, table

    setting = _setting(kind="file", path=str(file), **keys)
    recording = build.load_recording(setting, Path())
    smoothed = build.follow(recording, setting, _PERIOD_NS)
    found = findings(recording, smoothed)
    folder = out or Path("out") / "motion"
    drawn = {file.stem: plots.draw_check(recording, smoothed)}
    (picture,) = write_pictures(make_folder(folder), drawn)
    found["picture"] = str(picture)
    print_results(as_json, found, [*table(found), f"{'picture':<16} {picture}"])


def _trajectory(source: str, keys: dict[str, str | float | None]) -> Trajectory:
    """Return the trajectory of a scenario, a file or a synthetic motion."""
    from rrins.host_tools.motion.build import build
    from rrins.host_tools.motion.errors import MotionError
    from rrins.host_tools.scenario.scenario import load
    from rrins.host_tools.scenario.tables import Body, Site

    is_file = Path(source).suffix.lower() in _FILE_ENDINGS
    if is_file or source in ("drive", "sway"):
        kind = {"kind": "file", "path": source} if is_file else {"kind": source}
        setting = _setting(**kind, **keys)
        trajectory = build(setting, Site(), Body(), _PERIOD_NS, Path())
    else:
        loaded = load(source)
        trajectory = build(loaded.motion, loaded.site, loaded.body, loaded.period_ns, Path())
    if trajectory is None:
        raise MotionError(f"motion: the vehicle of scenario {source} is stationary")
    return trajectory


@motion.command()
@click.argument("source", metavar="SCENARIO|FILE|drive|sway")
@click.argument("out", type=FILE, metavar="OUT.csv|OUT.pos")
@option("--rate rate_hz", "Rows per second.", Number(0.1, 1000), 10.0)
@option("--duration duration_s", "Duration, s.", Number(0.1, 86_400))
@option("--seed", "Seed of drive or sway.", click.IntRange(0))
@option("--irregularities", "Mend or refuse irregular lines of a file.", ("mend", "refuse"))
@option("--picture", "Plot the motion to this file: .png, .svg or .pdf.", Picture())
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
    from rrins.host_tools import files
    from rrins.host_tools.motion import plots
    from rrins.host_tools.motion.export import check_ending, write_motion

    check_ending(out)
    keys: dict[str, str | float | None] = {"seed": seed, "irregularities": irregularities}
    if source == "drive":
        keys["duration_s"] = duration_s
    trajectory = _trajectory(source, keys)
    write_motion(trajectory, out, rate_hz, duration_s)
    if picture is not None:
        files.make_folder(picture.parent)
        write_picture(picture, plots.draw_motion(trajectory, "\n".join(trajectory.notes)))
    for note in trajectory.notes:
        print_note(note)
