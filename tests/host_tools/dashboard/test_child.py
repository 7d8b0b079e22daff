"""The rehearsal that a dashboard has started."""

from __future__ import annotations

import time
from pathlib import Path

from rrins.host_tools.bus.address import Address
from rrins.host_tools.dashboard.child import ChildRehearsal, Start
from rrins.host_tools.dashboard.opening import Subject, opened
from rrins.host_tools.scenario.scenario import load


def descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def test_its_history_begins_with_it_however_late_somebody_looks(scenario, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with opened(Subject(str(scenario), duration_s=10.0, speed=0)) as source:
        while source.status()["phase"] in ("starting", "running"):
            time.sleep(0.05)
        assert source.status()["phase"] == "ended"
        source.view.look()
        times, _ = source.view.history.rows()
        assert times[0] == 0.0
        assert times[-1] > 10.0


def test_one_that_has_ended_holds_no_pipe(tmp_path):
    address = Address("rrins", "test_child")
    before = descriptors()
    child = ChildRehearsal(
        Start("no_such_scenario", load("ideal"), (), address), tmp_path / "steer"
    )
    child._process.wait(60)
    state, words = child.outcome()
    assert state == "failed"
    assert "no_such_scenario" in words
    assert descriptors() == before
