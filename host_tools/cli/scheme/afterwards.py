"""`rrins scheme afterwards`: how a unit navigates after a calibration by a scheme."""

from __future__ import annotations

import click
import numpy as np
from rich.table import Table

from rrins.host_tools.calibration.afterwards import CASES, VARIANTS, Afterwards, navigate
from rrins.host_tools.cli.options import (
    duration_option,
    json_option,
    option,
    seed_option,
)
from rrins.host_tools.cli.output import print_results, stepping, stopping
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rotation.inputs import scheme_of
from rrins.host_tools.rounding import coarse
from rrins.host_tools.terminal import new_table

_THREE_HOURS_S = 10_800.0


@click.command("afterwards")
@click.argument("name", metavar="SCHEME", default="calibration")
@option(
    "--case",
    "Three hours on the turning table, or the drive of the paper's 4.5, both ways.",
    tuple(CASES),
    "rotating",
)
@option("--runs", "Number of units.", click.IntRange(1, 10_000), 10)
@seed_option("the first unit")
@duration_option
@json_option
def afterwards(
    name: str, case: str, runs: int, seed: int, duration_s: float | None, as_json: bool
) -> None:
    """Calibrate emulated units by a scheme, navigate with them, and show the benefit.

    The units have drawn errors and the prototype's white noise; the attitude is given. Each
    navigates uncalibrated, calibrated, with perfect constants (the effect of noise alone), and
    calibrated without noise (the effect of the remaining errors of the constants).
    """
    scheme = scheme_of(name).scheme
    if duration_s is None and case == "rotating":
        duration_s = _THREE_HOURS_S
    with stepping("navigating", runs) as step, stopping() as stop:
        found = navigate(case, scheme, range(seed, seed + runs), duration_s, step, stop)
    result = {"scheme": name, "runs": runs, "cases": [_object(one) for one in found]}
    print_results(as_json, result, [_table(found, runs), *_lines(found)])


def _table(found: tuple[Afterwards, ...], runs: int) -> Table:
    table = new_table(f"Position error, median of {runs} units / m", "", *VARIANTS)
    for one in found:
        for word, values in (("largest", one.largest_m), ("at the end", one.end_m)):
            cells = [coarse(value) for value in np.median(values, axis=0)]
            table.add_row(f"{one.scenario}, {word}", *cells)
    return table


def _lines(found: tuple[Afterwards, ...]) -> list[str]:
    lines = []
    for one in found:
        over = one.over_floor
        lines.append(
            f"{one.scenario}: calibrated over perfect constants, largest error: median "
            f"{np.median(over):.3f}, {over.min():.2f} to {over.max():.2f}"
        )
    for one in found[1:]:
        _, calibrated, perfect, _ = (one.end_m < found[0].end_m).T
        further = int((~calibrated).sum())
        of_noise = int((~calibrated & ~perfect).sum())
        lines.append(
            f"calibrated, {one.scenario} ends nearer than {found[0].scenario} for "
            f"{calibrated.sum()} of {len(calibrated)} units; of the other {further}, {of_noise} "
            "end further off with perfect constants too: it is the noise"
        )
    return lines


def _object(one: Afterwards) -> JsonObject:
    keys = [variant.replace(", ", "_").replace(" ", "_") for variant in VARIANTS]
    return {
        "scenario": one.scenario,
        "largest_m": dict(zip(keys, one.largest_m.T.tolist(), strict=True)),
        "end_m": dict(zip(keys, one.end_m.T.tolist(), strict=True)),
        "median_over_floor": float(np.median(one.over_floor)),
    }
