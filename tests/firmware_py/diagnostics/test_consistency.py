"""Redundant sensors that contradict each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.firmware_py.diagnostics import table

CUBE_AND_DIAGONALS_DEG = (
    *((90.0, 0.0), (90.0, 90.0), (0.0, 0.0)),
    *((54.7356, 45.0), (54.7356, 135.0), (54.7356, -45.0)),
)


def failed(bench):
    faults = bench.firmware.diagnostics.faults
    return {trouble.name for trouble, _ in faults.by_mask(Status.TEST_FAILED)}


def bias(bench, kind, sensor, value):
    """Give a sensor a bias, in °/h or µg."""
    resolution = bench.state["diagnostics"][f"{kind}_repetition"]["resolution"]
    unit = DPH if kind == "gyro" else UG
    rates = bench._gyro if kind == "gyro" else bench._accelerometer
    rates[sensor - 1] += value * unit * bench.period_ns * 1e-9 / resolution


def run(bench, seconds):
    for _ in range(round(seconds * 1e9 / bench.period_ns)):
        bench.step()


def residuals(tool_of, bench, kind):
    number = table.identifier(f"{kind}_residuals").number
    answer = tool_of(bench).ask(bytes([0x22, number >> 8, number & 0xFF]))
    (values,) = table.identifier(number).decode(bytes.fromhex(answer)[3:]).values()
    return np.array(values[: int(bench.state[f"{kind}s"]["count"])])


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "value"), [("gyro", 200.0), ("accelerometer", 20_000.0)])
def test_a_bias_of_one_of_four_leaves_a_quarter_in_each(at, tool_of, kind, value):
    bench = at(Mode.STANDBY)
    run(bench, 60)
    before = residuals(tool_of, bench, kind)
    bias(bench, kind, 2, value)
    run(bench, 100)
    found = residuals(tool_of, bench, kind) - before
    assert np.abs(found) == pytest.approx([value / 4] * 4, rel=1e-3)
    assert found[1] > 0
    assert failed(bench) == {f"{kind}s_inconsistent"}


@pytest.mark.slow
def test_of_six_the_largest_residual_names_the_one(at, tool_of):
    axes = CUBE_AND_DIAGONALS_DEG
    bench = at(Mode.STANDBY, gyro_axes_deg=axes, accelerometer_axes_deg=axes)
    bias(bench, "gyro", 5, -300.0)
    run(bench, 60)
    assert np.argmax(np.abs(residuals(tool_of, bench, "gyro"))) == 4
    assert failed(bench) == {"gyros_inconsistent"}


@pytest.mark.slow
def test_what_the_parameter_allows_is_no_trouble(at):
    # The root sum of squares with one of four wrong is half its bias.
    for limit, trouble in ((101.0, set()), (99.0, {"gyros_inconsistent"})):
        bench = at(Mode.STANDBY, gyro_consistency_dph=limit)
        bias(bench, "gyro", 1, 200.0)
        run(bench, 120)
        assert failed(bench) == trouble


@pytest.mark.slow
def test_three_cannot_contradict_each_other(at):
    axes = ((90.0, 0.0), (90.0, 90.0), (0.0, 0.0))
    bench = at(Mode.STANDBY, gyro_axes_deg=axes, accelerometer_axes_deg=axes)
    bias(bench, "gyro", 1, 1000.0)
    run(bench, 60)
    assert failed(bench) == set()


@pytest.mark.slow
def test_it_takes_its_time_and_heals(at):
    bench = at(Mode.STANDBY)
    bias(bench, "gyro", 3, 200.0)
    after_s = 10 * math.log(2)  # the mean comes to 50 of 100 °/h
    run(bench, after_s + 4.9)
    assert failed(bench) == set()
    run(bench, 0.2)
    assert failed(bench) == {"gyros_inconsistent"}
    bias(bench, "gyro", 3, -200.0)
    run(bench, 20)
    assert failed(bench) == set()


@pytest.mark.slow
def test_one_that_is_left_out_is_compared_with_the_others(at, tool_of):
    bench = at(Mode.STANDBY)
    bias(bench, "gyro", 4, 200.0)
    bench.state["diagnostics"]["excluded_gyros"] = 0b0001
    run(bench, 100)
    found = np.abs(residuals(tool_of, bench, "gyro"))
    assert found == pytest.approx([200.0, 0.0, 0.0, 0.0], abs=0.5)
    assert failed(bench) == set()
    bench.state["diagnostics"]["excluded_gyros"] = 0
    run(bench, 0.5)
    assert np.abs(residuals(tool_of, bench, "gyro")).max() < 10.0
