"""Increments on the firmware's epochs: nothing lost, whatever the recording's rate."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.vehicle import epochs
from rrins.host_tools.vehicle.errors import VehicleError
from rrins.host_tools.vehicle.recording import Fixes, Increments

SCALES, LIMITS = (4e-9, 1.25e-7), (2**23 - 1, 2**23 - 1)


def recorded(rate_hz, duration_s=20.0, begin_s=1000.0):
    time_s = begin_s + np.arange(1, int(duration_s * rate_hz) + 1) / rate_hz
    angle = 0.3 * np.sin(0.5 * (time_s - begin_s))
    before = 0.3 * np.sin(0.5 * (time_s - begin_s - 1 / rate_hz))
    values = np.repeat((angle - before)[:, np.newaxis], 3, axis=1)
    return Increments(time_s, values, 2 * values)


def laid(increments, begins_s, ends_s, rate_hz=200):
    return epochs.laid_out(increments, begins_s, ends_s, rate_hz, SCALES, LIMITS)


@pytest.mark.parametrize("rate_hz", [200.0, 200.017, 187.3, 100.0])
def test_sums_are_those_of_the_recording(rate_hz):
    found = laid(recorded(rate_hz), 1001.0, 1015.0)
    assert len(found) == 14 * 200
    total = found.gyros.sum(axis=0) * SCALES[0]
    truth = 0.3 * np.sin(0.5 * 15) - 0.3 * np.sin(0.5 * 1)
    assert total == pytest.approx([truth] * 3, abs=2e-6 if rate_hz != 200.0 else 1e-8)
    assert found.accelerometers.sum(axis=0) * SCALES[1] == pytest.approx([2 * truth] * 3, abs=4e-6)


def test_rows_at_the_epochs_are_taken_as_they_are():
    increments = recorded(200.0)
    found = laid(increments, 1001.0, 1010.0)
    rows = increments.dtheta[200 : 200 + len(found)]
    assert np.abs(found.gyros * SCALES[0] - rows).max() < SCALES[0]


def test_a_gap_is_filled_at_the_rate_after_it():
    whole = recorded(200.0)
    kept = np.ones(len(whole.time_s), dtype=bool)
    kept[1000:1010] = False
    holey = Increments(whole.time_s[kept], whole.dtheta[kept], whole.dv[kept])
    found = laid(holey, 1001.0, 1015.0)
    assert len(found.gaps) == 1
    assert found.gaps[0][1] == pytest.approx(0.055)
    assert found.gyros.sum(axis=0) * SCALES[0] == pytest.approx(
        laid(whole, 1001.0, 1015.0).gyros.sum(axis=0) * SCALES[0], abs=1e-4
    )
    kept[1000:1300] = False
    with pytest.raises(VehicleError, match=r"1\.50 s are missing before 1006\.505 s"):
        laid(Increments(whole.time_s[kept], whole.dtheta[kept], whole.dv[kept]), 1001.0, 1015.0)


def test_what_no_frame_can_hold_is_cut_and_counted():
    increments = recorded(200.0)
    increments.dtheta[500, 1] = 1.0
    found = laid(increments, 1001.0, 1015.0)
    assert found.clipped == 1
    assert np.abs(found.gyros).max() == LIMITS[0]


def test_the_rate_is_the_nearest_that_the_firmware_has():
    assert epochs.rate_of(recorded(200.017)) == 200
    assert epochs.rate_of(recorded(99.2)) == 100
    assert epochs.rate_of(recorded(127.0)) == 128
    with pytest.raises(VehicleError, match=r"come at 10\.0 Hz"):
        epochs.rate_of(recorded(10.0))


def test_fixes_fall_on_the_ends_of_epochs():
    fixes = Fixes(np.arange(5) + 0.0021, np.zeros((5, 3)), np.ones((5, 3)))
    begin = epochs.grid_begin(2.5, 0.005, fixes)
    assert abs(begin - 2.5) <= 0.0025
    phase = (fixes.time_s - begin) / 0.005
    assert phase == pytest.approx(np.rint(phase), abs=1e-6)
