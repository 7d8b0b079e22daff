"""Numbers that were typed in units of their own come back as they were typed."""

from __future__ import annotations

import numpy as np
import pytest

import rrins
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.host_tools.runs.set_up.typed_numbers import typed_number, typed_numbers

TYPED = {
    "gyros": {
        "bias_dph": [0.1, 0.11, 0.12, 0.13],
        "scale_error_ppm": [0.29, -57.1, 50.0, 1e-3],
        "asymmetric_scale_error_ppm": [0.07, 1.1, -2.3, 0.0],
        "installation_u_arcsec": [10.1, -0.3, 29.9, 0.7],
        "installation_v_arcsec": [0.9, 0.0, -7.7, 3.3],
    },
    "accelerometers": {"bias_ug": [50.1, 55.3, -60.7, 65.9]},
}


@pytest.mark.parametrize("unit", [DPH, UG, PPM, ARCSEC, DPH * 0.005, UG * 0.02])
def test_what_went_through_another_unit_is_as_it_was_typed(unit):
    typed = [round(0.01 * k, 2) for k in range(-3000, 3000)]
    converted = np.array(typed) * unit / unit
    assert converted.tolist() != typed  # this is what it is for
    assert typed_numbers(converted) == typed
    assert [typed_number(value) for value in converted] == typed


@pytest.mark.parametrize("rate_hz", [50, 200])
def test_the_summary_has_the_errors_of_the_sensors_as_they_were_typed(rate_hz):
    tables = {kind: dict(values) for kind, values in TYPED.items()}
    run = rrins.simulate("rimu_rotating", duration_s=1, rate_hz=rate_hz, **tables)
    found = run.summary["hardware"]["biases"]
    gyros = dict(TYPED["gyros"])
    assert found["gyros_dph"] == gyros.pop("bias_dph")
    assert found["accelerometers_ug"] == TYPED["accelerometers"]["bias_ug"]
    angles = [key for key in gyros if key.startswith("installation")]
    for key in angles:  # through axes that are turned by them: to second order
        assert found["gyros"][key] == pytest.approx(gyros.pop(key), abs=1e-2)
    assert {key: found["gyros"][key] for key in gyros} == gyros
