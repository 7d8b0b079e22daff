"""The calibration: its file, and that it undoes (16), (17)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.sensors import calibration
from rrins.firmware_py.core.sensors.calibration import (
    AccelerometerCalibration,
    CalibrationError,
    GyroCalibration,
    input_axes,
)
from rrins.firmware_py.core.sensors.fusion import compensate, fuse

TETRAHEDRON_DEG = (
    (180.0, 0.0),
    *((math.degrees(math.acos(1 / 3)), b) for b in (0.0, 120.0, 240.0)),
)
DT = 0.005


def fusion_of(sensors):
    fusion = np.zeros(1, dtype=Fusion.dtype)[0]
    fusion["count"], fusion["weight"][:4] = 4, 1.0
    calibration.fill(fusion, TETRAHEDRON_DEG, sensors, DT)
    return fusion


FOUR = st.tuples(*[st.floats(-1, 1)] * 4)


@pytest.mark.slow
@settings(max_examples=60)
@given(FOUR, FOUR, FOUR, FOUR, FOUR, st.tuples(*[st.floats(-0.02, 0.02)] * 3))
def test_it_is_the_inverse_of_equation_16(bias, scale, asymmetric, delta_u, delta_v, true_s):
    fusion = fusion_of(
        GyroCalibration(
            bias_dph=tuple(100 * b for b in bias),
            scale_error_ppm=tuple(2000 * s for s in scale),
            asymmetric_scale_error_ppm=tuple(1000 * a for a in asymmetric),
            installation_u_arcsec=tuple(600 * d for d in delta_u),
            installation_v_arcsec=tuple(600 * d for d in delta_v),
        )
    )
    arcsec, dph = math.radians(1 / 3600), math.radians(1 / 3600)
    measured = np.zeros(16)
    for k, (alpha, beta) in enumerate(np.radians(TETRAHEDRON_DEG)):
        h = [math.sin(alpha) * math.cos(beta), math.sin(alpha) * math.sin(beta), math.cos(alpha)]
        u = [math.cos(alpha) * math.cos(beta), math.cos(alpha) * math.sin(beta), -math.sin(alpha)]
        v = [-math.sin(beta), math.cos(beta), 0.0]
        installed = (
            np.array(h)
            - 600 * delta_u[k] * arcsec * np.array(v)
            - 600 * delta_v[k] * arcsec * np.array(u)
        )
        x = float(installed @ true_s)
        factor = 1 + 2000e-6 * scale[k] + 1000e-6 * asymmetric[k] * np.sign(x)
        measured[k] = factor * x + 100 * bias[k] * dph * DT
    compensate(fusion, 0b1111, measured)
    fused = np.zeros(3)
    assert fuse(fusion, 0b1111, measured, fused, np.zeros((3, 3)))
    # Where the bias is larger than x, the sign is still that of x: it is taken off first.
    assert fused == pytest.approx(true_s, abs=1e-16 + 1e-13)


def test_the_units_are_those_of_the_keys():
    fusion = fusion_of(AccelerometerCalibration(bias_ug=10, scale_error_ppm=(1, 2, 3, 4)))
    assert fusion["bias_increment"][:4] == pytest.approx([10 * 9.80665e-6 * DT] * 4)
    assert fusion["scale_error"][:4] == pytest.approx([1e-6, 2e-6, 3e-6, 4e-6])
    assert fusion["calibrated"]
    fusion = fusion_of(GyroCalibration(bias_dph=1))
    assert fusion["bias_increment"][:4] == pytest.approx([math.radians(1) / 3600 * DT] * 4)


def test_nothing_calibrated_is_the_design():
    fusion = fusion_of(GyroCalibration())
    assert not fusion["calibrated"]
    assert np.array_equal(fusion["H"][:4], input_axes(TETRAHEDRON_DEG))
    installed = fusion_of(GyroCalibration(installation_u_arcsec=5))
    assert not installed["calibrated"]  # in H, nothing to do in an epoch
    assert not np.array_equal(installed["H"], fusion["H"])


@pytest.fixture
def load(tmp_path):
    def loader(text, gyros=4, accelerometers=4):
        path = tmp_path / "cal.toml"
        path.write_text(text, encoding="utf-8")
        return calibration.load(path, gyros, accelerometers)

    return loader


def test_a_file_takes_one_number_or_one_for_each(load):
    loaded = load("[gyros]\nbias_dph = [1, 2, 3]\n[accelerometers]\nbias_ug = 7", gyros=3)
    assert loaded.gyros.bias_dph == (1, 2, 3)
    assert loaded.accelerometers.bias_ug == 7
    assert load("") == calibration.Calibration()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[gyros]\nbias_dph = [1, 2, 3]", ["gyros.bias_dph", "3 values for 4 sensors"]),
        ("[accelerometers]\nbias_ug = [1]", ["accelerometers.bias_ug", "1 values for 4"]),
        ("[gyros]\nbias_ug = 1", ["gyros.bias_ug", "no such key", "did you mean bias_dph"]),
        ("[gyro]\nbias_dph = 1", ["gyro: no such key", "did you mean gyros"]),
        ("[gyros.sigma]\nbias_dhp = 1", ["gyros.sigma.bias_dhp", "did you mean bias_dph"]),
        ("[gyros.sigma]\nbias_dph = [1, 2]", ["gyros.sigma.bias_dph", "2 values for 4"]),
        ("[gyros.sigma]\nscale_error_ppm = -1", ["gyros.sigma.scale_error_ppm"]),
        ("[calibrated]\ndate_utc = 2026-11-23T08:05:00", ["calibrated.date_utc"]),
        ("[calibrated]\ndate_utc = 1969-11-23T08:05:00Z", ["calibrated.date_utc"]),
        ("[calibrated]\ntemperature_c = 300", ["calibrated.temperature_c"]),
        ("[gyros]\nbias_dph = 'big'", ["gyros.bias_dph", "number", "'big'"]),
        ("[gyros]\nscale_error_ppm = -1e6", ["gyros.scale_error_ppm", "100000"]),
        ("[gyros]\nbias_dph = nan", ["gyros.bias_dph", "finite"]),
        ("[gyros\nbias_dph = 1", ["not TOML", "line 1"]),
    ],
)
def test_a_wrong_file_is_told_in_one_line(load, tmp_path, text, words):
    with pytest.raises(CalibrationError) as caught:
        load(text)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"calibration {tmp_path / 'cal.toml'}: ")
    for word in words:
        assert word in message


def test_a_missing_file_is_told_in_one_line(tmp_path):
    with pytest.raises(CalibrationError, match=r"cannot be read: No such file"):
        calibration.load(tmp_path / "none.toml", 4, 4)
