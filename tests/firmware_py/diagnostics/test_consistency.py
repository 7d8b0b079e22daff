"""Redundant sensors that contradict each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.firmware_py.diagnostics import table

RATE_HZ = 50  # the filters go by time
CUBE_AND_DIAGONALS_DEG = (
    *((90.0, 0.0), (90.0, 90.0), (0.0, 0.0)),
    *((54.7356, 45.0), (54.7356, 135.0), (54.7356, -45.0)),
)


def bias(bench, kind, sensor, value):
    """Give a sensor a bias, in °/h or µg."""
    resolution = bench.state["diagnostics"][f"{kind}_repetition"]["resolution"]
    unit = DPH if kind == "gyro" else UG
    rates = bench._gyro if kind == "gyro" else bench._accelerometer
    rates[sensor - 1] += value * unit * bench.period_ns * 1e-9 / resolution


@pytest.fixture
def idle(at):
    """Return what makes a bench in STANDBY."""

    def make(**settings):
        return at(Mode.STANDBY, rate_hz=RATE_HZ, **settings)

    return make


def residuals(tool_of, bench, kind):
    number = table.identifier(f"{kind}_residuals").number
    answer = tool_of(bench).ask(bytes([0x22, number >> 8, number & 0xFF]))
    (values,) = table.identifier(number).decode(bytes.fromhex(answer)[3:]).values()
    return np.array(values[: int(bench.state[f"{kind}s"]["count"])])


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "value"), [("gyro", 200.0), ("accelerometer", 20_000.0)])
def test_a_bias_of_one_of_four_leaves_a_quarter_in_each(idle, tool_of, kind, value):
    bench = idle()
    bench.run(round(60 * RATE_HZ))
    before = residuals(tool_of, bench, kind)
    bias(bench, kind, 2, value)
    bench.run(round(100 * RATE_HZ))
    found = residuals(tool_of, bench, kind) - before
    assert np.abs(found) == pytest.approx([value / 4] * 4, rel=1e-3)
    assert found[1] > 0
    assert bench.failed() == {f"{kind}s_inconsistent"}


@pytest.mark.slow
def test_of_six_the_largest_residual_names_the_one(idle, tool_of):
    axes = CUBE_AND_DIAGONALS_DEG
    bench = idle(gyro_axes_deg=axes, accelerometer_axes_deg=axes)
    bias(bench, "gyro", 5, -300.0)
    bench.run(round(60 * RATE_HZ))
    assert np.argmax(np.abs(residuals(tool_of, bench, "gyro"))) == 4
    assert bench.failed() == {"gyros_inconsistent"}


@pytest.mark.slow
def test_what_the_parameter_allows_is_no_trouble(idle):
    # The root sum of squares with one of four wrong is half its bias.
    for limit, trouble in ((101.0, set()), (99.0, {"gyros_inconsistent"})):
        bench = idle(gyro_consistency_dph=limit)
        bias(bench, "gyro", 1, 200.0)
        bench.run(round(120 * RATE_HZ))
        assert bench.failed() == trouble


@pytest.mark.slow
def test_three_cannot_contradict_each_other(idle):
    axes = ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0))
    bench = idle(gyro_axes_deg=axes, accelerometer_axes_deg=axes)
    bias(bench, "gyro", 1, 1000.0)
    bench.run(round(60 * RATE_HZ))
    assert bench.failed() == set()


@pytest.mark.slow
def test_it_takes_its_time_and_heals(idle):
    bench = idle()
    bias(bench, "gyro", 3, 200.0)
    after_s = 10 * math.log(2)  # the mean comes to 50 of 100 °/h
    bench.run(round((after_s + 4.9) * RATE_HZ))
    assert bench.failed() == set()
    bench.run(round(0.2 * RATE_HZ))
    assert bench.failed() == {"gyros_inconsistent"}
    bias(bench, "gyro", 3, -200.0)
    bench.run(round(20 * RATE_HZ))
    assert bench.failed() == set()


@pytest.mark.slow
def test_one_that_is_left_out_is_compared_with_the_others(idle, tool_of):
    bench = idle()
    bias(bench, "gyro", 4, 200.0)
    bench.state["diagnostics"]["excluded_gyros"] = 0b0001
    bench.run(round(100 * RATE_HZ))
    found = np.abs(residuals(tool_of, bench, "gyro"))
    assert found == pytest.approx([200.0, 0.0, 0.0, 0.0], abs=0.5)
    assert bench.failed() == set()
    bench.state["diagnostics"]["excluded_gyros"] = 0
    bench.run(round(0.5 * RATE_HZ))
    assert np.abs(residuals(tool_of, bench, "gyro")).max() < 10.0
