"""`rrins scheme`: what a rotation scheme does to the errors of the sensors."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from host_tools.errors import RehearsalError
from host_tools.rotation import report
from host_tools.rotation.analysis import analyse
from host_tools.rotation.enumeration import Limits
from host_tools.rotation.inputs import NamedRimu, NamedScheme, rimu_of, scheme_of
from host_tools.rotation.merit import velocity_error
from host_tools.rotation.search import search
from host_tools.rotation.travel import travel_of
from host_tools.schemes import SCHEMES

_REFERENCE = "16-position"
_WAIT_S = 2.0


def _options(*options: Callable[..., Any]) -> Callable[..., Any]:
    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


_rimu_options = _options(
    click.option(
        "--rimu", "geometry", metavar="GEOMETRY", help="Built-in geometry or TOML file with axes."
    ),
    click.option(
        "--errors", metavar="FILE", help="TOML with [gyros], [accelerometers].  [default: paper]"
    ),
    click.option("--fused", is_flag=True, help="Share in the fused solution, not the one sensor."),
    click.option(
        "--latitude",
        "earth_latitude_deg",
        type=click.FloatRange(-90, 90),
        help="Let the gyros feel the Earth's rate as well, at this latitude, °.",
    ),
)
_rate_options = _options(
    click.option(
        "--rate",
        "turn_rate_dps",
        type=click.FloatRange(0, 60, min_open=True),
        help="Turn rate, °/s.  [default: 2, or the file's]",
    ),
    click.option(
        "--stand",
        "stand_s",
        type=click.FloatRange(0, 86_400),
        help="Standing after each turn, s.  [default: 10, or the file's]",
    ),
)
_json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")


@click.group("scheme")
def scheme() -> None:
    """Analyse, compare and search rotation schemes.

    A scheme is the name of a built-in one (see `rrins scheme list`) or a TOML file with [[turns]].
    """


@scheme.command("list")
@_json_option
def list_schemes(as_json: bool) -> None:
    """List the built-in schemes, a line each."""
    named = [scheme_of(name) for name in SCHEMES]
    if as_json:
        objects = [
            report.scheme_object(one) | {"travel": report.travel_object(travel_of(one.scheme))}
            for one in named
        ]
        click.echo(json.dumps({"schemes": objects}))
        return
    for one in named:
        click.echo(f"{one.name:<24}{report.short(one.scheme)}")


@scheme.command("analyse")
@click.argument("name", metavar="SCHEME")
@_rimu_options
@_rate_options
@click.option("--sensor", type=click.IntRange(1), help="Shown and drawn.  [default: 3]")
@_json_option
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the pictures.  [default: out/scheme/SCHEME]",
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
    """Tell what each error of each sensor leaves after a cycle, and how far it goes within.

    Errors are integrated in the body frame: of gyros in rad, of accelerometers in m/s. Figures 7
    and 8 of the paper are drawn for one sensor.
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
    from host_tools.rotation import pictures  # half a second that only pictures are worth

    paths = pictures.write(folder, variation, shown, named.name, rimu.geometry)
    if as_json:
        result = report.analysis_object(named, rimu, variation)
        result |= {"projection": _projection(fused), "pictures": [str(path) for path in paths]}
        click.echo(json.dumps(result))
        return
    console = Console()
    console.print(f"{named.name} on {rimu.geometry}, projection: {_projection(fused)}")
    console.print(report.cycle_line(named.scheme), highlight=False)
    for integrals in (variation.gyros, variation.accelerometers):
        if shown <= len(integrals.sensors):
            console.print(report.sensor_table(integrals, shown))
    console.print(report.all_sensors_table(variation))
    console.print(
        "left: after one cycle, 0 below 1e-9 of the largest; largest: within the cycle",
        highlight=False,
    )
    if not travel_of(named.scheme).returns:
        console.print(
            "the sensors do not end as they began: the next cycle is another one", highlight=False
        )
    for path in paths:
        console.print(str(path), highlight=False, soft_wrap=True)


@scheme.command("compare")
@click.argument("names", metavar="SCHEME…", nargs=-1, required=True)
@_rimu_options
@_rate_options
@_json_option
def compare_schemes(
    names: tuple[str, ...],
    geometry: str | None,
    errors: str | None,
    fused: bool,
    earth_latitude_deg: float | None,
    turn_rate_dps: float | None,
    stand_s: float | None,
    as_json: bool,
) -> None:
    """Put schemes side by side: errors left and within the cycle, time, wear, range of the axes."""
    rimu = rimu_of(geometry, errors, fused, earth_latitude_deg)
    compared = [
        _compared(scheme_of(name, turn_rate_dps, stand_s), rimu, earth_latitude_deg)
        for name in names
    ]
    if as_json:
        result = {
            "geometry": rimu.geometry,
            "errors": rimu.errors,
            "projection": _projection(fused),
            "earth_latitude_deg": earth_latitude_deg,
            "schemes": compared,
        }
        click.echo(json.dumps(result))
        return
    console = Console()
    for table in report.comparison_tables(compared):
        console.print(table)
    console.print(
        "left: root of the sum of squares over all sensors, and its axes; "
        "largest: of any sensor on any axis",
        highlight=False,
    )


def _compared(named: NamedScheme, rimu: NamedRimu, latitude_deg: float | None) -> dict[str, Any]:
    both = (rimu.rimu.gyros, rimu.rimu.accelerometers)
    variation = analyse(named.scheme, *both, earth_latitude_deg=latitude_deg)
    velocity = velocity_error(named.scheme, rimu.rimu)
    return report.comparison_object(named, variation, velocity)


@scheme.command("search")
@click.option("--positions", type=int, default=16, show_default=True, help="Half turns a cycle.")
@click.option(
    "--inner-range",
    "inner_range_deg",
    type=click.FloatRange(0),
    default=720.0,
    show_default=True,
    help="Widest range of the inner axis, °.",
)
@click.option(
    "--outer-range",
    "outer_range_deg",
    type=click.FloatRange(0),
    default=360.0,
    show_default=True,
    help="Widest range of the outer axis, °.",
)
@click.option("--slip-ring", is_flag=True, help="The inner axis may wind on without end.")
@click.option("--loose", is_flag=True, help="Half turns in any order, no axis three times running.")
@_rimu_options
@_rate_options
@click.option("--top", type=click.IntRange(1, 100), default=5, show_default=True)
@_json_option
@click.option("--save", type=click.Path(dir_okay=False, path_type=Path), help="TOML of the best.")
def search_schemes(
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
    """Look for the best scheme of half turns under the paper's principles.

    Best: fewest errors left after the cycle, then the least horizontal velocity error within it,
    then the narrowest ranges, then the fewest reversals. The best is printed as TOML for a
    scenario.
    """
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
        _save(save, report.toml_of(found.best[0].scheme))
    if as_json:
        result = {
            "limits": vars(limits),
            "geometry": rimu.geometry,
            "errors": rimu.errors,
            "projection": _projection(fused),
            "count": found.count,
            "best": [report.candidate_object(one) for one in found.best],
            "reference": {"name": _REFERENCE} | report.candidate_object(found.reference),
            "better_than_reference": found.better,
            "equal_to_reference": found.equal,
            "toml": report.toml_of(found.best[0].scheme),
        }
        click.echo(json.dumps(result))
        return
    console = Console()
    console.print(report.search_table(found, "table 1"))
    console.print(report.verdict(found, "table 1"), highlight=False)
    click.echo(f"\n{report.toml_of(found.best[0].scheme)}", nl=False)


class _LateProgress:
    """A progress bar on standard error that appears only where the work takes a while."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("searching"),
            BarColumn(),
            TextColumn("{task.completed} of {task.total} schemes"),
            TimeRemainingColumn(compact=True),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._progress.add_task("searching")
        self._begun = time.monotonic()

    def __enter__(self) -> _LateProgress:
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.stop()

    def report(self, done: int, total: int) -> None:
        """Take how far the work is."""
        self._progress.update(self._task, completed=done, total=total)
        if time.monotonic() - self._begun > _WAIT_S:
            self._progress.start()


def _projection(fused: bool) -> str:
    return "fused" if fused else "single sensor"


def _sensor(rimu: NamedRimu, sensor: int | None) -> int:
    most = max(len(rimu.rimu.gyros), len(rimu.rimu.accelerometers))
    if sensor is None:
        return min(3, most)
    if sensor > most:
        raise RehearsalError(f"--sensor {sensor}: {rimu.geometry} has {most} sensors of a kind")
    return sensor


def _folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RehearsalError(f"--out {folder}: cannot be made: {error.strerror}") from error
    return folder


def _save(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RehearsalError(f"--save {path}: cannot be written: {error.strerror}") from error
