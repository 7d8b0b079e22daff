"""Files and names of code that the pages mention are there."""

from __future__ import annotations

import ast
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
    body = ast.parse(path.read_text(encoding="utf-8")).body
    under_if = [inner for node in body if isinstance(node, ast.If) for inner in node.body]
    for node in [*body, *under_if]:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.Assign(targets=targets):
                found |= {target.id for target in targets if isinstance(target, ast.Name)}
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
            return part in names_of(place if place.is_file() else place / "__init__.py")
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
        elif _NAME.fullmatch(code) and not code.endswith((".dbc", ".toml")):
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
