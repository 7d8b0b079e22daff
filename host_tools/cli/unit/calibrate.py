"""`rrins calibrate`: calibrate a unit on its own table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrins.host_tools.cli.options import (
    FOLDER,
    POSITIVE,
    bus_options,
    flag,
    format_option,
    json_option,
    option,
)
from rrins.host_tools.cli.output import print_note, print_results

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.calibration.estimation import Estimate


_BEYOND = "less well known than is wanted; stand longer (--stand), or take a longer --scheme"


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
@flag("--strict", "End with status 12 if a constant is less well known than is wanted.")
@flag("--anew", "Start over instead of resuming a calibration that was stopped.")
@option(
    "--temperature temperature_c",
    "Temperature of the sensors; stored with the calibration.",
    click.FloatRange(-100, 200),
    metavar="°C",
)
@json_option
@format_option
@option(
    "--out folder", "Folder for the calibration file and the report.", FOLDER, Path("out/calibrate")
)
def calibrate(as_json: bool, strict: bool, **order: Any) -> None:
    """Calibrate the sensors of a unit on its own table: all constants, with their uncertainty.

    With --channel, calibrate the unit on that bus, which must stand still; SCENARIO or --rimu names
    its sensors. Otherwise calibrate an emulated unit at full speed: that of SCENARIO, or one with
    the prototype's noise and drawn errors. Ctrl-C leaves the unit in STANDBY with its old
    calibration; the same command resumes from there.
    """
    from rrins.host_tools.calibration.procedure import Order
    from rrins.host_tools.calibration.procedure import calibrate as calibrate_unit
    from rrins.host_tools.calibration.report import result_of, verdict_of
    from rrins.host_tools.errors import CalibrationRecordError

    done = calibrate_unit(Order(**order), print_note)
    found, errors, paths = done.estimate, done.errors, [str(path) for path in done.files]
    result = result_of(found) | {"files": paths, "verified": done.verified}
    if errors is not None:
        result["rms_errors"] = dict(zip(("gyros", "accelerometers"), errors, strict=True))
    lines = [verdict_of(found), *([done.verified] if done.verified else [])]
    print_results(as_json, result, [*_tables(found, errors), *lines, *paths])
    if strict and not result["as_wanted"]:
        raise CalibrationRecordError(f"calibrate: {', '.join(result['beyond_wanted'])}: {_BEYOND}")


def _tables(found: Estimate, errors: list[list[float]] | None) -> Iterator[Table | str]:
    from rrins.host_tools.calibration.observability import MARK
    from rrins.host_tools.calibration.report import SYMBOLS, kinds_of
    from rrins.host_tools.rounding import labelled, rounded
    from rrins.host_tools.terminal import new_table

    yield f"{found.seconds.total_s:.0f} s on the table"
    for number, kind in enumerate(kinds_of(found)):
        name = kind["name"].capitalize()
        sensors = [str(k + 1) for k in range(kind["count"])]
        heads = ("σ, rms", "wanted", *(("true error, rms",) if errors else ()))
        table = new_table(name, "constant", *sensors, *heads)
        for k, row in enumerate(kind["rows"]):
            values = (value for value, _ in row["cells"])
            sigma = row["sigma"] + (MARK if row["is_beyond"] else "")
            true = [rounded(errors[number][k], 2)] if errors else []
            table.add_row(labelled(row["name"], row["unit"]), *values, sigma, row["wanted"], *true)
        yield table
        residual = labelled("residual, rms", kind["unit"])
        table = new_table(f"{name}: {residual}", "", *sensors)
        for when, values in kind["residuals"].items():
            table.add_row(when, *values)
        yield table
    yield from (f"{symbol}: {meaning}" for symbol, meaning in SYMBOLS)
