"""`rrins scheme compare --case drive`: schemes in a vehicle that turns."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click
from rich.table import Table

from rrins.host_tools.calibration.turning_vehicle import Turning, compare
from rrins.host_tools.cli.scheme_observability import number
from rrins.host_tools.rotation.inputs import NamedRimu, NamedScheme
from rrins.host_tools.terminal import new_console, print_table, progress_line

_COLUMNS = (
    ("constants_m", "constants"),
    ("calibrated_m", "calibrated"),
    ("noise_m", "white noise"),
    ("calibrated_with_noise_m", "calibrated, noise"),
)


def compare_turning(
    named: Sequence[NamedScheme], rimu: NamedRimu, routes: int, as_json: bool
) -> None:
    """Compare schemes on some routes of the drive, and print the comparison."""
    schemes = [(one.name, one.scheme) for one in named]
    with progress_line(new_console(stderr=True)) as progress:
        task = progress.add_task("driving", total=routes)
        seeds = range(1, routes + 1)
        found = compare(schemes, rimu.axes_deg, rimu.errors, seeds, lambda: progress.advance(task))
    if as_json:
        result = {"case": "drive", "geometry": rimu.geometry, "routes": routes}
        click.echo(json.dumps(result | {"schemes": [one.values() for one in found]}))
        return
    print_table(_table(found, routes), new_console())


def _table(found: Sequence[Turning], routes: int) -> Table:
    title = f"σ of the position at the end of the drive, rms of {routes} routes / m"
    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    for _, heading in _COLUMNS:
        table.add_column(heading, justify="right")
    for one in found:
        values = one.values()
        table.add_row(one.name, *(number(values[key]) for key, _ in _COLUMNS))
    return table
