"""Writes the table of rooms in `docs/architecture.md`: ``python -m generate.rooms_table``.

Who may import whom comes from the contracts of `pyproject.toml`, what lives in a room from the
first sentence of its docstring.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "architecture.md"

_BEGIN = "<!-- rooms: from pyproject.toml, by `make docs` -->\n"
_END = "<!-- end of rooms -->\n"
_PACKAGE = "rrins."
_FACE = ("", "`rrins/`", "The public face: what a script, a notebook or a plug-in imports", "all")
_BOTTOM = ("rrins.dbc", "rrins.compiled")
_MOST_NAMES = 4
"""The longest list of rooms that is written out."""

GUIDES = {
    "dbc": "bus-contract.md",
    "firmware_py/core": "firmware.md",
    "firmware_py/diagnostics": "diagnostics.md",
    "firmware_py/serial": "serial.md",
    "host_tools/benchmarks": "bench.md",
    "host_tools/bridges": "attach.md",
    "host_tools/builds": "build.md",
    "host_tools/bus": "bus.md",
    "host_tools/conformance": "own-firmware.md",
    "host_tools/calibration": "calibration.md",
    "host_tools/campaigns": "campaigns.md",
    "host_tools/covariance": "covariance.md",
    "host_tools/dashboard": "dashboard.md",
    "host_tools/descriptions": "files-for-tools.md",
    "host_tools/diag": "diag.md",
    "host_tools/experiments": "experiments/index.md",
    "host_tools/hardware": "error-model.md",
    "host_tools/injection": "faults.md",
    "host_tools/integrity": "integrity.md",
    "host_tools/logs": "logs.md",
    "host_tools/monitor": "monitor.md",
    "host_tools/motion": "motion.md",
    "host_tools/recording": "logs.md",
    "host_tools/redundancy": "redundancy-study.md",
    "host_tools/rotation": "schemes.md",
    "host_tools/scenario": "scenarios.md",
    "host_tools/serial": "serial.md",
    "host_tools/testing": "testing.md",
    "host_tools/vehicle": "vehicle.md",
    "host_tools/wire": "faults.md",
}
"""The page on what a room does, where there is one."""


def contracts() -> list[dict[str, Any]]:
    """Return the contracts of `pyproject.toml`."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        found = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    assert isinstance(found, list)
    return found


def levels() -> list[list[str]]:
    """Return all rooms, level by level, from the top down."""
    stacks = {c["containers"][0]: c["layers"] for c in contracts() if c["type"] == "layers"}
    found = [
        [f"{container}.{name.strip()}" for name in layer.split("|")]
        for container in ("rrins.host_tools", "rrins.firmware_py")
        for layer in stacks[container]
    ]
    return [*found, *([room] for room in _BOTTOM)]


def _matches(room: str, pattern: str) -> bool:
    """Return whether a room is what a pattern names, or lies in it; `*` is one name."""
    expression = re.escape(pattern).replace(r"\*", "[^.]+")
    return re.match(rf"{expression}(\.|$)", room) is not None


def _is_forbidden(importer: str, imported: str) -> bool:
    return any(
        any(_matches(importer, source) for source in contract["source_modules"])
        and any(_matches(imported, target) for target in contract["forbidden_modules"])
        for contract in contracts()
        if contract["type"] == "forbidden" and contract.get("as_packages", True)
    )


def _path_of(room: str) -> Path:
    """Return the folder or the file of a room."""
    name = room if room == "rrins.compiled" else room.removeprefix(_PACKAGE)
    folder = ROOT / name.replace(".", "/")
    return folder if folder.is_dir() else folder.with_suffix(".py")


def _name_of(room: str) -> str:
    return _path_of(room).relative_to(ROOT).as_posix()


def _purpose(room: str) -> str:
    """Return the first sentence of a room's docstring, and its guide."""
    path = _path_of(room)
    source = path / "__init__.py" if path.is_dir() else path
    text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
    paragraph = " ".join(text.split("\n\n")[0].split())
    sentence = re.split(r"\.(?:\s|$)", paragraph)[0].replace("``", "`")
    guide = GUIDES.get(_name_of(room))
    link = f" ([guide]({guide}))" if guide else ""
    return sentence + link


def _listed(rooms: Iterable[str]) -> str:
    """Return rooms as a list; all rooms of the firmware count as one."""
    names = [_name_of(room) for room in rooms]
    firmware = [_name_of(room) for level in levels() for room in level if "firmware_py" in room]
    if set(firmware) <= set(names):
        names = [name for name in names if name not in firmware[1:]]
        names[names.index(firmware[0])] = "firmware_py"
    return ", ".join(f"`{name}`" for name in names)


def _may_import(room: str, below: list[str]) -> str:
    forbidden = [other for other in below if _is_forbidden(room, other)]
    allowed = [other for other in below if other not in forbidden]
    if not allowed:
        return "nothing"
    if not forbidden:
        return "all below"
    if len(allowed) <= _MOST_NAMES:
        return _listed(allowed)
    return f"all below but {_listed(forbidden)}"


def _rows() -> Iterator[tuple[str, ...]]:
    yield "level", "room", "what lives there", "may import of ours"
    yield ("---",) * 4
    yield _FACE
    stack = levels()
    for index, level in enumerate(stack):
        below = [room for lower in stack[index + 1 :] for room in lower]
        for room in level:
            number = str(len(stack) - index)
            yield number, f"`{_name_of(room)}`", _purpose(room), _may_import(room, below)


def table() -> str:
    """Return the table as Markdown."""
    return "".join(f"| {' | '.join(row)} |\n" for row in _rows())


def page(text: str) -> str:
    """Return the page `text` with the table of today."""
    before, rest = text.split(_BEGIN)
    _, after = rest.split(_END)
    return f"{before}{_BEGIN}\n{table()}\n{_END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
