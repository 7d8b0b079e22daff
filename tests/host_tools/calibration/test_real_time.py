"""A calibration over the embedded bus, in real time: the unit runs in processes of its own.

It takes two minutes: RRINS_REAL_TIME=1.
"""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rrins.host_tools.calibration.unit import drawn_unit

LATER_S = 250


@pytest.mark.skipif("RRINS_REAL_TIME" not in os.environ, reason="RRINS_REAL_TIME is not set")
@pytest.mark.timeout(600)
def test_a_unit_on_a_running_bus_is_calibrated_in_real_time(
    start: Callable[..., Any], tmp_path: Path
) -> None:
    axis = {"rate_limit_dps": 60, "acceleration_limit_dps2": 100}
    scenario = drawn_unit(3).varied(
        navigate_at_s=2 * LATER_S, turntable__inner=axis, turntable__outer=axis
    )
    path = tmp_path / "own.toml"
    path.write_text(scenario.toml(), encoding="utf-8")
    channel = f"calibration-{tmp_path.name}"
    unit = start("rehearse", path, "--speed", "1", "--channel", channel, "--json")
    time.sleep(5)  # the unit starts
    begun = time.monotonic()
    words = ["--channel", channel, "--rate", 60, "--stand", 1, "--out", tmp_path / "out", "--json"]
    tool = start("calibrate", path, *words)
    status, out = tool.finish(timeout=LATER_S)
    lasted_s = time.monotonic() - begun
    unit.process.send_signal(signal.SIGINT)
    unit.finish()
    assert status == 0, tool.said
    result = json.loads(out)
    assert result["duration_s"] > 60
    # Not faster than the table turns, but for what the unit makes up for after its start.
    assert result["seconds"] <= lasted_s + 5
    for kind in ("gyros", "accelerometers"):
        for key, found in result[kind].items():
            if not key.startswith("residual"):
                error = np.subtract(found["value"], getattr(getattr(scenario, kind), key))
                assert (np.abs(error) < 5 * np.array(found["sigma"])).all(), (kind, key)
