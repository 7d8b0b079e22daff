"""Examples of the page on Python run: with shorter runs, in a folder of their own."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rrins

PAGE = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SHORTER = (
    ("duration_s=1600", "duration_s=10"),
    ("_s=60,", "_s=10,"),
    (', "dodecahedron"]', "]"),
    ("cases=10", "cases=2, seed=0"),  # none of the wire, which are run frame by frame
)


@pytest.fixture
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")


@pytest.mark.typed
@pytest.mark.usefixtures("_folder")
def test_its_blocks_run():
    scope: dict[str, object] = {}
    for block in BLOCKS:
        if "with rrins." in block:  # needs a rehearsal under way
            continue
        block = re.sub(
            r"^rrins\.(search_schemes|reproduce|import_recording).*\n",
            "",
            block,
            flags=re.MULTILINE,
        )
        for long, short in SHORTER:
            block = block.replace(long, short)
        exec(compile(block, "docs/python.md", "exec"), scope)
    assert scope["run"].summary["duration_s"] == 10
    assert scope["log"].messages


def test_every_name_of_the_page_is_there():
    for name in set(re.findall(r"\brrins\.(\w+)", PAGE)):
        assert name in rrins.__all__, name
