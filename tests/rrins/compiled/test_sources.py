"""Which sources the digest of compiled code is over: no stale code, and no needless compiling."""

from __future__ import annotations

import os
import re

import pytest

from rrins.compiled import sources
from rrins.compiled.sources import PACKAGE, Sources, stamp_of

STEP = '''"""A step."""
from rrins.dbc import scale
from rrins.dbc.limits import LIMIT, UNUSED

def plan():
    return UNUSED

@compiled
def step(x):
    """Return a step."""
    return min(LIMIT, x * scale.SCALE)
'''
FILES = {
    "dbc/__init__.py": "",
    "dbc/rrins.dbc": "VERSION",
    "dbc/limits.py": "from rrins.dbc.constants import BASE\nLIMIT = 2 * BASE\nUNUSED = 3\n",
    "dbc/constants.py": "BASE = 1.0\n",
    "dbc/scale.py": "SCALE = _scale()\n\ndef _scale():\n    return 4\n",
    "runs/step.py": STEP,
    "runs/tool.py": "from rrins.runs.step import step\n\ndef main():\n    step(1)\n",
}
COUNTING = {"dbc/constants.py", "dbc/limits.py", "dbc/scale.py", "runs/step.py"}


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "rrins"
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def test_every_file_with_compiled_functions_counts():
    decorated = re.compile(r"^ *@compiled(_with\(.*\))?$", re.MULTILINE)
    names = [path for path in sources._files(PACKAGE) if path.endswith(".py")]
    compiled = {
        path for path in names if decorated.search((PACKAGE / path).read_text(encoding="utf-8"))
    }
    assert {"host_tools/runs/fast.py", "firmware_py/exchange.py"} < compiled
    counting = set(Sources().files())
    assert compiled <= counting
    assert "host_tools/runs/rehearsal.py" not in counting


def test_what_compiled_functions_refer_to_counts_however_far_away(package):
    assert set(Sources(package).files()) == COUNTING


@pytest.mark.parametrize(
    ("file", "old", "new", "counts"),
    [
        ("runs/step.py", "x * scale", "x + scale", True),
        ("dbc/constants.py", "1.0", "7.0", True),
        ("dbc/scale.py", "return 4", "return 5", True),
        ("dbc/rrins.dbc", "VERSION", "version", True),
        ("runs/tool.py", "step(1)", "step(2)", False),
        ("runs/step.py", "Return a step.", "Return the step.", False),
        ("runs/step.py", "    return min", "    # why\n    return  min", False),
    ],
)
def test_a_change_counts_where_it_can_change_code(package, tmp_path, file, old, new, counts):
    memory = tmp_path / "kept" / "sources.json"
    before = Sources(package, memory).digest
    text = (package / file).read_text()
    assert old in text
    (package / file).write_text(text.replace(old, new))
    assert (Sources(package, memory).digest != before) is counts
    assert Sources(package, memory).digest == Sources(package).digest


def test_files_that_were_not_written_since_are_not_read_again(package, tmp_path, monkeypatch):
    memory = tmp_path / "kept" / "sources.json"
    digest = Sources(package, memory).digest
    read = []
    monkeypatch.setattr(sources, "facts_of", lambda text: read.append(text))
    assert Sources(package, memory).digest == digest
    assert not read


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"now": 1}'])
def test_damaged_facts_are_read_anew(package, tmp_path, damage):
    memory = tmp_path / "kept" / "sources.json"
    digest = Sources(package, memory).digest
    for path in memory.parent.iterdir():
        path.write_bytes(damage)
    assert Sources(package, memory).digest == digest


def test_a_file_written_after_its_function_was_made_is_noticed(package):
    path = package / "runs" / "step.py"
    made = stamp_of(path)
    assert Sources(package).is_as_digested(str(path), made)
    os.utime(path, ns=(1, 1))
    assert not Sources(package).is_as_digested(str(path), made)
    assert not Sources(package).is_as_digested("/elsewhere.py", made)
