"""The noise: its distribution, its independence, its repeatability."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware.memory import Sensors
from rrins.host_tools.hardware.noise import normal, normals, uniform
from rrins.host_tools.hardware.settings import power_on

N = 20_000


def seeded(*states):
    sensors = np.zeros(1, dtype=Sensors.dtype)[0]
    sensors["noise_state"][: len(states)] = states
    return sensors


@pytest.fixture(scope="module")
def sample():
    sensors = seeded(12345)
    return np.array([normal(sensors, 0) for _ in range(N)])


def test_uniform_numbers_are_those_of_splitmix64():
    # Steele, Lea and Flood's generator from 1234567, as Vigna's reference implementation gives it.
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    sensors = seeded(1234567)
    assert [uniform(sensors, 0) for _ in expected] == [(x >> 11) / 2**53 for x in expected]


def test_the_mean_is_zero_and_the_variance_one(sample):
    assert abs(sample.mean()) < 4 / math.sqrt(N)
    assert sample.var() == pytest.approx(1, abs=4 * math.sqrt(2 / N))


def test_the_distribution_is_the_normal_one(sample):
    edges = np.array([-3, -2, -1, -0.5, 0, 0.5, 1, 2, 3])
    for edge in edges:
        share = (1 + math.erf(edge / math.sqrt(2))) / 2
        assert np.mean(sample < edge) == pytest.approx(share, abs=4 * math.sqrt(0.25 / N))
    assert (sample**4).mean() == pytest.approx(3, abs=4 * math.sqrt(96 / N))


@pytest.mark.parametrize("lag", [1, 2, 3])
def test_one_number_says_nothing_of_the_next(sample, lag):
    assert abs(np.mean(sample[lag:] * sample[:-lag])) < 4 / math.sqrt(N)
    assert abs(np.mean(sample[lag:] ** 2 * sample[:-lag] ** 2) - 1) < 12 / math.sqrt(N)


def test_the_same_seed_gives_the_same_numbers_for_each_sensor_alone():
    together, alone = seeded(7, 8), seeded(7, 8)
    interleaved = [[normal(together, k) for k in (0, 1)] for _ in range(50)]
    assert [row[0] for row in interleaved] == [normal(alone, 0) for _ in range(50)]
    assert [row[1] for row in interleaved] == [normal(alone, 1) for _ in range(50)]


def test_every_sensor_and_every_seed_has_its_own_stream(tools):
    states = set()
    for seed in range(20):
        plant = power_on(tools.settings(seed=seed))[0]
        for kind in ("gyros", "accelerometers"):
            states |= set(plant[kind]["noise_state"][:4].tolist())
    assert len(states) == 20 * 8
    again = power_on(tools.settings(seed=3))[0]
    assert again.tobytes() == power_on(tools.settings(seed=3))[0].tobytes()


@pytest.mark.parametrize("counts", [(1, 2, 20, 7), (199, 400, 1001), (0, 5, 1, 1, 1)])
def test_many_at_once_are_those_one_by_one(counts):
    one_by_one, at_once = seeded(99, 1234), seeded(99, 1234)
    work = np.zeros((5, 128))
    for count in counts:
        found = np.zeros(count)
        normals(at_once, 1, found, work, work[4].view(np.int64))
        wanted = np.array([normal(one_by_one, 1) for _ in range(count)])
        np.testing.assert_allclose(found, wanted, rtol=2e-15)
        assert at_once["noise_state"].tobytes() == one_by_one["noise_state"].tobytes()
        assert at_once["noise_has_spare"][1] == one_by_one["noise_has_spare"][1]
