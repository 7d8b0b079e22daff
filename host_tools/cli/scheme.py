"""`rrins scheme`: how a rotation scheme modulates the sensor errors."""

from __future__ import annotations

import json
import time
from pathlib import Path

import click

from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.search import SearchLimits
from rrins.host_tools.cli import scheme_tables
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.numbers import NumberRange
from rrins.host_tools.cli.options import json_option, together
from rrins.host_tools.cli.scheme_afterwards import afterwards
from rrins.host_tools.cli.scheme_drive import compare_turning
from rrins.host_tools.cli.scheme_observability import observability, search_for_calibration
from rrins.host_tools.closing import Closing
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.rotation.analysis import analyse
from rrins.host_tools.rotation.comparison import compared, scheme_object, travel_object
from rrins.host_tools.rotation.enumeration import Limits
from rrins.host_tools.rotation.inputs import NamedRimu, rimu_of, scheme_of
from rrins.host_tools.rotation.search import search
from rrins.host_tools.rotation.travel import travel_of
from rrins.host_tools.scenario.schemes import SCHEMES
from rrins.host_tools.terminal import new_console, print_table, progress_line

_REFERENCE = "16-position"
_CALIBRATION = "calibration"
_WAIT_S = 2.0


_rimu_options = together(
    click.option(
        "--rimu",
        "geometry",
        metavar="GEOMETRY",
        help="Built-in geometry, or TOML file with the sensor axes.",
    ),
    click.option(
        "--errors",
        metavar="FILE",
        help="TOML file with [gyros] and [accelerometers].  [default: paper]",
    ),
    click.option(
        "--fused",
        is_flag=True,
        help="Weight each sensor by its share in the fused solution.",
    ),
    click.option(
        "--latitude",
        "earth_latitude_deg",
        type=NumberRange(-90, 90),
        help="Include the Earth's rotation rate at this latitude, °.",
    ),
)
_rate_options = together(
    click.option(
        "--rate",
        "turn_rate_dps",
        type=NumberRange(0, 60, min_open=True),
        help="Turn rate, °/s.  [default: 2, or the file's]",
    ),
    click.option(
        "--stand",
        "stand_s",
        type=NumberRange(0, 86_400),
        help="Dwell after each turn, s.  [default: 10, or the file's]",
    ),
)


@click.group("scheme", cls=Group)
def scheme() -> None:
    """Analyse, compare and search rotation schemes.

    SCHEME is a built-in name (see `rrins scheme list`) or a TOML file with [[turns]].
    """


scheme.add_command(observability)
scheme.add_command(afterwards)


@scheme.command("list")
@json_option
def list_schemes(as_json: bool) -> None:
    """List the built-in schemes, one per line."""
    named = [scheme_of(name) for name in SCHEMES]
    if as_json:
        objects = [
            scheme_object(one) | {"travel": travel_object(travel_of(one.scheme))} for one in named
        ]
        click.echo(json.dumps({"schemes": objects}))
        return
    for one in named:
        click.echo(f"{one.name:<24}{scheme_tables.turns_text(one.scheme)}")


@scheme.command("analyse")
@click.argument("name", metavar="SCHEME")
@_rimu_options
@_rate_options
@click.option("--sensor", type=click.IntRange(1), help="Sensor to print and plot.  [default: 3]")
@json_option
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the plots.  [default: out/scheme/SCHEME]",
)
def analyse_scheme(
    name: str,
    geometry: str | None,
    errors: str | None,
    fused: bool,
    earth_latitude_deg: float | None,
    turn_rate_dps: float | None,
    stand_s: float | None,
    sensor: int | None,
    as_json: bool,
    out: Path | None,
) -> None:
    """Show each sensor error's residual after a cycle and peak within it.

    Errors are integrated in the body frame: gyros in rad, accelerometers in m/s. Plots figures 7
    and 8 of the paper for one sensor.
    """
    named = scheme_of(name, turn_rate_dps, stand_s)
    rimu = rimu_of(geometry, errors, fused, earth_latitude_deg)
    shown = _sensor(rimu, sensor)
    variation = analyse(
        named.scheme,
        rimu.rimu.gyros,
        rimu.rimu.accelerometers,
        earth_latitude_deg=earth_latitude_deg,
    )
    folder = _folder(out if out is not None else Path("out") / "scheme" / named.name)
    from rrins.host_tools.rotation import pictures  # takes half a second to import

    paths = pictures.write(folder, variation, shown, named.name, rimu.geometry)
    if as_json:
        result = scheme_tables.analysis_object(named, rimu, variation)
        result |= {"projection": _projection(fused), "pictures": [str(path) for path in paths]}
        click.echo(json.dumps(result))
        return
    console = new_console()
    console.print(
        f"{named.name} on {rimu.geometry}, projection: {_projection(fused)}", soft_wrap=True
    )
    console.print(scheme_tables.cycle_line(named.scheme), highlight=False, soft_wrap=True)
    for integrals in (variation.gyros, variation.accelerometers):
        if shown <= len(integrals.sensors):
            print_table(scheme_tables.sensor_table(integrals, shown), console)
    print_table(scheme_tables.all_sensors_table(variation), console)
    console.print(
        "left: after one cycle, 0 below 1e-9 of the largest; largest: within the cycle",
        highlight=False,
        soft_wrap=True,
    )
    if not travel_of(named.scheme).returns:
        console.print(
            "the sensors do not return to their start: the next cycle differs",
            highlight=False,
            soft_wrap=True,
        )
    for path in paths:
        console.print(str(path), highlight=False, soft_wrap=True)


@scheme.command("compare")
@click.argument("names", metavar="SCHEME…", nargs=-1, required=True)
@click.option(
    "--case",
    type=click.Choice(["cycle", "drive"]),
    default="cycle",
    show_default=True,
    help="A cycle at standstill, or the paper's drive: a vehicle that turns.",
)
@click.option(
    "--routes",
    type=click.IntRange(1, 1000),
    default=4,
    show_default=True,
    help="Number of routes of the drive.",
)
@_rimu_options
@_rate_options
@json_option
def compare_schemes(
    names: tuple[str, ...],
    case: str,
    routes: int,
    geometry: str | None,
    errors: str | None,
    fused: bool,
    earth_latitude_deg: float | None,
    turn_rate_dps: float | None,
    stand_s: float | None,
    as_json: bool,
) -> None:
    """Compare schemes: residual and peak errors, time, axis travel and range.

    --case drive shows σ of the position at the end of the drive: for the constant errors of
    --errors, for those that a calibration leaves, and for white noise; each scheme as it is, and
    with the inner axis isolating the sensors from the vehicle's heading.
    """
    rimu = rimu_of(geometry, errors, fused, earth_latitude_deg)
    if case == "drive":
        named = [scheme_of(name, turn_rate_dps, stand_s) for name in names]
        compare_turning(named, rimu, routes, as_json)
        return
    rows = [
        compared(scheme_of(name, turn_rate_dps, stand_s), rimu, earth_latitude_deg)
        for name in names
    ]
    if as_json:
        result = {
            "geometry": rimu.geometry,
            "errors": rimu.errors,
            "projection": _projection(fused),
            "earth_latitude_deg": earth_latitude_deg,
            "schemes": rows,
        }
        click.echo(json.dumps(result))
        return
    console = new_console()
    for table in scheme_tables.comparison_tables(rows):
        print_table(table, console)
    console.print(
        "left: root of the sum of squares over all sensors, and its axes; "
        "largest: of any sensor on any axis",
        highlight=False,
        soft_wrap=True,
    )


@scheme.command("search")
@click.option(
    "--for",
    "purpose",
    type=click.Choice(["navigation", "calibration"]),
    default="navigation",
    show_default=True,
    help="Calibration: find the quarter turns that show the sensors' constants best.",
)
@click.option(
    "--time",
    "time_s",
    type=NumberRange(0, 86_400, min_open=True),
    default=1720.0,
    show_default=True,
    help="Longest cycle of a calibration, s.",
)
@click.option("--positions", type=int, default=16, show_default=True, help="Half turns per cycle.")
@click.option(
    "--inner-range",
    "inner_range_deg",
    type=NumberRange(0),
    default=720.0,
    show_default=True,
    help="Largest range of the inner axis, °.",
)
@click.option(
    "--outer-range",
    "outer_range_deg",
    type=NumberRange(0),
    default=360.0,
    show_default=True,
    help="Largest range of the outer axis, °.",
)
@click.option("--slip-ring", is_flag=True, help="Let the inner axis rotate without limit.")
@click.option(
    "--loose", is_flag=True, help="Half turns in any order, at most two in a row on one axis."
)
@_rimu_options
@_rate_options
@click.option(
    "--top",
    type=click.IntRange(1, 100),
    default=5,
    show_default=True,
    help="Number of schemes to list.",
)
@json_option
@click.option(
    "--save",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write the best scheme to this TOML file.",
)
def search_schemes(
    purpose: str,
    time_s: float,
    positions: int,
    inner_range_deg: float,
    outer_range_deg: float,
    slip_ring: bool,
    loose: bool,
    geometry: str | None,
    errors: str | None,
    fused: bool,
    earth_latitude_deg: float | None,
    turn_rate_dps: float | None,
    stand_s: float | None,
    top: int,
    as_json: bool,
    save: Path | None,
) -> None:
    """Search for the best scheme of half turns under the paper's principles.

    Best means: fewest residual errors after the cycle, then the smallest horizontal velocity error
    within it, then the narrowest axis ranges, then the fewest reversals. The best scheme is printed
    as TOML for a scenario.
    """
    if purpose == "calibration":
        begin = scheme_of(_CALIBRATION, turn_rate_dps, stand_s).scheme
        most = SearchLimits(
            time_s, begin.turn_rate_dps, begin.stand_s, inner_range_deg, outer_range_deg
        )
        _search_for_calibration(most, geometry, begin, as_json, save)
        return
    rimu = rimu_of(geometry, errors, fused, earth_latitude_deg)
    reference = scheme_of(_REFERENCE, turn_rate_dps, stand_s)
    limits = Limits(
        positions,
        inner_range_deg,
        outer_range_deg,
        slip_ring,
        loose,
        reference.scheme.turn_rate_dps,
        reference.scheme.stand_s,
    )
    with _LateProgress() as progress:
        found = search(limits, rimu.rimu, reference.scheme, top, progress.report)
    if save is not None:
        _save(save, scheme_tables.toml_of(found.best[0].scheme))
    if as_json:
        result = {
            "limits": vars(limits),
            "geometry": rimu.geometry,
            "errors": rimu.errors,
            "projection": _projection(fused),
            "count": found.count,
            "best": [scheme_tables.candidate_object(one) for one in found.best],
            "reference": {"name": _REFERENCE} | scheme_tables.candidate_object(found.reference),
            "better_than_reference": found.better,
            "equal_to_reference": found.equal,
            "toml": scheme_tables.toml_of(found.best[0].scheme),
        }
        click.echo(json.dumps(result))
        return
    console = new_console()
    print_table(scheme_tables.search_table(found, "table 1"), console)
    console.print(scheme_tables.verdict(found, "table 1"), highlight=False, soft_wrap=True)
    click.echo(f"\n{scheme_tables.toml_of(found.best[0].scheme)}", nl=False)


def _search_for_calibration(
    limits: SearchLimits, geometry: str | None, begin: Scheme, as_json: bool, save: Path | None
) -> None:
    with _LateProgress() as progress:
        found, result, printed = search_for_calibration(limits, geometry, begin, progress.report)
    text = scheme_tables.toml_of(found.scheme)
    if save is not None:
        _save(save, text)
    if as_json:
        click.echo(json.dumps(result | {"toml": text}))
        return
    console = new_console()
    for part in printed:
        if isinstance(part, str):
            console.print(part, highlight=False, soft_wrap=True)
        else:
            print_table(part, console)
    click.echo(f"\n{text}", nl=False)


class _LateProgress(Closing):
    """A progress bar on standard error that appears only if the work takes a while."""

    def __init__(self) -> None:
        self._progress = progress_line(new_console(stderr=True))
        self._task = self._progress.add_task("searching")
        self._begun = time.monotonic()

    def close(self) -> None:
        """Remove it from the terminal."""
        self._progress.stop()

    def report(self, done: int, total: int) -> None:
        """Update the progress."""
        state = (f"{done} of {total} schemes",)
        self._progress.update(self._task, completed=done, total=total, state=state)
        if time.monotonic() - self._begun > _WAIT_S:
            self._progress.start()


def _projection(fused: bool) -> str:
    return "fused" if fused else "single sensor"


def _sensor(rimu: NamedRimu, sensor: int | None) -> int:
    most = max(len(rimu.rimu.gyros), len(rimu.rimu.accelerometers))
    if sensor is None:
        return min(3, most)
    if sensor > most:
        raise RehearsalError(f"--sensor {sensor}: {rimu.geometry} has {most} sensors of each kind")
    return sensor


def _folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be created: {error.strerror}") from error
    return folder


def _save(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RehearsalError(f"--save {path}: cannot be written: {error.strerror}") from error
