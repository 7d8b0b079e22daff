"""A build that the tests of this room share."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import cast

import pytest

from rrins.host_tools.builds.build import Build, build
from rrins.host_tools.scenario.scenario import Scenario, load


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """A rehearsal with one sensor an axis: its step compiles in half the time."""
    return load("imu_rotating")


@pytest.fixture(scope="session")
def built(scenario: Scenario, shared: Callable[[str], AbstractContextManager[Path]]) -> Build:
    """The scenario for this processor."""
    with shared("built") as folder:
        kept = folder / "build.pickle"
        if not kept.exists():
            made = build(scenario, "imu_rotating", "x86_64-linux", folder)
            kept.write_bytes(pickle.dumps(made))
        return cast(Build, pickle.loads(kept.read_bytes()))
