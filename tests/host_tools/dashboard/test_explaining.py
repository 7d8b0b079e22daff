"""Why the error is what it is, as the page asks: with the faults that were injected live."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest

from rrins.host_tools.dashboard.explaining import Explainer
from rrins.host_tools.dashboard.quantities import NAMES
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.scenario.scenario import load

FAULT = {"kind": "gyro_bias", "sensor": 3, "bias_dph": 20.0}


def view(error_m: float = np.nan, scenario: str | None = "ideal"):
    row = np.full((1, len(NAMES)), error_m)
    history = SimpleNamespace(rows=lambda: (np.array([20.0]), row))
    loaded = None if scenario is None else load(scenario, duration_s=30)
    return SimpleNamespace(scenario=loaded, history=history, time_s=18.0)


def asked(explainer, at, progress=lambda done, of: None):
    return asyncio.run(explainer.explain(at, 20.0, progress))


def test_a_live_fault_is_a_source_for_as_long_as_it_was_there():
    explainer, shown = Explainer(), view()
    explainer.note([{"keys": FAULT, "at_s": 10.0, "words": "gyro_bias (sensor 3)"}], shown)
    explainer.note([], shown)  # at 18 s it is no longer reported
    seen = []
    found = asked(explainer, shown, lambda done, of: seen.append((done, of)))
    assert [table["of"] for table in found["tables"]] == ["position", "velocity", "attitude"]
    first = found["tables"][0]["rows"][0]
    assert first["cells"][0] == "fault 1, gyro bias 3 at 10 s"
    assert first["share"] == pytest.approx(1.0, abs=0.01)
    assert seen[-1] == (4, 4)
    assert not found["note"]
    assert explainer._faults[0]["for_s"] == 8.0


def test_it_says_when_the_run_had_another_error_than_its_rerun():
    assert "The run shown was off by 7.07 m" in asked(Explainer(), view(5.0))["note"]


def test_without_a_scenario_or_before_navigation_it_says_so():
    with pytest.raises(RehearsalError, match="needs the scenario"):
        asked(Explainer(), view(scenario=None))
    with pytest.raises(RehearsalError, match="navigation begins at"):
        asyncio.run(Explainer().explain(view(), 0.5, lambda done, of: None))
