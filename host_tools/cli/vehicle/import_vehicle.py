"""`rrins import`: make the recording of a real vehicle a log that the firmware navigates."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.options import PATH, json_option, option
from rrins.host_tools.cli.output import print_note, print_results
from rrins.host_tools.interruption import heed_sigterm

if TYPE_CHECKING:
    from rrins.host_tools.vehicle.reading import Format


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
@click.argument("source", type=PATH)
@click.argument("log", type=PATH)
@option("--format kind", "Format of SOURCE.  [default: detected]", ("csv", "kf-gins", "navego"))
@option("--imu", "File of increments or rates, if SOURCE has several.", PATH)
@option("--gnss", "File of GNSS fixes.", PATH)
@option("--truth", "File of the reference solution.", PATH)
@option(
    "--scenario own_scenario", "TOML file with keys of a scenario, which override SOURCE.", PATH
)
@option(
    "--start start_s",
    "When navigation begins, by the clock of SOURCE; the vehicle must stand.",
    float,
    metavar="S",
)
@option("--duration duration_s", "Navigate for this many seconds.", float, metavar="S")
@option(
    "--attitude",
    "Initial attitude, °.  [default: from SOURCE, or found from the data]",
    callback=_three_angles,
    metavar="ROLL,PITCH,HEADING",
)
@json_option
def import_(
    source: Path,
    log: Path,
    attitude: tuple[float, float, float] | None,
    as_json: bool,
    kind: Format | None,
    imu: Path | None,
    gnss: Path | None,
    truth: Path | None,
    **settings: Any,
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
            **settings,
            attitude=None if attitude is None else np.radians(attitude),
            on_epochs=lambda done, total: progress.update(task, completed=done, total=total),
        )
    for note in imported.notes:
        print_note(note)
    scenario = imported.scenario
    summary = {
        "file": str(imported.file),
        "truth": None if imported.truth is None else str(imported.truth),
        "rate_hz": scenario.rate_hz,
        "duration_s": round(scenario.duration_s, 3),
        "frames": imported.frames,
        "fixes": imported.fixes,
        "notes": list(imported.notes),
    }
    text = (
        f"{imported.file}: {scenario.duration_s:.1f} s at {scenario.rate_hz} Hz, "
        f"{len(scenario.rimu.gyros)} gyros and {len(scenario.rimu.accelerometers)} "
        f"accelerometers, {imported.fixes} fixes, {'with' if imported.truth else 'without'} truth"
    )
    hint = f"navigate it: rrins replay {imported.file} --firmware"
    print_results(as_json, summary, [text, hint])
