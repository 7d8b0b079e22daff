"""`import rrins`: quick, complete, and nothing else at the top."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType

import click
import pytest

import rrins
from rrins.__main__ import main
from rrins.host_tools.cli.main import rrins as command


def test_every_name_is_there_and_explains_itself():
    for name in rrins.__all__:
        value = getattr(rrins, name)
        assert name == "__version__" or value.__doc__, name
    assert dir(rrins) == rrins.__all__


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="simulat"):
        _ = rrins.simulat


def test_importing_it_is_quick_and_brings_nothing_heavy():
    script = (
        "import sys; before = set(sys.modules); import rrins; rrins.__version__; "
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    heavy = {"numba", "numpy", "xarray", "pandas", "matplotlib", "can", "pydantic", "scipy"}
    assert not heavy & set(done.stdout.split())


class _Interrupted(ModuleType):
    """A module that Ctrl-C interrupts as it is imported."""

    def __getattr__(self, name):
        raise KeyboardInterrupt


def test_ctrl_c_while_the_command_is_imported_is_one_line(monkeypatch, capsys):
    name = "rrins.host_tools.cli.main"
    monkeypatch.setitem(sys.modules, name, _Interrupted(name))
    with pytest.raises(SystemExit, match="130"):
        main()
    assert capsys.readouterr().err == "rrins: stopped by the user\n"


CALLS = {
    "rehearse": "rehearse", "simulate": "simulate", "calibrate": "calibrate",
    "inject": "open_faults", "scenarios": "scenario_names", "conform": "conform", "bench": "bench",
    "dashboard": "open_dashboard", "diag": "open_diagnostics", "record": "record",
    "import": "import_recording", "replay": "replay", "export": "open_log",
    "increments": "write_increments", "plot": "open_log", "scheme": "analyse_scheme",
    "redundancy": "study_redundancy", "fmeda": "fmeda", "integrity": "study_integrity",
    "motion": "load_motion", "campaign": "Campaign", "covariance": "analyse_covariance",
    "allocate": "allocate",
    "reproduce": "reproduce", "explain": "Explanation", "build": "build",
}  # fmt: skip
PROCESSES = {"firmware", "hardware", "setup", "monitor", "socketcand", "slcan", "tour", "xcp"}
"""A side by itself, a terminal's screen, and ways onto the bus for other programs."""


def test_whatever_the_command_does_is_a_call_that_the_page_explains():
    page = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
    assert set(command.list_commands(click.Context(command))) == set(CALLS) | PROCESSES
    for call in CALLS.values():
        assert call in rrins.__all__
        assert f"rrins.{call}" in page
