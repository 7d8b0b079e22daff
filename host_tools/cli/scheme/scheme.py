"""`rrins scheme`: how a rotation scheme modulates the sensor errors."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import click
from rich.table import Table

from rrins.host_tools.calibration.search import SearchLimits
from rrins.host_tools.calibration.turning_vehicle import compare
from rrins.host_tools.cli.group import Group
from rrins.host_tools.cli.options import (
    FILE,
    FOLDER,
    NOT_NEGATIVE,
    Number,
    flag,
    format_option,
    gathered,
    json_option,
    option,
    rimu_option,
)
from rrins.host_tools.cli.output import make_folder, print_results, stepping
from rrins.host_tools.cli.scheme import tables
from rrins.host_tools.cli.scheme.afterwards import afterwards
from rrins.host_tools.cli.scheme.observability import (
    RateOptions,
    observability,
    rate_options,
    search_for_calibration,
)
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.rotation.analysis import analyse
from rrins.host_tools.rotation.comparison import compared, scheme_object, travel_object
from rrins.host_tools.rotation.enumeration import Limits
from rrins.host_tools.rotation.inputs import NamedRimu, rimu_of, scheme_of
from rrins.host_tools.rotation.search import search
from rrins.host_tools.rotation.travel import travel_of
from rrins.host_tools.scenario.schemes import SCHEMES
from rrins.host_tools.terminal import new_console, progress_line

_REFERENCE = "16-position"
_CALIBRATION = "calibration"
_WAIT_S = 2.0


@dataclass(frozen=True)
class RimuOptions:
    """The sensors and their errors as the options name them."""

    geometry: str | None
    errors: str | None
    fused: bool
    earth_latitude_deg: float | None

    def load(self) -> NamedRimu:
        """Return the sensors."""
        return rimu_of(self.geometry, self.errors, self.fused, self.earth_latitude_deg)

    @property
    def projection(self) -> str:
        """Which axes the errors are projected on."""
        return "fused" if self.fused else "single sensor"


_rimu_options = gathered(
    "sensors",
    RimuOptions,
    rimu_option,
    option(
        "--errors", "TOML file with [gyros] and [accelerometers].  [default: paper]", metavar="FILE"
    ),
    flag("--fused", "Weight each sensor by its share in the fused solution."),
    option(
        "--latitude earth_latitude_deg",
        "Include the Earth's rotation rate at this latitude, °.",
        Number(-90, 90),
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
    objects = [
        scheme_object(one) | {"travel": travel_object(travel_of(one.scheme))} for one in named
    ]
    lines = (f"{one.name:<24}{tables.turns_text(one.scheme)}" for one in named)
    print_results(as_json, {"schemes": objects}, lines)


@scheme.command("analyse")
@click.argument("name", metavar="SCHEME")
@_rimu_options
@rate_options
@option("--sensor", "Sensor to print and plot.  [default: 3]", click.IntRange(1))
@json_option
@format_option
@option("--out", "Folder for the plots.  [default: out/scheme/SCHEME]", FOLDER)
def analyse_scheme(
    name: str,
    sensors: RimuOptions,
    rate: RateOptions,
    sensor: int | None,
    as_json: bool,
    out: Path | None,
) -> None:
    """Show each sensor error's residual after a cycle and peak within it.

    Errors are integrated in the body frame: gyros in rad, accelerometers in m/s. Plots figures 7
    and 8 of the paper for one sensor.
    """
    named, rimu = rate.scheme(name), sensors.load()
    shown = _sensor(rimu, sensor)
    variation = analyse(
        named.scheme,
        rimu.rimu.gyros,
        rimu.rimu.accelerometers,
        earth_latitude_deg=sensors.earth_latitude_deg,
    )
    folder = make_folder(out if out is not None else Path("out") / "scheme" / named.name)
    from rrins.host_tools.rotation import pictures  # takes half a second to import

    paths = [
        str(path) for path in pictures.write(folder, variation, shown, named.name, rimu.geometry)
    ]

    def parts() -> Iterator[Table | str]:
        yield f"{named.name} on {rimu.geometry}, projection: {sensors.projection}"
        yield tables.cycle_line(named.scheme)
        for integrals in (variation.gyros, variation.accelerometers):
            if shown <= len(integrals.sensors):
                yield tables.sensor_table(integrals, shown)
        yield tables.all_sensors_table(variation)
        yield "left: after one cycle, 0 below 1e-9 of the largest; largest: within the cycle"
        if not travel_of(named.scheme).returns:
            yield "the sensors do not return to their start: the next cycle differs"
        yield from paths

    result = tables.analysis_object(named, rimu, variation)
    result |= {"projection": sensors.projection, "pictures": paths}
    print_results(as_json, result, parts())


@scheme.command("compare")
@click.argument("names", metavar="SCHEME…", nargs=-1, required=True)
@option(
    "--case",
    "A cycle at standstill, or the paper's drive: a vehicle that turns.",
    ("cycle", "drive"),
    "cycle",
)
@option("--routes", "Number of routes of the drive.", click.IntRange(1, 1000), 4)
@_rimu_options
@rate_options
@json_option
def compare_schemes(
    names: tuple[str, ...],
    case: str,
    routes: int,
    sensors: RimuOptions,
    rate: RateOptions,
    as_json: bool,
) -> None:
    """Compare schemes: residual and peak errors, time, axis travel and range.

    --case drive shows σ of the position at the end of the drive: for the constant errors of
    --errors, for those that a calibration leaves, and for white noise; each scheme as it is, and
    with the inner axis isolating the sensors from the vehicle's heading.
    """
    rimu = sensors.load()
    named = [rate.scheme(name) for name in names]
    if case == "drive":
        schemes = [(one.name, one.scheme) for one in named]
        with stepping("driving", routes) as step:
            seeds = range(1, routes + 1)
            found = [
                one.values() for one in compare(schemes, rimu.axes_deg, rimu.errors, seeds, step)
            ]
        result = {"case": "drive", "geometry": rimu.geometry, "routes": routes, "schemes": found}
        print_results(as_json, result, [tables.drive_table(found, routes)])
        return
    rows = [compared(one, rimu, sensors.earth_latitude_deg) for one in named]
    result = {
        "geometry": rimu.geometry,
        "errors": rimu.errors,
        "projection": sensors.projection,
        "earth_latitude_deg": sensors.earth_latitude_deg,
        "schemes": rows,
    }
    note = (
        "left: root of the sum of squares over all sensors, and its axes; "
        "largest: of any sensor on any axis"
    )
    print_results(as_json, result, [*tables.comparison_tables(rows), note])


@scheme.command("search")
@option(
    "--for purpose",
    "Calibration: find the quarter turns that show the sensors' constants best.",
    ("navigation", "calibration"),
    "navigation",
)
@option(
    "--time time_s",
    "Longest cycle of a calibration, s.",
    Number(0, 86_400, min_open=True),
    1720.0,
)
@option("--positions", "Half turns per cycle.", int, 16)
@option("--inner-range inner_range_deg", "Largest range of the inner axis, °.", NOT_NEGATIVE, 720.0)
@option("--outer-range outer_range_deg", "Largest range of the outer axis, °.", NOT_NEGATIVE, 360.0)
@flag("--slip-ring", "Let the inner axis rotate without limit.")
@flag("--loose", "Half turns in any order, at most two in a row on one axis.")
@_rimu_options
@rate_options
@option("--top", "Number of schemes to list.", click.IntRange(1, 100), 5)
@json_option
@option("--save", "Write the best scheme to this TOML file.", FILE)
def search_schemes(
    purpose: str,
    time_s: float,
    positions: int,
    inner_range_deg: float,
    outer_range_deg: float,
    slip_ring: bool,
    loose: bool,
    sensors: RimuOptions,
    rate: RateOptions,
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
        begin = rate.scheme(_CALIBRATION).scheme
        most = SearchLimits(
            time_s, begin.turn_rate_dps, begin.stand_s, inner_range_deg, outer_range_deg
        )
        with _late_progress() as report:
            best, result, parts = search_for_calibration(most, sensors.geometry, begin, report)
    else:
        rimu, reference = sensors.load(), rate.scheme(_REFERENCE).scheme
        limits = Limits(
            positions, inner_range_deg, outer_range_deg, slip_ring, loose,
            reference.turn_rate_dps, reference.stand_s,
        )  # fmt: skip
        with _late_progress() as report:
            found = search(limits, rimu.rimu, reference, top, report)
        best = found.best[0].scheme
        parts = [tables.search_table(found, "table 1"), tables.verdict(found, "table 1")]
        result = {
            "limits": vars(limits),
            "geometry": rimu.geometry,
            "errors": rimu.errors,
            "projection": sensors.projection,
            "count": found.count,
            "best": [tables.candidate_object(one) for one in found.best],
            "reference": {"name": _REFERENCE} | tables.candidate_object(found.reference),
            "better_than_reference": found.better,
            "equal_to_reference": found.equal,
        }
    text = tables.toml_of(best)
    if save is not None:
        try:
            save.write_text(text, encoding="utf-8")
        except OSError as error:
            raise RehearsalError(f"--save {save}: cannot be written: {error.strerror}") from error
    print_results(as_json, result | {"toml": text}, [*parts, f"\n{text.rstrip()}"])


@contextmanager
def _late_progress() -> Iterator[Callable[[int, int], None]]:
    """Give a callback for a progress bar that appears only if the work takes a while."""
    progress, begun = progress_line(new_console(stderr=True)), time.monotonic()
    task = progress.add_task("searching")

    def report(done: int, total: int) -> None:
        state = (f"{done} of {total} schemes",)
        progress.update(task, completed=done, total=total, state=state)
        if time.monotonic() - begun > _WAIT_S:
            progress.start()

    try:
        yield report
    finally:
        progress.stop()


def _sensor(rimu: NamedRimu, sensor: int | None) -> int:
    most = max(len(rimu.rimu.gyros), len(rimu.rimu.accelerometers))
    if sensor is None:
        return min(3, most)
    if sensor > most:
        raise RehearsalError(f"--sensor {sensor}: {rimu.geometry} has {most} sensors of each kind")
    return sensor
