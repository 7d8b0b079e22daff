"""A build that the tests of this room share."""

from __future__ import annotations

from pathlib import Path

import pytest

from rrins.host_tools.builds.build import Build, build
from rrins.host_tools.scenario.scenario import Scenario, load


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """A rehearsal with one sensor an axis: its step compiles in half the time."""
    return load("imu_rotating")


@pytest.fixture(scope="session")
def built(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Build:
    """The scenario for this processor."""
    folder: Path = tmp_path_factory.mktemp("built")
    return build(scenario, "imu_rotating", "x86_64-linux", folder)
