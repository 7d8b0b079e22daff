"""The loop written by hand is what it is compared with: the same navigation, but for rounding."""

from __future__ import annotations

import numpy as np

from rrins.host_tools.benchmarks.fast_path import SCENARIO
from rrins.host_tools.benchmarks.limit import COLUMNS, Limit
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import load

_IN_MID_TURN, _EPOCHS = 9_000, 4_000


def test_the_limit_navigates_as_the_fast_path_does():
    scenario = load(SCENARIO)
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    run.run(_IN_MID_TURN)
    for sensors in (run.plant[0].gyros, run.plant[0].accelerometers):
        sensors.drifts = False  # once a second, and no part of the limit
    limit = dict(zip(COLUMNS, Limit(run).run(_EPOCHS).T, strict=True))
    navigation = run.run(_EPOCHS).navigation
    east, north, _ = navigation["velocity_n"].T
    for name in ("latitude", "longitude", "roll", "pitch"):
        np.testing.assert_allclose(limit[name], navigation[name], rtol=0, atol=1e-12)
    turned = limit["heading"] - navigation["heading"]
    np.testing.assert_allclose(np.exp(1j * turned), 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(limit["velocity_e"], east, rtol=0, atol=1e-12)
    np.testing.assert_allclose(limit["velocity_n"], north, rtol=0, atol=1e-12)
