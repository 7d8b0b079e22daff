"""The rehearsal that a dashboard has started."""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from unittest.mock import MagicMock

from rrins.host_tools.bus.address import Address
from rrins.host_tools.dashboard import bus_source
from rrins.host_tools.dashboard.child import ChildRehearsal, Start
from rrins.host_tools.scenario.scenario import load


def descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


def test_its_history_begins_with_it_however_late_somebody_looks(monkeypatch):
    attached, child = threading.Event(), MagicMock()
    child.return_value.__enter__.return_value.outcome.return_value = ("ended", "")
    monkeypatch.setattr(bus_source, "ChildRehearsal", child)
    monkeypatch.setattr(bus_source, "Receiver", lambda *arguments: attached.set())
    start = Start("ideal", load("ideal"), (), Address("rrins", "test_child"))
    with contextlib.closing(bus_source.RehearsalSource(start, 1.0)) as source:
        assert attached.wait(60)
    times, _ = source.view.history.rows()
    assert times.tolist() == [0.0]


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
