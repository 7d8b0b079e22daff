"""A navigation computer with the estimator, at power-on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rrins.firmware_py.core.estimator.settings import EstimatorSettings
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.firmware_py.core.sensors.data_sheet import DataSheet
from rrins.firmware_py.core.settings import OdometerSettings, power_on

GYROS = DataSheet(
    white_noise=(1e-6,) * 4,
    bias_instability=(0.003 * DPH,) * 4,
    rate_random_walk=(0.0,) * 4,
    temperature_drift=(0.0,) * 4,
    bias_limit=0.03 * DPH,
)
ACCELEROMETERS = DataSheet(
    white_noise=(1e-5,) * 4,
    bias_instability=(5 * UG,) * 4,
    rate_random_walk=(0.0,) * 4,
    temperature_drift=(0.0,) * 4,
    bias_limit=300 * UG,
    bias_sigma=50 * UG,
)
ODOMETER = OdometerSettings(interval_s=0.1, metres_per_pulse=0.01, noise_mps=0.02)


def make_estimator(**changes: Any) -> EstimatorSettings:
    return EstimatorSettings(**{"gyros": GYROS, "accelerometers": ACCELEROMETERS} | changes)


@pytest.fixture(scope="session")
def kit(tools, contract):
    """Set-ups of the estimator, and a record whose sensors are fused by equal weights."""

    def make_state(estimator: Any = None, **changes: Any) -> Any:
        changes.setdefault("height_channel", "free")
        settings = tools.settings(estimator=estimator or make_estimator(), **changes)
        state = power_on(settings, contract)[0]
        for fusion in (state.gyros, state.accelerometers):
            count = int(fusion.count)
            fusion.gain[:, :count] = np.linalg.pinv(fusion.H[:count])
        return state

    return SimpleNamespace(
        ACCELEROMETERS=ACCELEROMETERS,
        GYROS=GYROS,
        ODOMETER=ODOMETER,
        estimator=make_estimator,
        state=make_state,
    )
