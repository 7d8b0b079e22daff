"""`rrins scheme observability`, and the search for a scheme of calibration."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click
import numpy as np
from rich.table import Table

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import Unit
from rrins.host_tools.calibration.monte_carlo import Errors, run
from rrins.host_tools.calibration.observability import LIMITS, Observability, observe
from rrins.host_tools.calibration.search import Found, SearchLimits, search
from rrins.host_tools.calibration.unit import drawn_unit, unit_of
from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import json_option
from rrins.host_tools.files import JsonObject
from rrins.host_tools.interruption import as_event
from rrins.host_tools.rotation.inputs import rimu_table, scheme_of
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.terminal import new_console, print_table, progress_line

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


def unit_for(geometry: str | None) -> tuple[Unit, JsonObject]:
    """Return a unit of a geometry, and the table `[rimu]` of it."""
    table = rimu_table(geometry or "tetrahedron")
    return unit_of(drawn_unit(1, table)), table


def number(value: float) -> str:
    """Return a figure with two digits or three."""
    return f"{value:.2g}" if value < 10 else f"{value:.3g}"


@click.command("observability")
@click.argument("names", metavar="SCHEME…", nargs=-1, required=True)
@click.option(
    "--rimu",
    "geometry",
    metavar="GEOMETRY",
    help="Built-in geometry, or TOML file with the sensor axes.",
)
@click.option(
    "--rate", "turn_rate_dps", type=NumberRange(0, 60, min_open=True), help="Turn rate, °/s."
)
@click.option("--stand", "stand_s", type=NumberRange(0, 86_400), help="Rest after each turn, s.")
@click.option(
    "--gyro-noise",
    type=NumberRange(1e-9, 1e3),
    default=0.005,
    show_default=True,
    help="White noise, °/√h.",
)
@click.option(
    "--accelerometer-noise",
    type=NumberRange(1e-9, 1e6),
    default=10.0,
    show_default=True,
    help="White noise, µg/√Hz.",
)
@click.option(
    "--runs",
    type=click.IntRange(0, 10_000),
    default=0,
    help="Also calibrate this many units with drawn errors and the prototype's noise.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the first unit."
)
@json_option
def observability(
    names: tuple[str, ...],
    geometry: str | None,
    turn_rate_dps: float | None,
    stand_s: float | None,
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
    unit, rimu = unit_for(geometry)
    objects = []
    console = new_console()
    for name in names:
        named = scheme_of(name, turn_rate_dps, stand_s)
        found = observe(named.scheme, unit, gyro_noise, accelerometer_noise)
        tried = None
        if runs and not found.unseen:
            tried = _tried(named.scheme, range(seed, seed + runs), rimu)
        label = _label(geometry)
        if as_json:
            objects.append(_object(named.name, label, found, tried))
            continue
        title = f"{named.name} on {label}, {found.duration_s:.0f} s"
        print_table(_table(title, found, tried), console)
        for line in _lines(found, runs, tried):
            console.print(line, highlight=False, soft_wrap=True)
    if as_json:
        click.echo(json.dumps({"schemes": objects, "gauge": GAUGE}))
        return
    console.print(f"not seen by any scheme: {GAUGE}", highlight=False, soft_wrap=True)


def _label(geometry: str | None) -> str:
    return geometry or next(iter(GEOMETRIES))


@contextmanager
def stopping() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C sets; raise KeyboardInterrupt at the end if it was."""
    with as_event() as stop:
        yield stop
        if stop.is_set():
            raise KeyboardInterrupt


def _tried(scheme: Scheme, seeds: range, rimu: JsonObject) -> tuple[Errors, Errors]:
    with progress_line(new_console(stderr=True)) as progress, stopping() as stop:
        task = progress.add_task("calibrating", total=len(seeds))
        return run(scheme, seeds, rimu, lambda: progress.advance(task), stop)


def _table(title: str, found: Observability, tried: tuple[Errors, Errors] | None) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("constant")
    for which in ("gyros", "accel."):
        for head in (f"{which} σ", "wanted", *(("error", "error/σ") if tried else ()), "unit"):
            table.add_column(head, justify="left" if head == "unit" else "right")
    for row, (word, *units) in enumerate(ROWS):
        cells = [word]
        for kind in (0, 1):
            cells += [number(found.rms[kind][row]), number(LIMITS[kind][row])]
            if tried:
                cells += [
                    number(tried[kind].median_rms[row]),
                    f"{tried[kind].normalised[row]:.2f}",
                ]
            cells.append(units[kind])
        table.add_row(*cells)
    return table


def _lines(found: Observability, runs: int, tried: tuple[Errors, Errors] | None) -> Iterator[str]:
    base = found.base_sigma
    yield (
        f"σ of the base's attitude {number(base[0])}″, {number(base[1])}″, azimuth "
        f"{number(base[2])}″; of the axes' squareness {number(base[3])}″"
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
) -> tuple[Found, JsonObject, Iterator[Table | str]]:
    """Search for a scheme of calibration; return it, its JSON object, and what to print."""
    unit, _ = unit_for(geometry)
    found = search(unit, limits, begin, on_progress=on_progress)
    shown = observe(found.scheme, unit)
    label = _label(geometry)

    def printed() -> Iterator[Table | str]:
        yield _table(f"best found on {label}, {shown.duration_s:.0f} s", shown, None)
        yield from _lines(shown, 0, None)
        yield f"{found.merit:.2f} of what is wanted; less is better"

    result = _object("best", label, shown, None) | {"limits": vars(limits), "merit": found.merit}
    return found, result, printed()
