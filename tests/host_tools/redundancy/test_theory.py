"""Detection limits: closed forms for white noise, and faults that a geometry cannot separate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.records.redundancy_records import WINDOWS_S
from rrins.firmware_py.core.redundancy import settings
from rrins.host_tools.redundancy.candidates import candidates_of
from rrins.host_tools.redundancy.sensor_kinds import KINDS
from rrins.host_tools.redundancy.theory import HALF, MOST, Finder
from rrins.host_tools.scenario.scenario import Scenario

GYROS, ACCELEROMETERS = KINDS
NOISE = 0.3  # °/h over a second: 0.005 °/√h
PROMISE = 0.06


def finder_of(geometry, axes=None, **gyros):
    custom = {} if axes is None else {"gyro_axes_deg": axes, "accelerometer_axes_deg": axes}
    scenario = Scenario.model_validate(
        {
            "duration_s": 1,
            "rimu": {"geometry": geometry} | custom,
            "gyros": {"angle_random_walk_deg_per_sqrt_h": NOISE / 60} | gyros,
            "redundancy": {"enabled": True, "false_alarms_per_1000_h": PROMISE},
        }
    )
    return Finder(scenario, GYROS)


@pytest.fixture(scope="module")
def tetrahedron():
    return finder_of("tetrahedron")


def test_thresholds_are_those_of_the_firmware(tetrahedron):
    assert 2 * (settings.SECONDS_SHARE + settings.EPOCHS_SHARE + settings.NOISE_SHARE) == 2.0
    seconds, epochs, noise = (
        PROMISE / 2 * share
        for share in (settings.SECONDS_SHARE, settings.EPOCHS_SHARE, settings.NOISE_SHARE)
    )
    assert tetrahedron.second_factor == settings.second_factor(seconds, 1)
    assert tetrahedron.epoch_factor == settings.epoch_factor(epochs, 1, 200)
    assert tetrahedron.noise_limit == settings.noise_limit(noise, 1)


@pytest.mark.parametrize("within_s", [10, 60])
@pytest.mark.parametrize(("probability", "further"), [(HALF, 0.0), (MOST, 1.645)])
def test_white_noise_sets_the_smallest_fault(tetrahedron, within_s, probability, further):
    """Half of a step is in the parity; a sum of w seconds has √w times the noise of one.

    The last test comes half a second before the end on average, when a window may not be full.
    """
    windows = [w for w in WINDOWS_S if w <= 128]
    signal = max(min(w, within_s - 0.5) / math.sqrt(w) for w in windows)
    expected = (tetrahedron.second_factor + further) * NOISE / 0.5 / signal
    found = tetrahedron.smallest(0, within_s, "alarm", probability)
    assert found == pytest.approx(expected, rel=0.1)  # what was learned is not exact either


def test_a_large_fault_is_known_within_two_epochs_and_named_within_two_seconds(tetrahedron):
    chances = tetrahedron.chances(2, 1000.0)
    assert chances.delay_s("alarm", HALF) == pytest.approx(0.005)
    assert chances.delay_s("alarm", MOST) == pytest.approx(0.010)  # it begins within an epoch
    assert 0.4 < chances.delay_s("standing", HALF) < 1.0
    assert 0.9 < chances.delay_s("standing", MOST) < 1.5


def test_a_small_fault_takes_longer_and_one_that_is_learned_is_never_found(tetrahedron):
    delays = [tetrahedron.chances(0, size).delay_s("alarm", HALF) for size in (10, 2, 1, 0.5)]
    assert delays == sorted(delays)
    assert tetrahedron.chances(0, 0.01).delay_s("alarm", HALF) == math.inf
    assert (np.diff(tetrahedron.chances(0, 0.5).found["alarm"]) >= 0).all()


def test_drift_hides_what_white_noise_would_not(tetrahedron):
    drifting = finder_of("tetrahedron", bias_instability_dph=0.05)
    for way in ("alarm", "standing"):
        found = [one.smallest(0, 600, way, HALF) for one in (tetrahedron, drifting)]
        assert found[1] > 1.5 * found[0]


def test_four_sensors_never_tell_which_in_motion_and_one_alone_is_not_checked(tetrahedron):
    assert tetrahedron.chances(0, 100.0).delay_s("parity", HALF) == math.inf
    assert tetrahedron.smallest(0, 10, "parity", HALF) == math.inf
    axes = ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0), (0.0, 0.0))
    parallel = finder_of("custom", axes)
    assert [parallel.is_checked(sensor) for sensor in range(4)] == [False, False, True, True]
    for way in ("alarm", "standing", "parity"):
        assert parallel.chances(0, 100.0).delay_s(way, HALF) == math.inf


def test_six_sensors_name_the_one_in_motion():
    six = finder_of("dodecahedron")
    assert six.share == pytest.approx([0.5] * 6)  # 1 - 3/6
    two = math.sqrt((5 + math.sqrt(5)) / 10)  # of an axis and the plane of two others
    assert six.rivals == pytest.approx([1.0] + [two] * 5)  # all alike look like the first
    named, known = (six.smallest(1, 10, way, HALF) for way in ("parity", "alarm"))
    assert known <= named < 1.3 * known
    assert six.smallest(0, 10, "parity", HALF) == math.inf


def test_of_three_orthogonal_and_one_the_fourth_shows_most():
    finder = finder_of("orthogonal-plus-one")
    assert finder.share == pytest.approx([1 / 6, 1 / 6, 1 / 6, 1 / 2])
    first, fourth = (finder.smallest(sensor, 10, "alarm", HALF) for sensor in (0, 3))
    assert first / fourth == pytest.approx(math.sqrt(3), rel=0.02)


def test_accelerometers_have_their_own_unit():
    (candidate,) = candidates_of(None, ["tetrahedron"])
    finder = Finder(candidate.scenario, ACCELEROMETERS)
    assert finder.chances(0, 1e5, 2).delay_s("alarm", HALF) == pytest.approx(0.005)
    assert finder.chances(0, 1.0).delay_s("alarm", HALF) == math.inf
