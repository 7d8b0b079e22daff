"""Thresholds keep the promise on false alarms."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.records.redundancy_records import NOISE_S, WINDOWS_S
from rrins.firmware_py.core.redundancy import settings


@pytest.mark.parametrize("factor", [settings.second_factor, settings.noise_limit])
def test_a_stricter_promise_is_a_higher_threshold(factor):
    thresholds = [factor(allowed, 1) for allowed in (10.0, 1.0, 0.1)]
    assert thresholds == sorted(thresholds)
    assert factor(1.0, 3) > factor(1.0, 1)


def test_short_windows_need_more_for_they_are_more():
    assert settings.epoch_factor(1.0, 1, 200) > settings.second_factor(1.0, 1)


def test_counts_repeat_no_oftener_than_promised():
    """Of a sensor with half of the noise that its data sheet states."""
    random = np.random.default_rng(4)
    epochs, rate_hz = 2_000_000, 200
    for noise in (3.0, 8.0, 25.0):
        allowed = 3.6e6 * rate_hz * 2e-3
        enough = settings.equal_counts(allowed, noise, rate_hz)
        counts = np.diff(np.rint(np.cumsum(0.3 + random.normal(0.0, 0.5 * noise, epochs))))
        alike = np.concatenate([[0], np.cumsum(np.diff(counts) == 0)])
        runs = np.count_nonzero(alike[enough:] - alike[:-enough] == enough)
        assert runs <= 2e-3 * epochs
    assert settings.equal_counts(1e-4, 25.0, rate_hz) <= 10
    assert settings.equal_counts(1e-4, 0.1, rate_hz) == 0


def test_noise_alarms_as_often_as_promised():
    """Counted on white noise, with a promise so loose that there is something to count."""
    seconds, allowed = 4_000_000, 30_000.0
    factor = settings.second_factor(allowed, 1)
    limit = settings.noise_limit(allowed, 1)
    random = np.random.default_rng(3)
    noise = random.normal(size=seconds)
    sums = np.concatenate([[0.0], np.cumsum(noise)])
    alarms = 0
    for w in WINDOWS_S:
        beyond = np.abs(sums[w:] - sums[:-w]) > factor * np.sqrt(w)
        alarms += int(np.count_nonzero(beyond & ~np.roll(beyond, 1)))
    promised = allowed * seconds / 3.6e6
    assert 0.1 * promised < alarms < promised
    squares = np.concatenate([[0.0], np.cumsum(noise**2)])
    means = (squares[NOISE_S:] - squares[:-NOISE_S]) / NOISE_S
    beyond = means > limit
    noisy = np.count_nonzero(beyond & ~np.roll(beyond, 1))
    assert 0.05 * promised < noisy < promised
