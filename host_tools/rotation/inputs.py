"""What the command line names: schemes, geometries and errors, built in or in TOML files."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from pydantic import ValidationError

from firmware_py.settings import Scheme
from host_tools.errors import ScenarioError
from host_tools.geometry import GEOMETRIES
from host_tools.outfit import hardware_settings
from host_tools.rotation.errors import sensors_of
from host_tools.rotation.merit import Rimu
from host_tools.scenario import Scenario, first_line
from host_tools.schemes import SCHEMES
from host_tools.tables import each

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
"""The errors of sensor 3 in the paper, section 4.2; here of every sensor."""

_AXES = ("gyro_axes_deg", "accelerometer_axes_deg")


@dataclass(frozen=True)
class NamedScheme:
    """A scheme and what to call it."""

    name: str
    scheme: Scheme


@dataclass(frozen=True)
class NamedRimu:
    """A RIMU with its errors, and what its geometry is called.

    `errors` are the tables `gyros` and `accelerometers` in the keys of a scenario.
    """

    geometry: str
    rimu: Rimu
    errors: dict[str, Any]


def scheme_of(
    name: str, turn_rate_dps: float | None = None, stand_s: float | None = None
) -> NamedScheme:
    """Return a scheme by its name or file.

    Parameters
    ----------
    name : str
        Built in (`host_tools.schemes`), or a TOML file: ``[[turns]]`` with `axis` and `angle_deg`,
        and `turn_rate_dps`, `stand_s`; or a scenario, whose `[firmware]` says the same.
    turn_rate_dps, stand_s : float, optional
        In place of the file's.

    Raises
    ------
    ScenarioError
        One line: which scheme, what is wrong.
    """
    if name in SCHEMES:
        table: dict[str, Any] = {"turns": SCHEMES[name]}
    else:
        table = _scheme_table(name, _read("scheme", name, SCHEMES, "rrins scheme list"))
    given = {"turn_rate_dps": turn_rate_dps, "stand_s": stand_s}
    table |= {key: value for key, value in given.items() if value is not None}
    try:
        return NamedScheme(Path(name).stem if name not in SCHEMES else name, Scheme(**table))
    except ValidationError as error:
        raise ScenarioError(f"scheme {name}: {first_line(error, Scheme)}") from error


def _scheme_table(name: str, table: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of a `Scheme` from a file's."""
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
    """Return the sensors with their errors.

    Parameters
    ----------
    geometry : str, optional
        Built in (`host_tools.geometry`), or a TOML file with `gyro_axes_deg` and
        `accelerometer_axes_deg`, at its top or in `[rimu]`. Without it that of the file of errors,
        and without that the tetrahedron.
    errors : str, optional
        TOML file with `[gyros]` and `[accelerometers]` in the keys of a scenario, or a scenario.
        Without it `PAPER_ERRORS`.
    fused, earth_latitude_deg
        As in `sensors_of` and `analyse`.

    Raises
    ------
    ScenarioError
        One line: which file, what is wrong.
    """
    where = f"errors {errors}"
    if errors is None:
        table: dict[str, Any] = {key: dict(value) for key, value in PAPER_ERRORS.items()}
        where = f"geometry {geometry}"
    else:
        table = _read("errors", errors, (), "a TOML file")
    if geometry is not None:
        table["rimu"] = _rimu_table(geometry)
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
    )


def _geometry_name(geometry: str | None, scenario: Scenario) -> str:
    if geometry is None:
        return scenario.rimu.geometry
    return geometry if geometry in GEOMETRIES else Path(geometry).stem


def _rimu_table(geometry: str) -> dict[str, Any]:
    if geometry in GEOMETRIES:
        return {"geometry": geometry}
    table = _read("geometry", geometry, GEOMETRIES, "a TOML file with gyro_axes_deg")
    table = {"geometry": "custom", **table.get("rimu", table)}
    _checked(f"geometry {geometry}", {"duration_s": 1.0, "rimu": table})
    return table


def _rimu(scenario: Scenario, fused: bool, earth_latitude_deg: float | None) -> Rimu:
    axes = (scenario.rimu.gyros, scenario.rimu.accelerometers)
    weights = (scenario.firmware.gyro_weights, scenario.firmware.accelerometer_weights)
    hardware = hardware_settings(scenario)
    return Rimu(
        gyros=sensors_of(
            "gyro", axes[0], hardware.gyros.errors, fused, each(weights[0], len(axes[0]))
        ),
        accelerometers=sensors_of(
            "accelerometer",
            axes[1],
            hardware.accelerometers.errors,
            fused,
            each(weights[1], len(axes[1])),
        ),
        earth_latitude_deg=earth_latitude_deg,
    )


def _checked(where: str, table: dict[str, Any]) -> Scenario:
    try:
        return Scenario.model_validate(table)
    except ValidationError as error:
        raise ScenarioError(f"{where}: {first_line(error)}") from error


def _read(what: str, name: str, built_in: Iterable[str], otherwise: str) -> dict[str, Any]:
    """Return a TOML file's table."""
    path = Path(name)
    try:
        is_there = path.exists()
        text = path.read_text(encoding="utf-8") if is_there else ""
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{what} {name}: cannot be read: {error}") from error
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
