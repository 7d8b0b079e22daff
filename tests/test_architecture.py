"""Who may import whom: the contracts of pyproject.toml; docs/architecture.md."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("dbc", "firmware_py", "host_tools")

_CLOCKS_AND_IO = {"time", "socket", "threading", "can"}
_LINE_OF_TABLE = re.compile(r"={3,} +={3,}")


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """Check the contracts of the tree in a folder."""
    command = "from importlinter.cli import lint_imports_command as lint; lint()"
    return subprocess.run(
        [sys.executable, "-c", command, "--no-logo", "--no-cache"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return found


def copy_tree(to):
    """Return a copy of the tree, to spoil."""
    shutil.copy(ROOT / "pyproject.toml", to)
    for folder in ("rrins", *ROOMS):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / folder, to / folder, symlinks=True, ignore=ignored)
    return to


@pytest.fixture
def copy(tmp_path):
    return copy_tree(tmp_path)


def test_all_contracts_are_kept():
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout
    assert " 0 broken" in done.stdout


WRONG_IMPORTS = (
    ("dbc/e2e.py", "import rrins.host_tools.errors", "The bus contract stands alone"),
    ("firmware_py/core/maths/earth.py", "from rrins.host_tools.bus import port",
     "The firmware never imports the host tools"),
    ("firmware_py/core/maths/earth.py",
     "from rrins.firmware_py.diagnostics.node import Diagnostics",
     "The rooms of the firmware import downwards"),
    ("host_tools/hardware/earth.py", "from rrins.firmware_py.core.maths import earth",
     "The hardware imports nothing of ours but the bus contract"),
    ("host_tools/hardware/earth.py", "from rrins.host_tools.errors import BusError",
     "The hardware imports nothing of ours but the bus contract"),
    ("host_tools/bus/pace.py", "from rrins.host_tools.wire import timing",
     "The bus only transports"),
    ("host_tools/motion/local.py", "from rrins.firmware_py.core.maths import earth",
     "Tools of bus, wire and motion never import the firmware"),
    ("host_tools/logs/truth.py", "from rrins.host_tools.rotation import merit",
     "The rooms of the host tools import downwards"),
    ("host_tools/logs/truth.py", "import rrins", "No room imports the public face"),
    ("host_tools/logs/truth.py", "from rrins import face", "No room imports the public face"),
    ("dbc/frame.py", "from rrins.dbc import codec", "No modules import in a circle"),
)  # fmt: skip


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Return what is said of a tree with all wrong imports, by contract."""
    folder = copy_tree(tmp_path_factory.mktemp("wrong"))
    (folder / "rrins" / "face.py").write_text('"""A module of the face."""\n')
    for importer, line, _ in WRONG_IMPORTS:
        with (folder / importer).open("a", encoding="utf-8") as file:
            file.write(f"\n{line}\n")
    done = lint(folder)
    assert done.returncode == 1
    told = done.stdout.partition("Broken contracts\n-")[2]
    _, *sections = re.split(r"^(.+)\n-{5,}\n", told, flags=re.MULTILINE)
    texts = [re.sub(r"\s+", " ", text) for text in sections[1::2]]
    return dict(zip(sections[::2], texts, strict=True))


@pytest.mark.parametrize(("importer", "line", "contract"), WRONG_IMPORTS)
def test_a_wrong_import_breaks_a_contract(found, importer, line, contract):
    module = f"rrins.{importer.removesuffix('.py').replace('/', '.')}"
    of, _, name = line.removeprefix("from ").removeprefix("import ").partition(" import ")
    told = [f"{module} -> {of}.{name} (", f"{module} -> {of} ("]
    told.append(f".{module.rpartition('.')[2]} -> .{name} (")  # of modules in a circle
    assert any(one in found[contract] for one in told), found[contract]


def test_the_face_may_import_everything(copy):
    lines = ("cli", "runs.direct", "hardware.step")
    text = "".join(f"import rrins.host_tools.{line}\n" for line in lines)
    (copy / "rrins" / "face.py").write_text(f'"""A module of the face."""\n{text}')
    assert lint(copy).returncode == 0


@pytest.mark.parametrize("room", ["host_tools", "firmware_py"])
def test_a_new_room_needs_a_place(copy, room):
    (copy / room / "attic.py").write_text('"""Nobody knows."""\n')
    done = lint(copy)
    assert done.returncode == 1
    assert f"rrins.{room}.attic" in done.stdout


def test_the_package_is_the_face_and_the_rooms():
    folder = ROOT / "rrins"
    links = {path.name: path.resolve() for path in folder.iterdir() if path.is_symlink()}
    assert links == {room: ROOT / room for room in ROOMS}
    folders = {path.name for path in folder.iterdir() if path.is_dir()} - {"__pycache__"}
    assert folders == {*ROOMS, "compiled"}, "modules directly in rrins/ count as its face"


def test_steps_own_no_time_and_no_io():
    steps = [
        ROOT / "dbc" / "e2e.py",
        *(ROOT / "firmware_py" / "core").rglob("*.py"),
        *(p for p in (ROOT / "host_tools" / "hardware").rglob("*.py") if p.name != "loop.py"),
    ]
    assert len(steps) > 30
    for path in steps:
        for module in imports(path):
            assert module.split(".")[0] not in _CLOCKS_AND_IO, path


def test_serial_lines_own_no_time_and_no_bus():
    paths = list((ROOT / "firmware_py" / "serial").rglob("*.py"))
    assert paths
    for path in paths:
        assert not {module.split(".")[0] for module in imports(path)} & _CLOCKS_AND_IO, path


def test_diagnostics_own_no_time_and_their_files_and_threads_stand_apart():
    paths = list((ROOT / "firmware_py" / "diagnostics").rglob("*.py"))
    assert paths
    for path in paths:
        found = {module.split(".")[0] for module in imports(path)}
        assert not found & {"time", "socket", "can"}, path
        assert path.name == "writer.py" or "threading" not in found, path
        assert path.name == "store.py" or "fcntl" not in found, path


def test_no_file_is_longer_than_500_lines():
    for room in (*ROOMS, "rrins", "docs", "tests"):
        paths = [path for path in (ROOT / room).rglob("*.py") if not path.is_symlink()]
        assert paths
        for path in paths:
            assert len(path.read_text(encoding="utf-8").splitlines()) <= 500, path


def test_no_import_is_relative():
    for room in (*ROOMS, "rrins"):
        for path in (ROOT / room).rglob("*.py"):
            imports(path)  # asserts it


def listed(docstring: str) -> list[str]:
    """Return the modules that the tables of a package's docstring list."""
    names: list[str] = []
    width = 0
    for line in docstring.splitlines():
        if _LINE_OF_TABLE.match(line):
            width = line.index(" ")
        elif not line:
            width = 0
        elif width:
            names += [name.strip(" `") for name in line[:width].split(",") if name.strip()]
    return [name for name in names if name != "module"]


def test_packages_list_modules_that_are_there():
    packages = [path for room in ROOMS for path in (ROOT / room).rglob("__init__.py")]
    found = 0
    for path in packages:
        for name in listed(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""):
            found += 1
            there = (path.parent / f"{name}.py").exists() or (path.parent / name).is_dir()
            assert there, f"{path} lists {name}"
    assert found > 20
