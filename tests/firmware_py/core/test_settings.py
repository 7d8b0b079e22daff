"""The memory image that power-on makes from the settings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.sensors.calibration import input_axes
from rrins.firmware_py.core.settings import Scheme, Turn, power_on

FLAT = ((90.0, 0.0), (90.0, 120.0), (89.99, 240.0), (0.0, 0.0))
"""Three axes close to one plane, and one across."""


def image(tools, contract, **changes):
    return power_on(tools.settings(**changes), contract)[0]


def test_the_tetrahedron_is_the_papers():
    # (53): α = 70.53°
    alpha, c, s = 70.528779, 1 / 3, math.sqrt(8) / 3
    H = input_axes(((180, 0), (alpha, 0), (alpha, 120), (alpha, 240)))
    expected = [[0, 0, -1], [s, 0, c]]
    expected += [[s * math.cos(b), s * math.sin(b), c] for b in np.radians([120, 240])]
    assert pytest.approx(np.array(expected), abs=1e-8) == H


@pytest.mark.parametrize("rate_hz", [50, 200, 400, 1000])
def test_times_become_epochs(tools, contract, rate_hz):
    state = image(tools, contract, rate_hz=rate_hz, alignment_s=2.0, bridge_s=0.1)
    parameters = state["parameters"]
    assert parameters["period_ns"] * rate_hz == 1_000_000_000
    assert parameters["alignment_epochs"] == 2 * rate_hz
    assert parameters["bridge_epochs"] == rate_hz // 10
    assert parameters["axis_silence_epochs"] == rate_hz // 10
    assert set(parameters["position_epochs"][:16]) == {3.5 * rate_hz}


def test_as_many_sensors_as_there_are_frames_for(tools, contract):
    random = np.random.default_rng(1)
    axes = tuple(map(tuple, random.uniform(0, 180, (SENSOR_GROUPS, 2))))
    state = image(tools, contract, gyro_axes_deg=axes)
    assert state["gyros"]["count"] == SENSOR_GROUPS
    assert state["accelerometers"]["count"] == 4
    assert np.linalg.norm(state["gyros"]["H"], axis=1) == pytest.approx(np.ones(SENSOR_GROUPS))
    assert list(state["accelerometers"]["weight"][:5]) == [1, 1, 1, 1, 0]


@pytest.mark.parametrize(
    "changes",
    [
        {"height_channel": "floating"},
        {"latitude_deg": math.nan},
        {"colour": "red"},
        {"gyro_weights": (1.0, 1.0, 1.0, 1e19)},
        {"accelerometer_weights": (1.0, 0.0, 1.0, 1.0)},
        {"gyro_axes_deg": FLAT, "gyro_weights": (1e12, 1e12, 1e12, 1.0)},
    ],
)
def test_settings_that_make_no_sense_are_refused(tools, changes):
    with pytest.raises(ValidationError):
        tools.settings(**changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"turns": ()},
        {"turns": 65 * (Turn(axis="inner", angle_deg=1),)},
        {"turn_rate_dps": 0},
        {"turn_rate_dps": 61},
        {"stand_s": -1},
    ],
)
def test_schemes_that_make_no_sense_are_refused(changes):
    with pytest.raises(ValidationError):
        Scheme(**{"turns": (Turn(axis="inner", angle_deg=180),)} | changes)


@pytest.mark.parametrize("changes", [{"axis": "middle"}, {"angle_deg": 721}])
def test_turns_that_make_no_sense_are_refused(changes):
    with pytest.raises(ValidationError):
        Turn(**{"axis": "inner", "angle_deg": 180} | changes)
