"""Sources of `make docs-site`: tables of the index pages, lists of modules."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rrins.dbc.contract import load_contract

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
OUTSIDE = ("CONTRIBUTING.md", "CHANGELOG.md")  # in docs a line stands for each
FACE = (ROOT / "rrins").glob("[!_]*.py")
WITHOUT_A_PAGE = ("rrins.host_tools.cli.", "rrins.host_tools.benchmarks.")

_RUNS = ("resting", "turning")
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


def test_the_figures_have_their_data_and_their_scripts():
    page = (DOCS / "what-for.md").read_text(encoding="utf-8")
    script = (DOCS / "_static" / "figures.js").read_text(encoding="utf-8")
    named = re.findall(r'data-figure="(\w+)"', page)
    assert named == ["rotate", "parity", "schuler", "frame"]
    assert all(f"    {name}(root) {{" in script for name in named)
    text = (DOCS / "_static" / "figures_data.js").read_text(encoding="utf-8")
    data = json.loads(text.split(" = ", 1)[1].rstrip(";\n"))
    assert set(re.findall(r"data\.(\w+)", script)) <= data.keys()
    message = load_contract()[0].sensor[0]
    assert data["frame"]["data_id"] == int(message.message.data_id)
    assert data["frame"]["gyro"] == [int(message.gyro_dtheta.shift), message.gyro_dtheta.scale]
    swing = np.abs(data["schuler"]["east_m"])
    times = np.array(data["schuler"]["time_s"])
    assert times[swing[:100].argmax()] == pytest.approx(84.4 / 2 * 60, rel=0.03)
    at_rest, turning = (np.hypot(data[k]["east_m"], data[k]["north_m"]) for k in _RUNS)
    assert at_rest.max() > 20 * turning.max()


def test_search_finds_guides_and_not_the_words_of_the_reference(tmp_path):
    for name in ("sphinx", "myst_parser", "furo", "sphinx_copybutton"):
        pytest.importorskip(name)
    docs = tmp_path / "docs"
    shutil.copytree(DOCS / "_static", docs / "_static")
    for name in ("conf.py", "scenarios.md"):
        shutil.copy(DOCS / name, docs)
    (docs / "api").mkdir()
    (docs / "api" / "some.md").write_text("# Gyros\n\nThe fifth gyro.\n")
    (docs / "index.md").write_text("# Pages\n\n| [a](scenarios.md) |\n| [b](api/some.md) |\n")
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(docs), str(tmp_path / "out")]
    subprocess.run(command, cwd=ROOT, check=True, stderr=subprocess.DEVNULL)
    text = (tmp_path / "out" / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    page = index["docnames"].index("scenarios")
    for word in ("fifth", "gyro"):
        found = index["terms"].get(word, []), index["titleterms"].get(word, [])
        pages = {n for one in found for n in (one if isinstance(one, list) else [one])}
        assert pages == {page}
    tools = (tmp_path / "out" / "_static" / "language_data.js").read_text(encoding="utf-8")
    assert 'docname.startsWith("api/")' in tools
