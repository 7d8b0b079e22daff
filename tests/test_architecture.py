"""Who may import whom: docs/architecture.md."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "dbc": ("firmware_py", "host_tools"),
    "firmware_py": ("host_tools",),
    "host_tools/hardware": ("firmware_py",),
    "host_tools/bus": ("firmware_py", "host_tools.hardware"),
    "host_tools/motion": ("firmware_py",),
}
HARDWARE_MAY = ("dbc", "host_tools.hardware")


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return found


def is_of(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


@pytest.mark.parametrize("room", FORBIDDEN)
def test_no_room_enters_a_forbidden_one(room):
    files = sorted((ROOT / room).rglob("*.py"))
    assert files
    for path in files:
        for module in imports(path):
            for forbidden in FORBIDDEN[room]:
                assert not is_of(module, forbidden), f"{path} imports {module}"


def test_the_hardware_knows_nothing_of_ours_but_the_contract():
    ours = ("dbc", "firmware_py", "host_tools")
    for path in (ROOT / "host_tools" / "hardware").rglob("*.py"):
        for module in imports(path):
            if any(is_of(module, package) for package in ours):
                assert any(is_of(module, may) for may in HARDWARE_MAY), f"{path} imports {module}"


def test_steps_own_no_time_and_no_io():
    steps = [
        *(ROOT / "dbc").glob("e2e.py"),
        *(p for p in (ROOT / "firmware_py").glob("*.py") if p.name != "loop.py"),
        *(p for p in (ROOT / "host_tools/hardware").glob("*.py") if p.name != "loop.py"),
    ]
    for path in steps:
        for module in imports(path):
            assert module.split(".")[0] not in {"time", "socket", "threading", "can"}, path


def test_diagnostics_own_no_time_and_their_files_and_threads_stand_apart():
    for path in (ROOT / "firmware_py" / "diagnostics").rglob("*.py"):
        found = {module.split(".")[0] for module in imports(path)}
        assert not found & {"time", "socket", "can"}, path
        assert path.name == "writer.py" or "threading" not in found, path
        assert path.name == "store.py" or "fcntl" not in found, path


def test_no_file_is_longer_than_500_lines():
    for room in ("dbc", "firmware_py", "host_tools", "tests"):
        for path in (ROOT / room).rglob("*.py"):
            assert len(path.read_text(encoding="utf-8").splitlines()) <= 500, path
