"""The scenario of a bench: a built-in name, a path or a dict, with overrides by the test."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.files import JsonObject
from rrins.host_tools.scenario.scenario import Scenario, load, text_of

ScenarioTable = Mapping[str, Any]
"""The keys of a scenario, as in its TOML file."""

DURATION_S = 3600.0
"""Default duration of navigation of a scenario given as a dict."""


def prepare_scenario(
    given: str | Path | ScenarioTable,
    overrides: ScenarioTable,
    file: Path,
    beside: Path,
) -> Scenario:
    """Write the scenario of a bench to a file and return it, validated.

    Parameters
    ----------
    given : str, Path or mapping
        Name of a built-in scenario, path of a TOML file, or its keys.
    overrides : mapping
        Top-level keys; a table is merged into the scenario's table, key by key.
    file : Path
        File to write the complete scenario to, for the processes.
    beside : Path
        Folder to search first for a relative path, before the working directory.

    Raises
    ------
    ScenarioError
        If the scenario is invalid; the message, one line, names scenario, key and reason.
    """
    if isinstance(given, Mapping):
        table: JsonObject = {"duration_s": DURATION_S, **given}
    else:
        name = str(given)
        near = beside / name
        text = text_of(str(near) if near.is_file() else name)
        try:
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ScenarioError(f"scenario {name}: not TOML: {error}") from error
    file.write_text(toml_text(merged(table, overrides)), encoding="utf-8")
    return load(str(file))


def merged(table: ScenarioTable, overrides: ScenarioTable) -> JsonObject:
    """Return a table with overrides, nested tables merged key by key."""
    result = dict(table)
    for key, value in overrides.items():
        before = result.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            result[key] = merged(before, value)
        else:
            result[key] = value
    return result


def toml_text(table: ScenarioTable) -> str:
    """Return a table as TOML; keys with the value None are omitted."""
    try:
        return tomli_w.dumps(_plain(table))
    except TypeError as error:
        raise ScenarioError(f"a scenario cannot contain such a value: {error}") from error


def _plain(value: Any) -> Any:
    """Return a value with dicts for mappings and text for paths, without None."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items() if one is not None}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return str(value) if isinstance(value, Path) else value
