"""Scenarios by name, file or dict, changed by keyword."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from rrins.host_tools.scenario.keywords import path_of
from rrins.host_tools.scenario.scenario import Scenario, load, names, parse

if TYPE_CHECKING:
    from rrins.host_tools.scenario.typed_keys import ScenarioKeys


def scenario_names() -> list[str]:
    """Return the names of the built-in scenarios."""
    return names()


def load_scenario(
    source: str | Path | Mapping[str, object] | Scenario, **changes: Unpack[ScenarioKeys]
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
    return scenario.varied(**{path_of(name): _plain(value) for name, value in changes.items()})


def _plain(value: object) -> object:
    """Return a numpy value as Python's own, which a scenario is made of."""
    to_list = getattr(value, "tolist", None)
    return value if to_list is None else to_list()
