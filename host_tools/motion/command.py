"""`rrins motion`: looks at recorded motions and writes true ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

_FILE_ENDINGS = (".csv", ".pos")


@click.group()
def motion() -> None:
    """Look at recorded motions, write the true motion of a scenario."""


def _setting(**keys: Any) -> Any:
    """Return the table `[motion]` that options stand for; wrong ones are an error of usage."""
    from pydantic import ValidationError

    from host_tools.motion.settings import Motion

    try:
        return Motion.model_validate({k: v for k, v in keys.items() if v is not None})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        message = first["msg"].removeprefix("Value error, ")
        raise click.UsageError(f"{where}: {message}" if where else message) from error


@motion.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--speed-limit", type=float, help="m/s that the vehicle cannot have.")
@click.option("--jerk-density", type=float, help="(m/s³)/√Hz; more follows the file closer.")
@click.option("--duration", "duration_s", type=float, help="Seconds of the file to take.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the picture.  [default: out/motion]",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def check(
    file: Path,
    speed_limit: float | None,
    jerk_density: float | None,
    duration_s: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Tell what is in a recorded motion: .csv or .pos.

    Span, rate, speeds, what is irregular at which line and what is done about it, how far the
    smoothed path lies from the file; and a picture.
    """
    from host_tools.motion import build, plots
    from host_tools.motion.findings import findings, table

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
"""Sampling period that a motion without a scenario is made for."""


def _trajectory(source: str, keys: dict[str, Any]) -> Any:
    """Return the trajectory of a scenario, a file, or a kind of synthetic motion."""
    from host_tools import scenario as scenarios
    from host_tools.motion.build import build
    from host_tools.motion.errors import MotionError
    from host_tools.tables import Body, Site

    path = Path(source)
    if source in ("drive", "sway"):
        setting, site, body = _setting(kind=source, **keys), Site(), Body()
        return build(setting, site, body, _PERIOD_NS, Path())
    if path.suffix.lower() in _FILE_ENDINGS:
        setting = _setting(kind="file", path=source, **keys)
        return build(setting, Site(), Body(), _PERIOD_NS, Path())
    loaded = scenarios.load(source)
    found = build(loaded.motion, loaded.site, loaded.body, loaded.period_ns, Path())
    if found is None:
        raise MotionError(f"motion: the vehicle of scenario {source} stands still")
    return found


@motion.command()
@click.argument("source", metavar="SCENARIO|FILE|drive|sway")
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path), metavar="OUT.csv|OUT.pos")
@click.option(
    "--rate",
    "rate_hz",
    type=click.FloatRange(0.1, 1000),
    default=10.0,
    show_default=True,
    help="Rows per second.",
)
@click.option("--duration", "duration_s", type=click.FloatRange(0.1, 86_400), help="Seconds.")
@click.option("--seed", type=click.IntRange(0), help="Of drive and sway.")
@click.option("--irregularities", type=click.Choice(["mend", "refuse"]), help="Of a file.")
@click.option("--picture", type=click.Path(dir_okay=False, path_type=Path), help="PNG to draw.")
def export(
    source: str,
    out: Path,
    rate_hz: float,
    duration_s: float | None,
    seed: int | None,
    irregularities: str | None,
    picture: Path | None,
) -> None:
    """Write a true motion: of a scenario, along a recorded file, or a synthetic one.

    The .csv has place, velocity, attitude, angular rate and specific force; the .pos has place and
    velocity. Both can be read again as recorded motions.
    """
    from host_tools.motion import plots
    from host_tools.motion.export import check_ending
    from host_tools.motion.export import export as write

    check_ending(out)
    keys: dict[str, Any] = {"seed": seed, "irregularities": irregularities}
    if source == "drive":
        keys["duration_s"] = duration_s
    trajectory = _trajectory(source, keys)
    write(trajectory, out, rate_hz, duration_s)
    if picture is not None:
        plots.save(plots.draw_motion(trajectory, "\n".join(trajectory.notes)), picture)
    for note in trajectory.notes:
        click.echo(f"rrins: {note}", err=True)
