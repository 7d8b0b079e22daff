"""Velocity error, wear and range."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.settings import Scheme, Turn
from rrins.host_tools.hardware.units import STANDARD_GRAVITY
from rrins.host_tools.rotation.analysis import analyse
from rrins.host_tools.rotation.merit import velocity_error
from rrins.host_tools.rotation.travel import travel_of
from rrins.host_tools.scenario.schemes import SCHEMES

from .conftest import paper_rimu


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
