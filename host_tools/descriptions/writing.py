"""Which files describe bus and computer, by their endings; what writes them is loaded when used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

DESCRIPTIONS: Mapping[str, str] = {
    ".pdx": "diagnosis: ODX",
    ".dbc": "bus contract: DBC, as the project uses it",
    ".arxml": "bus contract: AUTOSAR 4 system description",
    ".kcd": "bus contract: KCD, of Kayak",
    ".sym": "bus contract: SYM, of PCAN tools",
}
"""The subject and format of a file, by its ending."""


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
    if path.suffix.lower() == ".pdx":
        from rrins.host_tools.descriptions.pdx import write_pdx

        write_pdx(path)
    else:
        from rrins.host_tools.descriptions.dialects import write_dialect

        write_dialect(path)
