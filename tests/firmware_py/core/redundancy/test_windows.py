"""Noise that is too large is found, and what is not learned yet is none."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import ABSOLUTE, WINDOWS_S, Parity
from rrins.firmware_py.core.redundancy import parity as parities
from rrins.firmware_py.core.redundancy import settings, windows
from rrins.firmware_py.core.sensors.calibration import input_axes

TETRAHEDRON_DEG = ((180.0, 0.0), *((np.degrees(np.arccos(1 / 3)), 120.0 * k) for k in range(3)))


@pytest.fixture
def close():
    """Return what closes a second, the sum of the parity given in its standard deviations."""
    fusion = np.zeros(1, Fusion.dtype)[0]
    fusion["count"] = 4
    fusion["H"][:4] = input_axes(TETRAHEDRON_DEG)
    fusion["weight"][:4] = 1.0
    parity = np.zeros(1, Parity.dtype)[0]
    parity["white_variance"][:4] = 1.0
    for learner in ("parity", "ahead"):
        parity[learner]["prior"][:2] = 0.25
    parity["second_factor"] = settings.second_factor(0.01, 1)
    parity["noise_limit"] = settings.noise_limit(0.01, 1)
    parities.compare(parity, fusion, 0b1111, 200, np.empty((3, 3)))

    def closer(deviations, rate=0.0, suspects=False):
        parity["regressors"][:2] = 1.0, rate
        parity["residual"][:4] = deviations * np.sqrt(parity["second_variance"][:4])
        ratio = windows.close_second(parity, 4, ABSOLUTE + 4, suspects)
        windows.keep(parity, 4)
        parities.begin_second(parity)
        return ratio

    closer.parity = parity
    return closer


def test_too_much_noise_is_found_within_seconds(close):
    random = np.random.default_rng(1)
    assert max(close(random.normal()) for _ in range(100)) < 1.0
    assert max(close(5 * random.normal()) for _ in range(10)) > 1.0


def test_a_new_direction_is_learned_even_while_noise_is_on_the_large_side(close):
    """Errors shown by the first turn about an axis are alike from second to second."""
    for k in range(64):
        assert close(1.5 * (-1) ** k) < 1.0  # two thirds of what would be an alarm
    for k in range(64):
        rate = k / 64
        assert close(1.5 * (-1) ** k + 3.0 * rate, rate) < 1.0


def test_a_step_is_fitted_to_a_window_as_by_least_squares(close):
    """With a constant and a slope of variance 1, in variances of a second's noise."""
    random = np.random.default_rng(2)
    rates = np.sin(0.3 * np.arange(150))
    step = np.arange(150) >= 118
    seen = random.normal(size=150) + 0.4 + 0.7 * rates + step
    for deviations, rate in zip(seen, rates, strict=True):
        close(deviations, rate)
    X = np.column_stack([np.ones(150), rates, step])
    covariance = np.linalg.inv(X.T @ X + np.diag([1.0, 1.0, 0.0]))
    level = WINDOWS_S.index(32)
    fitted = close.parity["window_sum"][level, :4] / np.sqrt(close.parity["second_variance"][:4])
    assert fitted == pytest.approx(32 * (covariance @ X.T @ seen)[2])
    assert close.parity["window_uncertain"][level] + 32 == pytest.approx(32**2 * covariance[2, 2])


def test_a_step_is_not_learned_for_half_a_minute(close):
    for _ in range(150):
        close(0.0)
    for _ in range(31):
        close(2.5)
    assert close.parity["parity"]["coefficients"][0, 0] == 0.0
    assert close.parity["ahead"]["coefficients"][0, 0] > 0.0


def test_a_fault_of_two_seconds_as_a_turn_begins_is_not_learned(close):
    ratios = [close(8.0 if 5 <= k < 7 else 0.0, float(k >= 4)) for k in range(60)]
    assert min(ratios[5:7]) > 1.0
    assert not close.parity["parity"]["coefficients"].any()


def test_nothing_is_learned_while_a_fault_is_suspected(close):
    """What is quiet for a while may still be off: as the table turns, or where little is known."""
    for _ in range(64):
        close(0.2)
    learned = close.parity["parity"]["coefficients"].copy()
    for _ in range(64):
        assert close(0.4, suspects=True) < 1.0
    assert (close.parity["parity"]["coefficients"] == learned).all()
    close(0.4)
    assert (close.parity["parity"]["coefficients"] != learned).any()
