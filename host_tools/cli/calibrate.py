"""`rrins calibrate`: calibrate a unit on its own table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import bus_options, json_option

if TYPE_CHECKING:
    from rich.table import Table

    from rrins.host_tools.calibration.estimation import Estimate
    from rrins.host_tools.calibration.procedure import Calibrated


@click.command()
@click.argument("scenario", required=False)
@bus_options
@click.option(
    "--timeout",
    "timeout_s",
    type=NumberRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Response timeout of a unit on a slow bus.",
)
@click.option("--rimu", "geometry", metavar="GEOMETRY", help="Sensor axes if no SCENARIO is given.")
@click.option(
    "--scheme",
    "scheme_name",
    default="calibration",
    show_default=True,
    help="Calibration scheme: a name or a TOML file.",
)
@click.option("--rate", "turn_rate_dps", type=float, help="Turn rate, °/s.")
@click.option("--stand", "stand_s", type=float, help="Rest after each turn, s.")
@click.option("--seed", type=click.IntRange(0), default=1, help="Seed of the drawn errors.")
@click.option(
    "--push", "pushes", is_flag=True, help="Store the calibration in the unit and verify it there."
)
@click.option(
    "--anew", is_flag=True, help="Start over instead of resuming a calibration that was stopped."
)
@click.option(
    "--temperature",
    "temperature_c",
    type=click.FloatRange(-100, 200),
    metavar="°C",
    help="Temperature of the sensors; stored with the calibration.",
)
@json_option
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/calibrate"),
    show_default=True,
    help="Folder for the calibration file and the report.",
)
def calibrate(
    scenario: str | None,
    interface: str,
    channel: str | None,
    bitrate: int | None,
    timeout_s: float | None,
    geometry: str | None,
    scheme_name: str,
    turn_rate_dps: float | None,
    stand_s: float | None,
    seed: int,
    pushes: bool,
    anew: bool,
    temperature_c: float | None,
    as_json: bool,
    out: Path,
) -> None:
    """Calibrate the sensors of a unit on its own table: all constants, with their uncertainty.

    With --channel, calibrate the unit on that bus, which must stand still; SCENARIO or --rimu names
    its sensors. Otherwise calibrate an emulated unit at full speed: that of SCENARIO, or one with
    the prototype's noise and drawn errors. Ctrl-C leaves the unit in STANDBY with its old
    calibration; the same command resumes from there.
    """
    from rrins.host_tools.calibration.procedure import Order
    from rrins.host_tools.calibration.procedure import calibrate as calibrate_unit
    from rrins.host_tools.cli.output import print_note

    order = Order(
        out, scenario, interface, channel, bitrate, geometry, scheme_name, turn_rate_dps, stand_s,
        seed, pushes, anew, temperature_c, timeout_s,
    )  # fmt: skip
    _print(calibrate_unit(order, print_note), as_json)


def _print(done: Calibrated, as_json: bool) -> None:
    from rrins.host_tools.calibration.report import result_of
    from rrins.host_tools.terminal import new_console, print_table

    found, errors, paths = done.estimate, done.errors, [str(path) for path in done.files]
    if as_json:
        result = result_of(found) | {"files": paths, "verified": done.verified}
        if errors is not None:
            result["rms_errors"] = dict(zip(("gyros", "accelerometers"), errors, strict=True))
        click.echo(json.dumps(result))
        return
    console = new_console()
    print_table(_table(found, errors), console)
    lines = [done.verified] if done.verified else []
    for line in (*lines, *paths):
        console.print(line, highlight=False, soft_wrap=True)


def _table(found: Estimate, errors: list[list[float]] | None) -> Table:
    from rich.table import Table

    from rrins.host_tools.calibration.report import kinds_of

    title = f"{found.seconds.total_s:.0f} s on the table"
    table = Table(title=title, title_justify="left")
    table.add_column("constant")
    count = max(len(found.gyros.constants), len(found.accelerometers.constants))
    for k in range(count):
        table.add_column(str(k + 1), justify="right")
    heads = ("σ, rms", "wanted", *(("true error, rms",) if errors else ()))
    for head in heads:
        table.add_column(head, justify="right")
    for number, kind in enumerate(kinds_of(found)):
        for k, row in enumerate(kind["rows"]):
            cells = [value for value, _ in row["cells"]]
            cells += [""] * (count - len(cells))
            more = [f"{errors[number][k]:.2g}"] if errors else []
            what = f"{kind['name'].removesuffix('s')} {row['name']} / {row['unit']}"
            table.add_row(what, *cells, row["sigma"], row["wanted"], *more)
        for word in ("before", "after"):
            cells = [*kind[word], *[""] * (count - kind["count"] + len(heads))]
            what = f"residual {word}, rms / {kind['unit']}"
            table.add_row(what, *cells, end_section=word == "after")
    return table
