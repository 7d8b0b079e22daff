"""The rehearsal that a dashboard has started."""

from __future__ import annotations

from pathlib import Path

from rrins.host_tools.bus.address import Address
from rrins.host_tools.dashboard.child import ChildRehearsal, Start
from rrins.host_tools.scenario.scenario import load


def descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


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
