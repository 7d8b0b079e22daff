"""Sensors by grade: TOML files of the tables `[gyros]` and `[accelerometers]`."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any


def names() -> list[str]:
    """Return the names of the presets."""
    folder = resources.files(__name__)
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def text_of(name: str) -> str:
    """Return the TOML text of a preset."""
    return resources.files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8")


def tables_of(name: str) -> dict[str, dict[str, Any]]:
    """Return the tables of a preset."""
    return tomllib.loads(text_of(name))
