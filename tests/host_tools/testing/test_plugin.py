"""The plugin, seen from a user's pytest run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import can

TESTS = """
import pytest

@pytest.fixture
def stuck(rrins_bench):
    bench = rrins_bench({"duration_s": 10})
    bench.expect("NAV_LATITUDE", within=0.1)

def test_reaches_navigation(rrins_bench):
    bench = rrins_bench({"duration_s": 10}, firmware={"alignment_s": 0.5})
    bench.send("MODE_COMMAND", mode_request="ALIGN")
    bench.expect("NAV_LATITUDE", within=0.8)

def test_of_a_fixture(stuck):
    pass

def test_that_passes(rrins_bench):
    rrins_bench({"duration_s": 10}).advance(0.1)

def test_kills(rrins_bench):
    bench = rrins_bench({"duration_s": 10}, way="lockstep")
    bench.advance(0.1)
    bench.process.kill()
"""


def read_log(text):
    """Return the messages of the log that a report names."""
    path = re.search(r"^(/\S+\.log): (\d+) frames", text, re.MULTILINE)
    with can.LogReader(path[1]) as reader:
        messages = list(reader)
    assert len(messages) == int(path[2])
    return Path(path[1]), messages


def test_a_failing_test_leaves_the_log_of_its_bus(run_test, tmp_path):
    run = run_test(TESTS, "-k", "reaches")
    assert run.status == 1
    assert "rrins bus" in run.text
    assert "no NAV_LATITUDE within 0.8 s" in run.text
    assert "mode ALIGNMENT, fault NONE at 0.700 s" in run.text
    path, messages = read_log(run.text)
    assert path.is_relative_to(tmp_path / "basetemp")
    own, sync, *_, last = messages
    assert (own.arbitration_id, own.timestamp, own.is_rx) == (0x018, 0, False)
    assert (sync.arbitration_id, sync.timestamp, sync.is_rx) == (0x010, 0, True)
    assert (last.arbitration_id, last.timestamp) == (0x021, 0.795)


def test_who_leaves_a_log_and_where(run_test, tmp_path):
    """A test or fixture that fails, and a process that died unnoticed; not a test that passes."""
    run = run_test(TESTS, "--rrins-log-dir", str(tmp_path / "logs"))
    assert [run.count(outcome) for outcome in ("failed", "passed", "error")] == [1, 2, 2]
    assert re.search(r"the firmware process \d+ was killed by SIGKILL \(status -9\)", run.text)
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == [
        "test_own.py_test_kills.log",
        "test_own.py_test_of_a_fixture.log",
        "test_own.py_test_reaches_navigation.log",
    ]


def test_the_plugin_imports_nothing_heavy():
    """The plug-in alone imports no compiler, no codec and no bus."""
    script = (
        "import sys, rrins.host_tools.testing.plugin;"
        "print([m for m in ('numba', 'numpy', 'cantools', 'can', 'pydantic') if m in sys.modules])"
    )
    said = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert said.stdout.strip() == "[]"
