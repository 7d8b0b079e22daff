"""`rrins scheme observability`, and the search for a scheme of calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import click
import numpy as np
from rich.table import Table

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import Unit
from rrins.host_tools.calibration.monte_carlo import Errors, run
from rrins.host_tools.calibration.observability import LIMITS, MARK, Observability, observe
from rrins.host_tools.calibration.search import SearchLimits, search
from rrins.host_tools.calibration.unit import drawn_unit, unit_of
from rrins.host_tools.cli.options import (
    Number,
    gathered,
    json_option,
    option,
    rimu_option,
    seed_option,
)
from rrins.host_tools.cli.output import print_results, stepping, stopping
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rotation.inputs import NamedScheme, rimu_table, scheme_of
from rrins.host_tools.rounding import coarse
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.terminal import new_table

ROWS = (
    ("bias", "°/h", "µg"),
    ("λ", "ppm", "ppm"),
    ("μ", "ppm", "ppm"),
    ("δu", "″", "″"),
    ("δv", "″", "″"),
)
"""Name of each constant, with the units of gyros and accelerometers."""

GAUGE = (
    "a common turn of all sensors about z_s cannot be told from the zero of the inner encoder: the "
    "encoder's reading is taken as it is"
)


@dataclass(frozen=True)
class RateOptions:
    """Turn rate and dwell in place of a scheme's own."""

    turn_rate_dps: float | None
    stand_s: float | None

    def scheme(self, name: str) -> NamedScheme:
        """Return a scheme by its name or file."""
        return scheme_of(name, self.turn_rate_dps, self.stand_s)


rate_options = gathered(
    "rate",
    RateOptions,
    option(
        "--rate turn_rate_dps",
        "Turn rate, °/s.  [default: 2, or the file's]",
        Number(0, 60, min_open=True),
    ),
    option(
        "--stand stand_s",
        "Dwell after each turn, s.  [default: 10, or the file's]",
        Number(0, 86_400),
    ),
)


def _unit_for(geometry: str | None) -> tuple[Unit, JsonObject]:
    """Return a unit of a geometry, and the table `[rimu]` of it."""
    table = rimu_table(geometry or "tetrahedron")
    return unit_of(drawn_unit(1, table)), table


@click.command("observability")
@click.argument("names", metavar="SCHEME…", nargs=-1, required=True)
@rimu_option
@rate_options
@option("--gyro-noise", "White noise, °/√h.", Number(1e-9, 1e3), 0.005)
@option("--accelerometer-noise", "White noise, µg/√Hz.", Number(1e-9, 1e6), 10.0)
@option(
    "--runs",
    "Also calibrate this many units with drawn errors and the prototype's noise.",
    click.IntRange(0, 10_000),
    0,
    show_default=False,
)
@seed_option("the first unit")
@json_option
def observability(
    names: tuple[str, ...],
    geometry: str | None,
    rate: RateOptions,
    gyro_noise: float,
    accelerometer_noise: float,
    runs: int,
    seed: int,
    as_json: bool,
) -> None:
    """Show which constants of the sensors a cycle makes observable, and their standard deviations.

    The unit is at rest, and its sensors have white noise. --runs adds a Monte Carlo: complete
    calibrations of emulated units.
    """
    unit, rimu = _unit_for(geometry)
    label, objects = _label(geometry), []
    parts: list[Table | str] = []
    for name in names:
        named = rate.scheme(name)
        found = observe(named.scheme, unit, gyro_noise, accelerometer_noise)
        tried = None
        if runs and not found.unseen:
            with stepping("calibrating", runs) as step, stopping() as stop:
                tried = run(named.scheme, range(seed, seed + runs), rimu, step, stop)
        objects.append(_object(named.name, label, found, tried))
        title = f"{named.name} on {label}, {found.duration_s:.0f} s"
        parts += [_table(title, found, tried), *_lines(found, runs, tried)]
    parts.append(f"not seen by any scheme: {GAUGE}")
    print_results(as_json, {"schemes": objects, "gauge": GAUGE}, parts)


def _label(geometry: str | None) -> str:
    return geometry or next(iter(GEOMETRIES))


def _table(title: str, found: Observability, tried: tuple[Errors, Errors] | None) -> Table:
    more = ("error", "error/σ") if tried else ()
    heads = [
        head for which in ("gyros", "accel.") for head in (f"{which} σ", "wanted", *more, "unit")
    ]
    table = new_table(title, "constant", *heads)
    for column in table.columns:
        if column.header == "unit":
            column.justify = "left"
    for row, (word, *units) in enumerate(ROWS):
        cells = [word]
        for kind in (0, 1):
            sigma, wanted = found.rms[kind][row], LIMITS[kind][row]
            cells += [coarse(sigma) + (MARK if sigma > wanted else ""), coarse(wanted)]
            if tried:
                one = tried[kind]
                cells += [coarse(one.median_rms[row]), f"{one.normalised[row]:.2f}"]
            cells.append(units[kind])
        table.add_row(*cells)
    return table


def _lines(found: Observability, runs: int, tried: tuple[Errors, Errors] | None) -> Iterator[str]:
    base = found.base_sigma
    yield f"{MARK.strip()}: σ beyond what is wanted"
    yield (
        f"σ of the base's attitude {coarse(base[0])}″, {coarse(base[1])}″, azimuth "
        f"{coarse(base[2])}″; of the axes' squareness {coarse(base[3])}″"
    )
    if tried:
        yield (
            f"error: median of {runs} units of the rms over the sensors; error/σ: rms over all of "
            "error by reported σ"
        )
    for direction in found.unseen:
        parts = ", ".join(f"{name} ({share:.0%})" for name, share in direction.parts)
        yield f"not seen: {parts}"
    if found.unseen and runs and not tried:
        yield "no Monte Carlo: the scheme does not show all constants"


def _object(
    name: str, geometry: str, found: Observability, tried: tuple[Errors, Errors] | None
) -> JsonObject:
    result: JsonObject = {
        "name": name,
        "geometry": geometry,
        "duration_s": found.duration_s,
        "base_sigma_arcsec": found.base_sigma.tolist(),
        "unseen": [{"left": d.sigma, "parts": dict(d.parts)} for d in found.unseen],
    }
    for kind, (key, unit) in enumerate((("gyros", "dph"), ("accelerometers", "ug"))):
        keys = (f"bias_{unit}", "scale_ppm", "asymmetric_ppm", "u_arcsec", "v_arcsec")
        one: JsonObject = {
            "sigma": _named(keys, found.rms[kind]),
            "wanted": _named(keys, LIMITS[kind]),
        }
        if tried:
            one |= {
                "runs": len(tried[kind].error),
                "median_rms_error": _named(keys, tried[kind].median_rms),
                "rms_error": _named(keys, tried[kind].rms),
                "reported_sigma": _named(keys, tried[kind].reported),
                "error_over_sigma": _named(keys, tried[kind].normalised),
            }
        result[key] = one
    return result


def _named(keys: tuple[str, ...], values: Floats) -> dict[str, float]:
    return dict(zip(keys, np.asarray(values).tolist(), strict=True))


def search_for_calibration(
    limits: SearchLimits,
    geometry: str | None,
    begin: Scheme,
    on_progress: Callable[[int, int], None],
) -> tuple[Scheme, JsonObject, list[Table | str]]:
    """Search for a scheme of calibration; return it, its JSON object, and what to print."""
    unit, _ = _unit_for(geometry)
    found = search(unit, limits, begin, on_progress=on_progress)
    shown = observe(found.scheme, unit)
    label = _label(geometry)
    result = _object("best", label, shown, None) | {"limits": vars(limits), "merit": found.merit}
    parts: list[Table | str] = [
        _table(f"best found on {label}, {shown.duration_s:.0f} s", shown, None),
        *_lines(shown, 0, None),
        f"{found.merit:.2f} of what is wanted; less is better",
    ]
    return found.scheme, result, parts
