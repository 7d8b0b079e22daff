"""Which files describe bus and computer, by their endings; what writes them is loaded when used."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

DESCRIPTIONS: Mapping[str, str] = {
    ".pdx": "diagnosis: ODX",
    ".a2l": "measurement and calibration: A2L, for XCP",
    ".dbc": "bus contract: DBC, as the project uses it",
    ".arxml": "bus contract: AUTOSAR 4 system description",
    ".kcd": "bus contract: KCD, of Kayak",
    ".sym": "bus contract: SYM, of PCAN tools",
}
"""The subject and format of a file, by its ending."""

_PERIOD_NS = 5_000_000  # of a scenario that says nothing; the rest does not depend on it


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
    elif path.suffix.lower() == ".a2l":
        from rrins.firmware_py.xcp.a2l import a2l_text
        from rrins.host_tools.files import write_text

        write_text(path, a2l_text(_PERIOD_NS))
    else:
        from rrins.host_tools.descriptions.dialects import write_dialect

        write_dialect(path)
