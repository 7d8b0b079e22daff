"""The weight of residuals, however little is known of what all sensors should measure."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import Parity
from rrins.firmware_py.core.redundancy import isolation
from rrins.firmware_py.core.sensors.calibration import input_axes
from rrins.host_tools.scenario.geometry import GEOMETRIES


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_inverse_covariance_holds_up_to_the_parity_alone(geometry):
    H = input_axes(GEOMETRIES[geometry])
    count = len(H)
    own = 1e-12 * np.linspace(1.0, 3.0, count)
    fusion, parity = np.zeros(1, Fusion.dtype)[0], np.zeros(1, Parity.dtype)[0]
    fusion["count"], fusion["H"][:count] = count, H
    parity["sensors"], parity["white_variance"][:count] = (1 << count) - 1, own
    found = {}
    for common in (0.0, 1e-14, 1e-10, 1e-6, 1e20):
        parity["expected_variance"][:] = common
        assert isolation.weigh(parity, fusion, 0) == count
        found[common] = parity["matrix"][:count, :count].copy()
        if common < 1e20:
            expected = np.linalg.inv(np.diag(own) + common * (H @ H.T))
            assert found[common] == pytest.approx(expected, rel=1e-4, abs=1e-6 * expected.max())
    assert found[1e20] == pytest.approx(found[1e-6], rel=1e-3, abs=1e-5 / own[0])
    assert found[1e20] @ H == pytest.approx(0.0, abs=1e-9 / own[0])
