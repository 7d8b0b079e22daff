"""`rrins calibrate`: calibrate a unit on its own table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.options import FOLDER, POSITIVE, bus_options, flag, json_option, option
from rrins.host_tools.cli.output import print_note, print_results

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.calibration.estimation import Estimate


@click.command()
@click.argument("scenario", required=False)
@bus_options
@option(
    "--timeout timeout_s", "Response timeout of a unit on a slow bus.", POSITIVE, metavar="SECONDS"
)
@option("--rimu geometry", "Sensor axes if no SCENARIO is given.", metavar="GEOMETRY")
@option("--scheme", "Calibration scheme: a name or a TOML file.", None, "calibration")
@option("--rate turn_rate_dps", "Turn rate, °/s.", float)
@option("--stand stand_s", "Rest after each turn, s.", float)
@option("--seed", "Seed of the drawn errors.", click.IntRange(0), 1, show_default=False)
@flag("--push pushes", "Store the calibration in the unit and verify it there.")
@flag("--anew", "Start over instead of resuming a calibration that was stopped.")
@option(
    "--temperature temperature_c",
    "Temperature of the sensors; stored with the calibration.",
    click.FloatRange(-100, 200),
    metavar="°C",
)
@json_option
@option(
    "--out folder", "Folder for the calibration file and the report.", FOLDER, Path("out/calibrate")
)
def calibrate(as_json: bool, **order: Any) -> None:
    """Calibrate the sensors of a unit on its own table: all constants, with their uncertainty.

    With --channel, calibrate the unit on that bus, which must stand still; SCENARIO or --rimu names
    its sensors. Otherwise calibrate an emulated unit at full speed: that of SCENARIO, or one with
    the prototype's noise and drawn errors. Ctrl-C leaves the unit in STANDBY with its old
    calibration; the same command resumes from there.
    """
    from rrins.host_tools.calibration.procedure import Order
    from rrins.host_tools.calibration.procedure import calibrate as calibrate_unit
    from rrins.host_tools.calibration.report import result_of

    done = calibrate_unit(Order(**order), print_note)
    found, errors, paths = done.estimate, done.errors, [str(path) for path in done.files]
    result = result_of(found) | {"files": paths, "verified": done.verified}
    if errors is not None:
        result["rms_errors"] = dict(zip(("gyros", "accelerometers"), errors, strict=True))
    lines = [done.verified] if done.verified else []
    print_results(as_json, result, [_table(found, errors), *lines, *paths])


def _table(found: Estimate, errors: list[list[float]] | None) -> Table:
    from rrins.host_tools.calibration.report import kinds_of
    from rrins.host_tools.terminal import figure, new_table

    count = max(len(found.gyros.constants), len(found.accelerometers.constants))
    heads = ("σ, rms", "wanted", *(("true error, rms",) if errors else ()))
    sensors = (str(k + 1) for k in range(count))
    title = f"{found.seconds.total_s:.0f} s on the table"
    table = new_table(title, "constant", *sensors, *heads)
    for number, kind in enumerate(kinds_of(found)):
        for k, row in enumerate(kind["rows"]):
            cells = [value for value, _ in row["cells"]]
            cells += [""] * (count - len(cells))
            more = [figure(errors[number][k], 2)] if errors else []
            what = f"{kind['name'].removesuffix('s')} {row['name']} / {row['unit']}"
            table.add_row(what, *cells, row["sigma"], row["wanted"], *more)
        for word in ("before", "after"):
            cells = [*kind[word], *[""] * (count - kind["count"] + len(heads))]
            what = f"residual {word}, rms / {kind['unit']}"
            table.add_row(what, *cells, end_section=word == "after")
    return table
