"""Files and names of code that the pages mention are there."""

from __future__ import annotations

import ast
import builtins
import functools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = {
    path.name
    for folder in ("rrins", "dbc", "firmware_py", "host_tools", "tests")
    for path in (ROOT / folder).rglob("*.py")
}
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])

_CODE = re.compile(r"`([^`\n]+)`")
_PATH = re.compile(r"(?:rrins|dbc|firmware_py|host_tools|docs|tests|examples)/[\w./-]*")
_NAME = re.compile(r"rrins(?:\.\w+)+")
_FILE = re.compile(r"\w+\.py")
_IDENTIFIERS = re.compile(r"(?:_\w+|[A-Z]\w+)(?:\.\w+)*")
_OF_A_READER = {"conftest.py"}
_CHANGELOG = "CHANGELOG.md"  # also tells what there was


def code_of(page: Path) -> list[str]:
    """Return what a page sets in backticks, inside a line."""
    return [] if page.name == _CHANGELOG else _CODE.findall(page.read_text(encoding="utf-8"))


@functools.cache
def names_of(path: Path) -> set[str]:
    """Return the names that a module defines at its top, or imports."""
    found: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.Assign(targets=targets):
                inside = (one for target in targets for one in ast.walk(target))
                found |= {one.id for one in inside if isinstance(one, ast.Name)}
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
            case ast.ImportFrom(names=aliases):
                found |= {alias.asname or alias.name for alias in aliases}
    return found


def is_there(name: str) -> bool:
    """Return whether a dotted name is a module or stands in one; members are not followed."""
    place = ROOT
    for part in name.split("."):
        if (place / part).is_dir():
            place /= part
        elif (place / f"{part}.py").is_file():
            place /= f"{part}.py"
        else:
            files = [place] if place.is_file() else place.glob("__init__.py*")
            return any(part in names_of(file) for file in files)
    return True


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_a_page_names_is_there(page):
    for code in code_of(page):
        if code.startswith("docs/_build"):  # made by `make docs-site`
            continue
        if _PATH.fullmatch(code):
            assert (ROOT / code).exists(), f"{page.name} names {code}"
        elif _FILE.fullmatch(code) and code not in _OF_A_READER:
            assert code in FILES, f"{page.name} names {code}"
        elif _NAME.fullmatch(code) and not code.endswith((".c", ".dbc", ".h", ".toml")):
            assert is_there(code), f"{page.name} names {code}"


def test_names_of_the_recipes_are_somewhere_in_the_code():
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    recipes = page.split("## How to add\n")[1].split("## Release\n")[0]
    folders = ("dbc", "firmware_py", "host_tools", "docs", "tests")
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    code = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    code += (ROOT / "dbc" / "rrins.dbc").read_text(encoding="utf-8")
    words = set(re.findall(r"\w+", code))
    named = {code for code in _CODE.findall(recipes) if _IDENTIFIERS.fullmatch(code)}
    assert len(named) > 30
    for name in named:
        assert set(name.split(".")) <= words, name


_RAISES = re.compile(r"^( +)Raises\n\1------\n((?:\1[\w. ]+.*\n)+)", re.MULTILINE)
_CLASS = re.compile(r"^ *class (\w+)", re.MULTILINE)
_IMPORT = re.compile(r"^ *(?:from|import) .*", re.MULTILINE)


def test_docstrings_name_what_is_there():
    folders = ("dbc", "firmware_py", "host_tools", "rrins/compiled")
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    texts = {path: path.read_text("utf-8") for path in (*paths, *(ROOT / "rrins").glob("*.py"))}
    ours = {name for text in texts.values() for name in _CLASS.findall(text)}
    missing = set()
    for path, text in texts.items():
        known = ours | vars(builtins).keys() | set(re.findall(r"\w+", str(_IMPORT.findall(text))))
        names = {name for name in _CODE.findall(text) if _NAME.fullmatch(name)}
        missing |= {(path.name, name) for name in names if not is_there(name)}
        for indent, entries in _RAISES.findall(text):
            raised = re.findall(rf"^{indent}([\w.]+)$", entries, re.MULTILINE)
            missing |= {(path.name, name) for name in raised if name.split(".")[0] not in known}
    assert not missing
