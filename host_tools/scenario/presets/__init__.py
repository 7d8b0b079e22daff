"""Sensors by grade: TOML files of the tables `[gyros]` and `[accelerometers]`."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import resources
from typing import Any


@cache
def _names() -> tuple[str, ...]:
    folder = resources.files(__name__)
    files = (entry.name for entry in folder.iterdir())
    return tuple(sorted(name[:-5] for name in files if name.endswith(".toml")))


def names() -> list[str]:
    """Return the names of the presets."""
    return list(_names())


@cache
def text_of(name: str) -> str:
    """Return the TOML text of a preset."""
    return resources.files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8")


def tables_of(name: str) -> dict[str, dict[str, Any]]:
    """Return the tables of a preset."""
    return {table: dict(values) for table, values in _tables_of(name).items()}


@cache
def _tables_of(name: str) -> dict[str, dict[str, Any]]:
    return tomllib.loads(text_of(name))
