"""The firmware's fusion of the sensors, for other programs: H, weights, calibration."""

from __future__ import annotations

import rrins.firmware_py.core.settings as firmware
from rrins.dbc.contract import load_contract
from rrins.firmware_py.core.records.memory import Fusion
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario.scenario import Scenario


def _of_kind(fusion: Fusion) -> JsonObject:
    count = int(fusion.count)
    return {
        "H": fusion.H[:count].tolist(),
        "weights": fusion.weight[:count].tolist(),
        "bias_increment": fusion.bias_increment[:count].tolist(),
        "scale_error": fusion.scale_error[:count].tolist(),
        "asymmetric_scale_error": fusion.asymmetric_scale_error[:count].tolist(),
    }


def fusion_set_up(scenario: Scenario) -> JsonObject:
    """Return H, weights and calibration of both kinds of sensors, in all digits.

    `H` has a row per sensor: the input axis in the sensor frame, as calibrated. A bias increment is
    in rad or m/s per epoch; scale errors have no unit.

    Raises
    ------
    ScenarioError
        When the calibration file cannot be used.
    MotionError
        When a recorded motion cannot be used.
    """
    state = firmware.power_on(firmware_settings(scenario), load_contract())[0]
    return {
        "period_ns": scenario.period_ns,
        "gyros": _of_kind(state.gyros),
        "accelerometers": _of_kind(state.accelerometers),
    }
