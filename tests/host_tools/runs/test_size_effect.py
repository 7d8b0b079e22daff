"""Lever arms of the accelerometers end to end: with them calibrated, navigation is as without."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario.scenario import Scenario

POSITIONS = {
    "position_x_mm": [60.0, -30.0, -40.0, 20.0],
    "position_y_mm": [10.0, 50.0, -45.0, 0.0],
    "position_z_mm": [-40.0, 20.0, 30.0, -55.0],
}
SWAY = {
    "duration_s": 600,
    "motion": {"kind": "sway"},
    "altimeter": {},
    "firmware": {"height_channel": "damped"},
}
QUICK_TURNS = {"duration_s": 600, "firmware": {"turn_rate_dps": 20, "stand_s": 3}}


@pytest.fixture
def calibration(tmp_path):
    lines = [f"{key} = {values}" for key, values in POSITIONS.items()]
    path = tmp_path / "cal.toml"
    path.write_text("\n".join(["[accelerometers]", *lines]), encoding="utf-8")
    return str(path)


def largest_m(errors):
    return float(np.hypot(errors.position_east_m, errors.position_north_m).max())


@pytest.mark.slow
@pytest.mark.parametrize(("case", "raw_m"), [(SWAY, 1.0), (QUICK_TURNS, 0.1)])
def test_calibrated_positions_leave_no_error(fly, calibration, case, raw_m):
    scenario = Scenario.model_validate(case)
    placed = scenario.varied(accelerometers=POSITIONS)
    _, without = fly(scenario)
    _, raw = fly(placed)
    firmware, calibrated = fly(placed.varied(firmware__calibration=calibration))
    assert largest_m(raw) > raw_m
    assert abs(largest_m(calibrated) - largest_m(without)) < 1e-3
    assert firmware["calibration"]["accelerometers"] == POSITIONS


def test_positions_of_zero_change_no_bit(fly):
    case = {"duration_s": 20, "firmware": {"turn_rate_dps": 30, "stand_s": 5}}
    zero = {key: [0, 0, 0, 0] for key in POSITIONS}
    hashes = {
        fly(Scenario.model_validate(case | more))[0]["navigation_sha256"]
        for more in ({}, {"accelerometers": zero})
    }
    assert len(hashes) == 1


def test_positions_have_one_number_each_and_limits(calibration):
    with pytest.raises(ValueError, match="2 values for 4 sensors"):
        Scenario.model_validate({"duration_s": 1, "accelerometers": {"position_x_mm": [1, 2]}})
    with pytest.raises(ValueError, match="less than or equal to 1000"):
        Scenario.model_validate({"duration_s": 1, "accelerometers": {"position_x_mm": 1001}})
    scenario = Scenario.model_validate({"duration_s": 1, "firmware": {"calibration": calibration}})
    table = firmware_settings(scenario).calibration.accelerometers
    assert table.position_z_mm == tuple(POSITIONS["position_z_mm"])
