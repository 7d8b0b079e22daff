"""Scenarios by name, file or dict, changed by keyword."""

from __future__ import annotations

import difflib
import functools
import types
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Union, get_args, get_origin

from pydantic import BaseModel

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.scenario.scenario import Scenario, load, names, parse

_SENSORS = {"gyro_": "gyros", "accelerometer_": "accelerometers"}


def scenario_names() -> list[str]:
    """Return the names of the built-in scenarios."""
    return names()


def load_scenario(
    source: str | Path | Mapping[str, object] | Scenario, **changes: object
) -> Scenario:
    """Return a scenario, checked, with some keys changed.

    Parameters
    ----------
    source : str, Path, mapping or Scenario
        Name of a built-in scenario, path of a TOML file, or the keys of one.
    **changes
        A key of the scenario, units in its name: ``duration_s=600``, ``turn_rate_dps=10``. Sensor
        errors begin with their kind: ``gyro_bias_dph=[0.1, 0.1, 0.2, 0.1]`` (one number for all
        sensors, or one for each), ``accelerometer_bias_ug=50``. Where a key stands in several
        tables, name the table: ``turntable__inner__rate_limit_dps=30``.

    Raises
    ------
    ScenarioError
        One line: which scenario, which key, what is wrong.

    Examples
    --------
    >>> load_scenario("rimu_rotating", duration_s=600, gyro_bias_dph=0.1).duration_s
    600.0
    """
    if isinstance(source, Scenario):
        scenario = source
    elif isinstance(source, Mapping):
        scenario = parse(source, "of a dict")
    else:
        scenario = load(str(source))
    if not changes:
        return scenario
    return scenario.varied(**{_path_of(name): _plain(value) for name, value in changes.items()})


def _plain(value: object) -> object:
    """Return a numpy value as Python's own, which a scenario is made of."""
    to_list = getattr(value, "tolist", None)
    return value if to_list is None else to_list()


def _path_of(name: str) -> str:
    """Return the place of a keyword in a scenario, its tables and key joined by ``__``.

    Raises
    ------
    ScenarioError
        When no key or several have that name.
    """
    if "__" in name or name in Scenario.model_fields:
        return name
    places = _places()
    for prefix, table in _SENSORS.items():
        path = f"{table}__{name.removeprefix(prefix)}"
        if name.startswith(prefix) and path in places.get(name.removeprefix(prefix), ()):
            return path
    found = places.get(name, ())
    if len(found) == 1:
        return found[0]
    if found:
        raise ScenarioError(f"scenario: {name} stands in several tables: {', '.join(found)}")
    near = difflib.get_close_matches(name, _keywords(), 1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise ScenarioError(f"scenario: no key {name!r}{hint}")


@functools.cache
def _places() -> dict[str, tuple[str, ...]]:
    """Return where each key of the tables stands."""
    places: dict[str, tuple[str, ...]] = {}
    for path in _paths(Scenario, ()):
        if len(path) > 1:
            places[path[-1]] = (*places.get(path[-1], ()), "__".join(path))
    return places


def _keywords() -> list[str]:
    """Return all that may be written as a keyword, for suggestions."""
    sensors = [
        f"{prefix}{key}"
        for prefix, table in _SENSORS.items()
        for key, places in _places().items()
        if f"{table}__{key}" in places
    ]
    return [*Scenario.model_fields, *sensors, *_places()]


def _paths(model: type[BaseModel], before: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Yield the path of every key of a table and of the tables in it."""
    for name, field in model.model_fields.items():
        yield (*before, name)
        for kind in _kinds_of(field.annotation):
            yield from _paths(kind, (*before, name))


def _kinds_of(annotation: object) -> Iterator[type[BaseModel]]:
    """Yield the tables that a key may hold; arrays of tables are changed as a whole."""
    if get_origin(annotation) in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _kinds_of(member)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
