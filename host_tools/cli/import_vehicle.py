"""`rrins import`: make the recording of a real vehicle a log that the firmware navigates."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.options import json_option
from rrins.host_tools.cli.output import print_note
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.vehicle.importing import Imported
    from rrins.host_tools.vehicle.reading import Format

_FILE = click.Path(path_type=Path)


def _three_angles(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> tuple[float, float, float] | None:
    if text is None:
        return None
    try:
        roll, pitch, heading = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not ROLL,PITCH,HEADING in °") from None
    if not (abs(roll) <= 180 and abs(pitch) < 90 and abs(heading) <= 360):
        raise click.BadParameter("roll within ±180°, pitch within ±90°, heading within ±360°")
    return roll, pitch, heading


@click.command("import")
@click.argument("source", type=_FILE)
@click.argument("log", type=_FILE)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["csv", "kf-gins", "navego"]),
    help="Format of SOURCE.  [default: detected]",
)
@click.option("--imu", type=_FILE, help="File of increments or rates, if SOURCE has several.")
@click.option("--gnss", type=_FILE, help="File of GNSS fixes.")
@click.option("--truth", type=_FILE, help="File of the reference solution.")
@click.option(
    "--scenario",
    type=_FILE,
    help="TOML file with keys of a scenario, which override SOURCE.",
)
@click.option(
    "--start",
    "start_s",
    type=float,
    metavar="S",
    help="When navigation begins, by the clock of SOURCE; the vehicle must stand.",
)
@click.option(
    "--duration", "duration_s", type=float, metavar="S", help="Navigate for this many seconds."
)
@click.option(
    "--attitude",
    callback=_three_angles,
    metavar="ROLL,PITCH,HEADING",
    help="Initial attitude, °.  [default: from SOURCE, or found from the data]",
)
@json_option
def import_(
    source: Path,
    log: Path,
    kind: Format | None,
    imu: Path | None,
    gnss: Path | None,
    truth: Path | None,
    scenario: Path | None,
    start_s: float | None,
    duration_s: float | None,
    attitude: tuple[float, float, float] | None,
    as_json: bool,
) -> None:
    """Convert SOURCE, the recording of a real vehicle, into LOG, the recording of a bus.

    SOURCE is a folder or a file: CSV as written by `rrins increments`, a KF-GINS configuration,
    or .mat structures of NaveGo. `rrins replay LOG --firmware` navigates it.
    """
    import numpy as np

    from rrins.host_tools.terminal import new_console, progress_line
    from rrins.host_tools.vehicle import importing, reading

    heed_sigterm()
    recording = reading.read(source, kind, imu, gnss, truth)
    with progress_line(new_console(stderr=True), as_json) as progress:
        task = progress.add_task("importing", total=None)
        imported = importing.write(
            recording,
            log,
            scenario,
            start_s,
            duration_s,
            None if attitude is None else np.radians(attitude),
            lambda done, total: progress.update(task, completed=done, total=total),
        )
    for note in imported.notes:
        print_note(note)
    _print(imported, as_json)


def _print(imported: Imported, as_json: bool) -> None:
    scenario = imported.scenario
    if as_json:
        summary = {
            "file": str(imported.file),
            "truth": None if imported.truth is None else str(imported.truth),
            "rate_hz": scenario.rate_hz,
            "duration_s": round(scenario.duration_s, 3),
            "frames": imported.frames,
            "fixes": imported.fixes,
            "notes": list(imported.notes),
        }
        click.echo(json.dumps(summary))
        return
    click.echo(
        f"{imported.file}: {scenario.duration_s:.1f} s at {scenario.rate_hz} Hz, "
        f"{len(scenario.rimu.gyros)} gyros and {len(scenario.rimu.accelerometers)} "
        f"accelerometers, {imported.fixes} fixes, {'with' if imported.truth else 'without'} truth"
    )
    click.echo(f"navigate it: rrins replay {imported.file} --firmware")
