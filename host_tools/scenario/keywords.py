"""Keys of a scenario as keywords of a call, such as ``gyro_bias_dph`` for ``[gyros] bias_dph``."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Iterator

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.wrong_keys import tables_in

_SENSORS = {"gyro_": "gyros", "accelerometer_": "accelerometers"}

Place = tuple[type[BaseModel], FieldInfo]
"""Where a key is declared: its table, and the field."""


def path_of(name: str) -> str:
    """Return the place of a keyword in a scenario, its tables and key joined by ``__``.

    Raises
    ------
    ScenarioError
        When no key or several have that name.
    """
    if name in paths():
        return name
    if name in keywords():
        return keywords()[name]
    found = _places().get(name, ())
    if found:
        raise ScenarioError(f"scenario: {name} stands in several tables: {', '.join(found)}")
    if "__" in name:  # the table's own check says which of its keys is meant
        return name
    near = difflib.get_close_matches(name, [*keywords(), *_places()], 1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise ScenarioError(f"scenario: no key {name!r}{hint}")


@functools.cache
def keywords() -> dict[str, str]:
    """Return the path of each keyword that stands for one key, and has no ``__``."""
    found = {path: path for path in paths() if "__" not in path}
    for prefix, table in _SENSORS.items():
        for path in paths():
            if path.startswith(f"{table}__"):
                found.setdefault(prefix + path.removeprefix(f"{table}__"), path)
    for name, places in _places().items():
        if len(places) == 1 and not places[0].startswith("paper__"):  # `source` is of the calls
            found.setdefault(name, places[0])
    return found


@functools.cache
def _places() -> dict[str, tuple[str, ...]]:
    """Return where each key of the tables stands."""
    places: dict[str, tuple[str, ...]] = {}
    for path in paths():
        if "__" in path:
            key = path.rpartition("__")[2]
            places[key] = (*places.get(key, ()), path)
    return places


@functools.cache
def paths() -> dict[str, Place]:
    """Return every key of a scenario and of its tables by its path."""
    return dict(_paths(Scenario, ""))


def _paths(model: type[BaseModel], before: str) -> Iterator[tuple[str, Place]]:
    for name, field in model.model_fields.items():
        yield before + name, (model, field)
        for kind in tables_in(field.annotation):
            yield from _paths(kind, f"{before}{name}__")
