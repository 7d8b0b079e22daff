"""Velocity error, wear and range."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.settings import Scheme, Turn
from rrins.host_tools.hardware.tables import Accelerometers, Gyros
from rrins.host_tools.hardware.units import DPH, STANDARD_GRAVITY, UG
from rrins.host_tools.rotation.analysis import analyse
from rrins.host_tools.rotation.errors import sensors_of
from rrins.host_tools.rotation.merit import SensorSet, velocity_error
from rrins.host_tools.rotation.travel import travel_of
from rrins.host_tools.scenario.schemes import SCHEMES

from .conftest import paper_rimu


def standing(seconds):
    return Scheme(turns=(Turn(axis="inner", angle_deg=0),), stand_s=seconds)


def rimu(gyro=Gyros(), accelerometer=Accelerometers()):  # noqa: B008  # frozen
    return SensorSet(
        sensors_of("gyro", ((90, 0),), gyro),
        sensors_of("accelerometer", ((90, 0),), accelerometer),
    )


def test_an_accelerometer_bias_at_rest_is_a_ramp():
    error = velocity_error(standing(600), rimu(accelerometer=Accelerometers(bias_ug=50)))
    assert error.rms_mps == pytest.approx(50 * UG * 600 / math.sqrt(3))
    assert error.growth_mps_per_h == pytest.approx(50 * UG * 3600)


def test_a_gyro_bias_at_rest_is_a_parabola():
    """δv = g b t² / 2; Titterton and Weston (2004), 12.3.2."""
    error = velocity_error(standing(600), rimu(gyro=Gyros(bias_dph=0.1)))
    end = STANDARD_GRAVITY * 0.1 * DPH * 600**2 / 2
    assert error.rms_mps == pytest.approx(end / math.sqrt(5), rel=1e-5)
    assert error.growth_mps_per_h == pytest.approx(end * 6)


@pytest.mark.parametrize("name", ["16-position", "4-position"])
def test_it_is_the_integral_of_the_analysed_curves(name):
    both = paper_rimu()
    chosen = Scheme(turns=SCHEMES[name])
    variation = analyse(chosen, both.gyros, both.accelerometers)
    # Evenly, and finely enough for the trapezoidal rule.
    time_s = np.linspace(0, chosen.cycle_s, 200_001)
    step = time_s[1]
    squares = np.zeros_like(time_s)
    for integrals in (variation.gyros, variation.accelerometers):
        for curve in integrals.running[..., :2].reshape(len(variation.time_s), -1).T:
            error = np.interp(time_s, variation.time_s, curve)
            if integrals is variation.gyros:
                error = STANDARD_GRAVITY * np.concatenate(
                    [[0], np.cumsum((error[1:] + error[:-1]) / 2) * step]
                )
            squares += error**2
    expected = math.sqrt(np.mean(squares))
    assert velocity_error(chosen, both).rms_mps == pytest.approx(expected, rel=1e-4)


def test_travel_of_table_1():
    travel = travel_of(Scheme(turns=SCHEMES["16-position"]))
    inner, outer = travel.inner, travel.outer
    assert (inner.forward_deg, inner.backward_deg) == (720, 720)
    assert (inner.lowest_deg, inner.highest_deg, inner.net_deg) == (0, 720, 0)
    assert (outer.forward_deg, outer.backward_deg) == (720, 720)
    assert (outer.lowest_deg, outer.highest_deg, outer.net_deg) == (-180, 180, 0)
    assert (inner.reversals, outer.reversals) == (2, 6)
    assert travel.returns


def test_eight_positions_wind_the_inner_axis_on():
    travel = travel_of(Scheme(turns=SCHEMES["8-position"]))
    assert travel.inner.net_deg == 720
    assert travel.returns
    assert not travel_of(Scheme(turns=(Turn(axis="outer", angle_deg=90),))).returns
