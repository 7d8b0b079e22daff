"""The inputs of a campaign: which key of a scenario, and which sensor, gets what each run draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel

from rrins.compiled.record import Floats
from rrins.host_tools.campaigns.distributions import (
    Distribution,
    Value,
    cumulative_normal,
    normal_quantile,
    parse,
)
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.tables import Accelerometers, Gyros
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import Firmware

_TABLES: dict[str, type[BaseModel]] = {
    "gyros": Gyros,
    "accelerometers": Accelerometers,
    "firmware": Firmware,
}
_SIZE = "size"
"""Key of a fault that stands for the value of its kind, whatever that is called."""

_FIXED = ("seed", "title", "paper")


@dataclass(frozen=True)
class Input:
    """One number that each run draws."""

    key: str  #: place in the scenario, dots between: ``gyros.bias_dph``, ``faults.1.at_s``.
    sensor: int | None  #: from 1; None where the value is that of the key as a whole
    distribution: Distribution

    @property
    def column(self) -> str:
        """Its name in the table of runs."""
        return self.key if self.sensor is None else f"{self.key}.{self.sensor}"


def _is_per_sensor(path: Sequence[str]) -> bool:
    """Return whether a key takes one number per sensor."""
    if len(path) != 2 or path[0] not in _TABLES:
        return False
    field = _TABLES[path[0]].model_fields.get(path[1])
    kinds = () if field is None else get_args(field.annotation)
    is_weight = path[0] == "firmware" and path[1].endswith("_weights")
    return any(getattr(k, "__origin__", None) is tuple for k in kinds) and (
        path[0] != "firmware" or is_weight
    )


def _sensors_of(path: Sequence[str], scenario: Scenario) -> int:
    """Return how many sensors a key has a value of."""
    of_gyros = path[0] == "gyros" or path[1].startswith("gyro_")
    return len(scenario.rimu.gyros if of_gyros else scenario.rimu.accelerometers)


def inputs_of(scenario: Scenario, vary: Mapping[str, str]) -> tuple[Input, ...]:
    """Return the inputs of a campaign, in the order of their keys.

    Parameters
    ----------
    scenario : Scenario
    vary : mapping of str to str
        Keys, and what they are varied by.

    Raises
    ------
    CampaignError
    """
    inputs: list[Input] = []
    for key, text in sorted(vary.items()):
        *head, last = path = key.split(".")
        if path[0] in _FIXED:
            raise CampaignError(f"{key}: cannot be varied")
        distribution = parse(key, text)
        if last.isdecimal() and _is_per_sensor(head):
            count = _sensors_of(head, scenario)
            if not 1 <= int(last) <= count:
                raise CampaignError(f"{key}: sensor {last} of {count}")
            inputs.append(Input(".".join(head), int(last), distribution))
        elif _is_per_sensor(path) and not distribution.is_common:
            count = _sensors_of(path, scenario)
            inputs += [Input(key, k + 1, distribution) for k in range(count)]
        else:
            inputs.append(Input(key, None, distribution))
    columns = [one.column for one in inputs]
    double = {column for column in columns if columns.count(column) > 1}
    if double:
        raise CampaignError(f"{min(double)}: varied twice")
    return tuple(inputs)


def correlation_of(inputs: Sequence[Input], between: Mapping[tuple[str, str], float]) -> Floats:
    """Return the correlation matrix of the inputs' normal numbers, and its Cholesky factor.

    Values of one key and several sensors are correlated as its distribution says, others as
    `between` says: a pair of columns, or of keys whose sensors of one number are meant.

    Returns
    -------
    array, shape (n, n)
        Lower triangular L, so that L z has the correlations if z has none.

    Raises
    ------
    CampaignError
    """
    count = len(inputs)
    R = np.eye(count)
    for a in range(count):
        for b in range(a):
            if (inputs[a].key, inputs[a].distribution) == (inputs[b].key, inputs[b].distribution):
                R[a, b] = R[b, a] = inputs[a].distribution.correlation
    for pair, value in between.items():
        for a, b in _pairs(inputs, pair):
            R[a, b] = R[b, a] = value
    try:
        return np.linalg.cholesky(R).astype(np.float64)
    except np.linalg.LinAlgError as error:
        raise CampaignError("the correlations contradict each other") from error


def _pairs(inputs: Sequence[Input], pair: tuple[str, str]) -> list[tuple[int, int]]:
    """Return the inputs that a pair of names means, by their indices."""
    found = []
    for a, one in enumerate(inputs):
        for b, other in enumerate(inputs):
            by_column = (one.column, other.column) == pair
            by_key = (one.key, other.key) == pair and one.sensor == other.sensor
            if a != b and (by_column or by_key):
                found.append((a, b))
    if not found:
        raise CampaignError(f"correlated {pair[0]}, {pair[1]}: not both are varied")
    return found


def correlated(unit: Floats, factor: Floats) -> Floats:
    """Return points of the unit cube with the correlations of a factor (Gaussian copula)."""
    if np.array_equal(factor, np.eye(len(factor))):
        return unit
    z = factor @ np.array([normal_quantile(u) for u in unit])
    return np.array([cumulative_normal(value) for value in z])


def changed(
    scenario: Scenario, values: Mapping[Input, Value], more: Sequence[JsonObject] = ()
) -> JsonObject:
    """Return the keys of a scenario with those of a run in their places.

    Parameters
    ----------
    scenario : Scenario
    values : mapping of Input to value
    more : sequence of dict
        Faults beside those of the scenario; what varies of them is in `values`.

    Raises
    ------
    CampaignError
        When a place is not there.
    """
    table: JsonObject = scenario.model_dump(mode="json", exclude_unset=True)
    if more:
        table["faults"] = [*table.get("faults", []), *(dict(fault) for fault in more)]
    for one, value in values.items():
        path = one.key.split(".")
        if one.sensor is not None:
            _set_sensor(table, scenario, path, one.sensor, value)
        else:
            _set(table, path, value, one.key)
    varied = {one.key for one in values}
    for number, fault in enumerate(table.get("faults", []), 1):
        _name_size(fault)
        if f"faults.{number}.kind" in varied:
            _drop_of_other_kinds(fault)
    return table


def _set(table: Any, path: Sequence[str], value: Value, key: str) -> None:
    place = table
    for part, following in pairwise(path):
        if isinstance(place, list):
            place = place[_index(place, part, key)]
        else:
            if not isinstance(place.get(part), dict | list):
                place[part] = [] if following.isdecimal() else {}
            place = place[part]
    if isinstance(place, list):
        place[_index(place, path[-1], key)] = value
    else:
        place[path[-1]] = value


def _index(place: list[Any], part: str, key: str) -> int:
    if not part.isdecimal() or not 1 <= int(part) <= len(place):
        raise CampaignError(f"{key}: there is no {part} of {len(place)}")
    return int(part) - 1


def _set_sensor(
    table: JsonObject, scenario: Scenario, path: Sequence[str], sensor: int, value: Value
) -> None:
    """Set the value of one sensor; the others keep theirs."""
    place = table.setdefault(path[0], {})
    before = place.get(path[1], getattr(getattr(scenario, path[0]), path[1]))
    if not isinstance(before, list):
        before = [before] * _sensors_of(path, scenario)
    before[sensor - 1] = value
    place[path[1]] = before


def _value_key(fault: JsonObject) -> str | None:
    """Return what the value of a fault's kind is called; None for a kind that has none."""
    kind = HardwareFault.__members__.get(str(fault.get("kind", "")).upper())
    return None if kind is None or kind.parameter is None else kind.parameter.key


def _name_size(fault: JsonObject) -> None:
    """Give a fault its size by the name that its kind has for it."""
    if _SIZE not in fault:
        return
    size, key = fault.pop(_SIZE), _value_key(fault)
    if key is not None:
        fault[key] = size


def _drop_of_other_kinds(fault: JsonObject) -> None:
    """Drop the values that only other kinds than the one drawn have."""
    keys = {kind.parameter.key for kind in HardwareFault if kind.parameter is not None}
    for key in keys - {_value_key(fault)}:
        fault.pop(key, None)
