"""Which files describe bus and computer, by their endings; what writes them is loaded when used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

DESCRIPTIONS: Mapping[str, str] = {
    ".pdx": "diagnosis: ODX",
}
"""What a file with an ending describes, and how."""


def write_description(path: Path) -> None:
    """Write the description that the ending of a path names.

    Raises
    ------
    RehearsalError
        If it cannot be written.
    ModuleNotFoundError
        If a package is missing.
    """
    assert path.suffix.lower() in DESCRIPTIONS, path
    from rrins.host_tools.descriptions.pdx import write_pdx

    write_pdx(path)
