"""A calibrated unit navigates almost as one with perfect constants."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.afterwards import VARIANTS, navigate
from rrins.host_tools.scenario.schemes import SCHEMES


@pytest.mark.slow
def test_calibration_leaves_little_beside_the_noise() -> None:
    (found,) = navigate("rotating", Scheme(turns=SCHEMES["calibration"]), range(1, 3), 1600.0)
    uncalibrated, calibrated, perfect, silent = np.median(found.largest_m, axis=0)
    assert len(VARIANTS) == found.largest_m.shape[1]
    assert uncalibrated > 3 * calibrated
    assert 0.7 < calibrated / perfect < 1.4
    assert silent < 0.5 * perfect
