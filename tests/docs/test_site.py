"""Sources of `make docs-site`: tables of the index pages, lists of modules."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
OUTSIDE = ("CONTRIBUTING.md", "CHANGELOG.md")  # in docs a line stands for each
FACE = (ROOT / "rrins").glob("[!_]*.py")
WITHOUT_A_PAGE = ("rrins.host_tools.cli.", "rrins.host_tools.benchmarks.")

_ROW = re.compile(r"^\| \[[^]]*\]\(([^)#]+\.md)\)", re.MULTILINE)
_MODULE = re.compile(r"^- `([\w.]+\*?)`$", re.MULTILINE)


def modules() -> set[str]:
    """Return the modules of the three rooms."""
    paths = [
        path
        for room in ("dbc", "firmware_py", "host_tools")
        for path in (ROOT / room).rglob("*.py")
    ]
    names = {".".join(("rrins", *path.relative_to(ROOT).with_suffix("").parts)) for path in paths}
    paths = (ROOT / "rrins" / "compiled").rglob("*.py")
    names |= {".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths}
    return {name.removesuffix(".__init__") for name in names}


def test_every_page_stands_in_the_table_of_an_index():
    listed = {
        (index.parent / page).resolve()
        for index in DOCS.rglob("index.md")
        for page in _ROW.findall(index.read_text(encoding="utf-8"))
    }
    pages = {page for page in DOCS.rglob("*.md") if "_build" not in page.parts}
    pages |= {ROOT / name for name in OUTSIDE}
    assert listed == pages - {DOCS / "index.md", *(DOCS / name.lower() for name in OUTSIDE)}


def test_the_reference_has_every_module():
    pages = [page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md")]
    listed = [name for page in pages for name in _MODULE.findall(page)]
    assert len(listed) == len(set(listed))
    named = {name for name in listed if not name.endswith(".*")}
    whole = (
        *(name[:-1] for name in listed if name.endswith(".*") and name != "rrins.*"),
        *WITHOUT_A_PAGE,
    )
    assert named <= modules() | {"rrins"} | {f"rrins.{path.stem}" for path in FACE}
    missing = {name for name in modules() - named if not name.startswith(whole)}
    missing -= {"rrins.host_tools", *(name.removesuffix(".") for name in WITHOUT_A_PAGE)}
    assert not missing, "list them on a page of docs/api"


def test_the_settings_of_sphinx_can_be_imported():
    for name in ("sphinx", "myst_parser", "furo", "sphinx_copybutton"):
        pytest.importorskip(name)
    command = "import conf; print(conf.project, conf.release)"
    done = subprocess.run(
        [sys.executable, "-c", command], cwd=DOCS, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("RRINS rehearsal 0.")
