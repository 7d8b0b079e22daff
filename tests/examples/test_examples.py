"""The examples that a user starts from run, and show what they promise."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from generate import notebook

from tests.processes import Fork

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("sensor_cost.py", "± "),
        ("lost_frames.py", "frames missing"),
        ("log_signals.py", "signals.png"),
        ("better_scheme.py", "residuals remain"),
    ],
)
def test_a_script(script, words, tmp_path):
    """It runs, its cycles of the scheme cut short."""
    text = (EXAMPLES / script).read_text(encoding="utf-8")
    (tmp_path / script).write_text(text.replace("duration_s=1600", "duration_s=100"))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with Fork([tmp_path / script], cwd=tmp_path, text=True, **pipes) as run:
        said, complaints = run.communicate()
    assert run.returncode == 0, complaints
    assert words in said
    assert complaints == ""


def test_every_script_is_tried():
    scripts = {path.name for path in EXAMPLES.glob("*.py")}
    tried = {case[0] for case in test_a_script.pytestmark[0].args[1]}
    assert scripts == tried


@pytest.mark.typed
def test_the_notebook_runs_and_shows_its_pictures(tmp_path):
    executed = notebook.execute(tmp_path)
    assert len(notebook.pictures_of(executed)) == len(notebook.NAMES)
    tables = [
        output["data"]["text/html"]
        for cell in executed.cells
        for output in cell.get("outputs", ())
        if "text/html" in output.get("data", {})
    ]
    assert any("largest error" in table for table in tables)
