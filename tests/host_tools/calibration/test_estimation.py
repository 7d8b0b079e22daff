"""Least squares against the errors that were put in, its standard deviations against scatter."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import estimate
from rrins.host_tools.calibration.monte_carlo import errors_of, run
from rrins.host_tools.calibration.observability import LIMITS
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import SQUARE_ARCSEC, drawn_unit, unit_of
from rrins.host_tools.errors import CalibrationRecordError
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.schemes import SCHEMES

SCHEME = Scheme(turns=SCHEMES["calibration"])


def test_without_noise_it_finds_what_was_put_in(silent: tuple[Scenario, Seconds]) -> None:
    scenario, seconds = silent
    found = estimate(unit_of(scenario), seconds)
    for errors, limit in zip(errors_of(scenario, found), LIMITS, strict=True):
        assert (np.abs(errors.error[0]) < 0.2 * limit).all()
    assert found.epsilon == pytest.approx(SQUARE_ARCSEC * ARCSEC, abs=0.05 * ARCSEC)
    heading_error = np.arctan2(found.C_b_n[0, 1], found.C_b_n[1, 1])
    assert abs(heading_error) < 60 * ARCSEC  # given with 1°


def test_one_position_does_not_show_the_constants() -> None:
    scenario = drawn_unit(2)
    scheme = Scheme(turns=SCHEMES["calibration"][:1], turn_rate_dps=30.0, stand_s=2.0)
    seconds = record(scenario, scheme).where(slice(15, None))
    with pytest.raises(CalibrationRecordError, match="do not show all constants"):
        estimate(unit_of(scenario), seconds)


def test_seconds_of_a_missing_sensor_do_not_count(silent: tuple[Scenario, Seconds]) -> None:
    scenario, seconds = silent
    gyro, usable = seconds.gyro.copy(), seconds.gyro_usable.copy()
    gyro[100:140, 1] = 1.0
    usable[100:140, 1] = False
    spoilt = Seconds(**{**vars(seconds), "gyro": gyro, "gyro_usable": usable})
    found = estimate(unit_of(scenario), spoilt)
    for errors, limit in zip(errors_of(scenario, found), LIMITS, strict=True):
        assert (np.abs(errors.error[0]) < 0.2 * limit).all()


def test_sigma_has_the_wandering_of_the_biases() -> None:
    """Of the data sheet's instability, or without one of what the residuals show."""
    wanders = drawn_unit(6).varied(gyros__bias_instability_dph=0.2)
    seconds = record(wanders, SCHEME)
    unit = unit_of(wanders)
    stated = estimate(unit, seconds)
    unknown = estimate(dataclasses.replace(unit, sheets=None), seconds)
    white = estimate(unit_of(drawn_unit(6)), record(drawn_unit(6), SCHEME))
    assert (stated.gyros.sigma[:, 0] > 5 * white.gyros.sigma[:, 0]).all()
    ratio = unknown.gyros.instability / stated.gyros.instability
    assert ((ratio > 0.4) & (ratio < 2.5)).all()
    errors = errors_of(wanders, stated)[0]
    assert np.mean((errors.error / errors.sigma) ** 2) < 2.5


def test_g_sensitivity_is_estimated_where_the_data_sheet_has_it() -> None:
    scenario = drawn_unit(7).varied(gyros__g_sensitivity_dph_per_g=0.5)
    found = estimate(unit_of(scenario), record(scenario, SCHEME))
    assert found.g_sensitivity * STANDARD_GRAVITY / DPH == pytest.approx([0.5] * 4, abs=0.1)
    errors = errors_of(scenario, found)[0]
    assert np.mean((errors.error / errors.sigma) ** 2) < 2.5


@pytest.mark.soak
@pytest.mark.parametrize("geometry", ["tetrahedron", "dodecahedron"])
def test_reaches_what_is_wanted_with_honest_sigmas(geometry: str) -> None:
    found = run(SCHEME, range(1, 11), {"geometry": geometry})
    for errors, limit in zip(found, LIMITS, strict=True):
        assert (errors.median_rms < 1.2 * limit).all()
        assert ((errors.normalised > 0.7) & (errors.normalised < 1.3)).all()


def test_a_unit_with_noise_reaches_what_is_wanted() -> None:
    for errors, limit in zip(run(SCHEME, range(1, 3), None), LIMITS, strict=True):
        assert (errors.median_rms < 1.5 * limit).all()
        assert ((errors.normalised > 0.3) & (errors.normalised < 1.9)).all()
