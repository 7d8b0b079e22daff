"""The sets of sensors that are compared: a scenario, or geometries with the sensors of a preset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rotation.inputs import rimu_table
from rrins.host_tools.runs.set_up.settings import check_files
from rrins.host_tools.scenario import presets, scenario
from rrins.host_tools.scenario.geometry import GEOMETRIES
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Rimu

BUILT_IN: Final = ("tetrahedron", "cone", "orthogonal-plus-one", "dodecahedron")
"""The geometries that are compared where none is named."""

PRESET = "prototype"
"""The sensors where neither a scenario nor a preset is named."""

_ANY_DURATION_S = 6000.0
_LEAST_SENSORS = 4


@dataclass(frozen=True)
class Candidate:
    """A set of sensors, with what is done with it."""

    name: str
    scenario: Scenario  #: compares its sensors; has no faults


def candidates_of(
    name: str | None = None,
    geometries: Sequence[str] = (),
    preset: str | None = None,
    false_alarms_per_1000_h: float | None = None,
) -> list[Candidate]:
    """Return what is to be compared.

    Parameters
    ----------
    name : str, optional
        Scenario, built in or a TOML file. Without one, the vehicle stands and the table turns.
    geometries : sequence of str
        Built in, or TOML files with sensor axes; each takes the place of the scenario's. Without
        any, the scenario's own, or `BUILT_IN`.
    preset : str, optional
        Sensors that take the place of the scenario's. A value per sensor becomes the largest one,
        for all, where a geometry has another number of sensors.
    false_alarms_per_1000_h : float, optional
        Takes the place of the scenario's.

    Raises
    ------
    ScenarioError
        In one line: which scenario, geometry or preset, what is wrong.
    MotionError
        When a recorded motion cannot be used.
    """
    if name is None:
        base: JsonObject = {"duration_s": _ANY_DURATION_S, "sensors": preset or PRESET}
        geometries = geometries or BUILT_IN
    else:
        base = scenario.load(name).model_dump(mode="json", exclude_unset=True, exclude_none=True)
        if preset is not None:
            base |= {"sensors": preset, "gyros": {}, "accelerometers": {}}
    base.pop("faults", None)
    base.pop("paper", None)
    redundancy = dict(base.get("redundancy", {})) | {"enabled": True}
    if false_alarms_per_1000_h is not None:
        redundancy["false_alarms_per_1000_h"] = false_alarms_per_1000_h
    base["redundancy"] = redundancy
    if geometries:
        found = [_with_geometry(base, name, geometry) for geometry in geometries]
    else:
        assert name is not None
        found = [Candidate(_short(name), scenario.parse(base, name))]
    for candidate in found:
        rimu = candidate.scenario.rimu
        if max(len(rimu.gyros), len(rimu.accelerometers)) < _LEAST_SENSORS:
            raise ScenarioError(
                f"{candidate.name}: three sensors of each kind have nothing to compare; four are "
                "needed of one kind"
            )
        check_files(candidate.scenario)
    return found


def title_of(scenario: str | None, preset: str | None) -> str:
    """Return whose sensors are studied, in words."""
    return "sensors of " + (scenario or f"the preset {preset or 'prototype'}")


def _short(name: str) -> str:
    return Path(name).stem if name.endswith(".toml") else name


def _with_geometry(base: JsonObject, name: str | None, geometry: str) -> Candidate:
    table = rimu_table(geometry)
    rimu = Rimu.model_validate(table)
    changed = base | {"rimu": table} | _sensors(base, rimu)
    if changed.get("sensors") in presets.names():
        del changed["sensors"]
    own = geometry if geometry in GEOMETRIES else _short(geometry)
    where = own if name is None else f"{name} with {own}"
    return Candidate(own, scenario.parse(changed, where))


def _sensors(base: JsonObject, rimu: Rimu) -> JsonObject:
    """Return the tables of the sensors, the preset's values included, fitted to a geometry."""
    preset = base.get("sensors")
    known = preset in presets.names()
    tables = presets.tables_of(preset) if known and preset is not None else {}
    counts = {"gyros": len(rimu.gyros), "accelerometers": len(rimu.accelerometers)}
    found: JsonObject = {}
    for kind, count in counts.items():
        values = tables.get(kind, {}) | dict(base.get(kind, {}))
        found[kind] = {key: _fitted(value, count) for key, value in values.items()}
    return found


def _fitted(value: Any, count: int) -> Any:
    """Return a value for any number of sensors, where it is one per sensor of another number."""
    if isinstance(value, list | tuple) and len(value) != count and value:
        return max(value, key=abs)
    return value
