"""The scenario of a bench: a built-in name, a path or a dict, with keys changed by the test."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from host_tools.errors import ScenarioError
from host_tools.scenario import Scenario, load, text_of

DURATION_S = 3600.0
"""How long a scenario navigates that is given as a dict and does not say."""


def prepare_scenario(
    given: str | Path | Mapping[str, Any],
    overrides: Mapping[str, Any],
    file: Path,
    beside: Path,
) -> Scenario:
    """Write the scenario of a bench to a file and return it, checked.

    Parameters
    ----------
    given : str, Path or mapping
        Name of a built-in scenario, path of a TOML file, or its keys.
    overrides : mapping
        Top-level keys; a table is merged into the scenario's table, key by key.
    file : Path
        Where the whole scenario goes, for processes to load.
    beside : Path
        Folder that a relative path is looked for in first; then the working directory.

    Raises
    ------
    ScenarioError
        One line: which scenario, which key, what is wrong.
    """
    if isinstance(given, Mapping):
        table: dict[str, Any] = {"duration_s": DURATION_S, **given}
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


def merged(table: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with keys overridden, tables inside it key by key."""
    result = dict(table)
    for key, value in overrides.items():
        before = result.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping):
            result[key] = merged(before, value)
        else:
            result[key] = value
    return result


def toml_text(table: Mapping[str, Any]) -> str:
    """Return a table as TOML, a line for each key; keys whose value is None are left out."""
    return "".join(
        f"{json.dumps(key)} = {_value(value)}\n"
        for key, value in table.items()
        if value is not None
    )


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        pairs = (f"{json.dumps(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(member) for member in value) + "]"
    if isinstance(value, Path):
        value = str(value)
    if not isinstance(value, bool | int | float | str):
        raise ScenarioError(
            f"a value of {type(value).__name__} has no place in a scenario: {value!r}"
        )
    return json.dumps(value)
