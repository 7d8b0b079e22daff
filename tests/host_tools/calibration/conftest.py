"""Calibrations that several tests look at."""

from __future__ import annotations

import pytest

from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import drawn_unit
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.schemes import SCHEMES

SCHEME = Scheme(turns=SCHEMES["calibration"])


@pytest.fixture(scope="session")
def silent() -> tuple[Scenario, Seconds]:
    """A unit without noise, and what its table records."""
    scenario = drawn_unit(5, noise=0.0)
    return scenario, record(scenario, SCHEME)
