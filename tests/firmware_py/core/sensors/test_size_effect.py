"""The firmware's removal of the size effect, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.records.memory import Fusion, SizeEffect
from rrins.firmware_py.core.sensors import calibration, size_effect
from rrins.firmware_py.core.sensors.calibration import AccelerometerCalibration

ORTHOGONAL_DEG = ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0))
ALL = 0b111
DT = 0.005


def both_of(**positions):
    sensors = AccelerometerCalibration(**positions)
    fusion = np.zeros(1, dtype=Fusion.dtype)[0]
    fusion["count"] = 3
    calibration.fill(fusion, ORTHOGONAL_DEG, sensors, DT)
    effect = np.zeros(1, dtype=SizeEffect.dtype)[0]
    size_effect.fill(effect, sensors, 3)
    return effect, fusion


def removed(effect, fusion, rate_s, received=ALL):
    """Return what is taken out of the increments of an epoch at a mean rate, rad/s."""
    measured = np.zeros(16)
    size_effect.follow(effect, np.asarray(rate_s) * DT, DT)
    size_effect.remove(effect, fusion, received, measured, DT)
    return -measured[:3]


def test_a_constant_rate_is_omega_squared_r():
    effect, fusion = both_of(position_x_mm=40.0)
    for _ in range(3):
        taken = removed(effect, fusion, [0.0, 0.0, 0.5])
        assert taken == pytest.approx([-0.25 * 0.04 * DT, 0.0, 0.0], abs=1e-16)


def test_a_rate_that_grows_evenly_is_exact_from_the_third_epoch_on():
    effect, fusion = both_of(position_x_mm=100.0)
    growth = 1e-3  # rad/s per epoch
    for epoch in range(6):
        taken = removed(effect, fusion, [0.0, 0.0, growth * (epoch + 0.5)])
        if epoch >= 2:
            assert taken[1] == pytest.approx(0.1 * growth, rel=1e-9)


def test_what_the_extrapolation_misses_does_not_add_up():
    effect, fusion = both_of(position_x_mm=100.0)
    rng = np.random.default_rng(1)
    sums = np.zeros(3)
    for rate in [0.0, *rng.uniform(-1, 1, 200), 0.3, 0.3, 0.3]:
        sums += removed(effect, fusion, [0.0, 0.0, rate])
    assert sums[1] == pytest.approx(0.1 * 0.3)


def test_an_accelerometer_that_was_not_heard_is_left_alone():
    effect, fusion = both_of(position_x_mm=40.0)
    assert removed(effect, fusion, [0.0, 0.0, 0.5], received=0b110)[0] == 0
