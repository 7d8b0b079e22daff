"""At standstill the constants are learned, and a vehicle that comes to rest is none of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import ABSOLUTE, SETTLED_S, Parity
from rrins.firmware_py.core.redundancy import learning, standing
from rrins.firmware_py.core.sensors.calibration import DPH, input_axes

TETRAHEDRON_DEG = ((180.0, 0.0), *((np.degrees(np.arccos(1 / 3)), 120.0 * k) for k in range(3)))
NOISE = 0.3 * DPH  # of a second


@pytest.fixture
def at_rest():
    """Return what closes a second at rest, the vector of all sensors off by so many °/h."""
    fusion = np.zeros(1, Fusion.dtype)[0]
    fusion["count"] = 4
    fusion["H"][:4] = input_axes(TETRAHEDRON_DEG)
    parity = np.zeros(1, Parity.dtype)[0]
    parity["sensors"] = 0b1111
    parity["standing_limit"] = math.radians(0.02)  # 72 °/h
    parity["expected"]["prior"][0] = (10 * DPH) ** 2
    learning.forget_all(parity["expected"], NOISE**2)
    parity["regressors"][0] = 1.0

    def close(vector_dph, even=True):
        parity["vector"][:] = np.multiply(vector_dph, DPH)
        standing.close_second(parity, fusion, ABSOLUTE + 4, True, True, even)
        return parity["expected"]["coefficients"][:3, 0] / DPH

    return close


def test_the_last_pitching_before_rest_and_the_first_before_a_start_are_not_learned(at_rest):
    for rate in (60.0, 30.0, 10.0, *[0.0] * (2 * SETTLED_S - 3)):
        learned = at_rest((rate, 0, 0))
    assert learned == pytest.approx(np.zeros(3), abs=1e-12)
    for _ in range(20 + SETTLED_S):
        learned = at_rest((0.1, 0, 0))
    assert learned == pytest.approx([0.1, 0, 0], abs=0.05)
    before = learned
    for rate in (1.0, 10.0, 30.0, 60.0, 100.0):
        learned = at_rest((rate, 0, 0))
    assert learned == pytest.approx(before, abs=0.05)


def test_a_constant_is_learned_after_the_vehicle_has_settled(at_rest):
    for _ in range(2 * SETTLED_S):
        learned = at_rest((0.2, -0.1, 0.3))
    assert learned == pytest.approx(np.zeros(3), abs=1e-12)
    assert at_rest((0.2, -0.1, 0.3)) == pytest.approx([0.2, -0.1, 0.3], rel=0.01)


def test_a_second_in_which_an_axis_starts_or_stops_is_not_learned(at_rest):
    for second in range(4 * SETTLED_S):
        starts = second == SETTLED_S
        learned = at_rest((3.0 if starts else 0.1, 0, 0), even=not starts)
    assert learned == pytest.approx([0.1, 0, 0], abs=0.001)
