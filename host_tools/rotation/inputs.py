"""Resolves names on the command line: schemes, geometries and errors, built in or in TOML files."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from pydantic import ValidationError

from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.files import JsonObject, text_of
from rrins.host_tools.rotation.errors import sensors_of
from rrins.host_tools.rotation.merit import SensorSet
from rrins.host_tools.scenario.geometry import GEOMETRIES, AxesDeg
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.schemes import SCHEMES
from rrins.host_tools.scenario.tables import each
from rrins.host_tools.scenario.wrong_keys import first_line

PAPER_ERRORS: Final = MappingProxyType(
    {
        "gyros": {
            "bias_dph": 0.1,
            "scale_error_ppm": 50.0,
            "asymmetric_scale_error_ppm": 50.0,
            "installation_u_arcsec": 10.0,
            "installation_v_arcsec": 10.0,
        },
        "accelerometers": {
            "bias_ug": 50.0,
            "scale_error_ppm": 30.0,
            "asymmetric_scale_error_ppm": 30.0,
            "installation_u_arcsec": 10.0,
            "installation_v_arcsec": 10.0,
        },
    }
)
"""The errors of sensor 3 in the paper, section 4.2; used here for every sensor."""

_AXES = ("gyro_axes_deg", "accelerometer_axes_deg")


@dataclass(frozen=True)
class NamedScheme:
    """A scheme and its name."""

    name: str
    scheme: Scheme


@dataclass(frozen=True)
class NamedRimu:
    """A RIMU with its errors, and the name of its geometry.

    `errors` holds the tables `gyros` and `accelerometers` with a scenario's keys, `axes_deg` the
    input axes of gyros and accelerometers.
    """

    geometry: str
    rimu: SensorSet
    errors: JsonObject
    axes_deg: tuple[AxesDeg, AxesDeg]


def scheme_of(
    name: str, turn_rate_dps: float | None = None, stand_s: float | None = None
) -> NamedScheme:
    """Return a scheme by its name or file.

    Parameters
    ----------
    name : str
        Built in (`scenario.schemes`), or a TOML file: ``[[turns]]`` with `axis` and `angle_deg`,
        and `turn_rate_dps`, `stand_s`; or a scenario with the same in `[firmware]`.
    turn_rate_dps, stand_s : float, optional
        Override the file's values.

    Raises
    ------
    ScenarioError
        In one line: which scheme, what is wrong.
    """
    if name in SCHEMES:
        table: JsonObject = {"turns": SCHEMES[name]}
    else:
        table = _scheme_table(name, _read("scheme", name, SCHEMES, "rrins scheme list"))
    given = {"turn_rate_dps": turn_rate_dps, "stand_s": stand_s}
    table |= {key: value for key, value in given.items() if value is not None}
    try:
        return NamedScheme(Path(name).stem if name not in SCHEMES else name, Scheme(**table))
    except ValidationError as error:
        raise ScenarioError(f"scheme {name}: {first_line(error, Scheme)}") from None


def _scheme_table(name: str, table: JsonObject) -> JsonObject:
    """Convert a file's keys to those of a `Scheme`."""
    if "firmware" not in table:
        return table
    firmware = _checked(f"scheme {name}", {"duration_s": 1.0, **table}).scheme
    return firmware.model_dump()


def rimu_of(
    geometry: str | None = None,
    errors: str | None = None,
    fused: bool = False,
    earth_latitude_deg: float | None = None,
) -> NamedRimu:
    """Return the sensors and their errors.

    Parameters
    ----------
    geometry : str, optional
        Built in (`rrins.host_tools.scenario.geometry`), or a TOML file with `gyro_axes_deg` and
        `accelerometer_axes_deg`, at top level or in `[rimu]`. Defaults to the geometry of the
        error file, or else to the tetrahedron.
    errors : str, optional
        TOML file with `[gyros]` and `[accelerometers]` with a scenario's keys, or a scenario.
        Defaults to `PAPER_ERRORS`.
    fused, earth_latitude_deg
        As in `sensors_of` and `analyse`.

    Raises
    ------
    ScenarioError
        In one line: which file, what is wrong.
    """
    where = f"errors {errors}"
    if errors is None:
        table: JsonObject = {key: dict(value) for key, value in PAPER_ERRORS.items()}
        where = f"geometry {geometry}"
    else:
        table = _read("errors", errors, (), "a TOML file")
    if geometry is not None:
        table["rimu"] = rimu_table(geometry)
    scenario = _checked(where, {"duration_s": 1.0, **table})
    return NamedRimu(
        geometry=_geometry_name(geometry, scenario),
        rimu=_rimu(scenario, fused, earth_latitude_deg),
        errors={
            "gyros": scenario.gyros.model_dump(include=set(PAPER_ERRORS["gyros"])),
            "accelerometers": scenario.accelerometers.model_dump(
                include=set(PAPER_ERRORS["accelerometers"])
            ),
        },
        axes_deg=(scenario.rimu.gyros, scenario.rimu.accelerometers),
    )


def _geometry_name(geometry: str | None, scenario: Scenario) -> str:
    if geometry is None:
        return scenario.rimu.geometry
    return geometry if geometry in GEOMETRIES else Path(geometry).stem


def rimu_table(geometry: str) -> JsonObject:
    """Return the table `[rimu]` of a built-in geometry, or of a TOML file with sensor axes.

    Raises
    ------
    ScenarioError
        In one line: which file, what is wrong.
    """
    if geometry in GEOMETRIES:
        return {"geometry": geometry}
    table = _read("geometry", geometry, GEOMETRIES, "a TOML file with gyro_axes_deg")
    table = {"geometry": "custom", **table.get("rimu", table)}
    _checked(f"geometry {geometry}", {"duration_s": 1.0, "rimu": table})
    return table


def _rimu(scenario: Scenario, fused: bool, earth_latitude_deg: float | None) -> SensorSet:
    axes = (scenario.rimu.gyros, scenario.rimu.accelerometers)
    weights = (scenario.firmware.gyro_weights, scenario.firmware.accelerometer_weights)
    return SensorSet(
        gyros=sensors_of("gyro", axes[0], scenario.gyros, fused, each(weights[0], len(axes[0]))),
        accelerometers=sensors_of(
            "accelerometer",
            axes[1],
            scenario.accelerometers,
            fused,
            each(weights[1], len(axes[1])),
        ),
        earth_latitude_deg=earth_latitude_deg,
    )


def _checked(where: str, table: JsonObject) -> Scenario:
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"{where}: {first_line(error, Scenario)}") from None


def _read(what: str, name: str, built_in: Iterable[str], otherwise: str) -> JsonObject:
    """Return a TOML file's table."""
    path = Path(name)
    try:
        is_there = path.exists()
        text = text_of(path) if is_there else ""
    except (OSError, ValueError) as error:  # ValueError: a path that no system has
        why = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{what} {name}: cannot be read: {why}") from error
    if not is_there:
        near = difflib.get_close_matches(name, list(built_in), 1)
        hint = f"did you mean {near[0]}?" if near else f"see `{otherwise}`"
        raise ScenarioError(f"{what} {name}: {_absent(built_in)}; {hint}")
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise ScenarioError(f"{what} {name}: not TOML: {error}") from error
    except RecursionError as error:
        raise ScenarioError(f"{what} {name}: nested too deeply") from error


def _absent(built_in: Iterable[str]) -> str:
    return "neither built in nor a file" if list(built_in) else "no such file"
