"""RIMUs with errors, as the tests of this room need them."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.hardware.settings import ARCSEC, DPH, PPM, UG, SensorErrors
from rrins.host_tools.rotation.errors import sensors_of
from rrins.host_tools.rotation.merit import SensorSet
from rrins.host_tools.scenario.geometry import GEOMETRIES

PAPER = {
    "gyro": SensorErrors(0.1 * DPH, 50 * PPM, 50 * PPM, 10 * ARCSEC, 10 * ARCSEC),
    "accelerometer": SensorErrors(50 * UG, 30 * PPM, 30 * PPM, 10 * ARCSEC, 10 * ARCSEC),
}
"""Of sensor 3 in the paper, 4.2."""


def of_paper(kind, axes_deg, fused=False):
    """Return sensors that all have the paper's errors."""
    return sensors_of(kind, tuple(axes_deg), (PAPER[kind],) * len(axes_deg), fused)


def paper_rimu(geometry="tetrahedron", fused=False):
    """Return a RIMU of a built-in geometry, all sensors with the paper's errors."""
    axes = GEOMETRIES[geometry]
    return SensorSet(of_paper("gyro", axes, fused), of_paper("accelerometer", axes, fused))


@pytest.fixture
def random():
    return np.random.default_rng(351)
