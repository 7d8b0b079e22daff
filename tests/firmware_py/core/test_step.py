"""The whole step: gaps bridged or not, sensors left out, the same bytes every time."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest

from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest

STRAPDOWN = Mode.NAVIGATION_STRAPDOWN


def navigating(tools, rotating=False, **changes):
    bench = tools.Bench(**changes)
    if rotating:
        bench.run_to(Mode.NAVIGATION_ROTATING, ModeRequest.NAVIGATE_ROTATING)
    else:
        bench.run_to(STRAPDOWN, ModeRequest.NAVIGATE_STRAPDOWN)
    return bench


def position_error(bench):
    """Return how far (m) from where navigation started."""
    output = bench.state["navigation"]
    north = output["latitude"] - bench.state["parameters"]["latitude"]
    east = output["longitude"] - bench.state["parameters"]["longitude"]
    return 6.4e6 * math.hypot(north, east * math.cos(output["latitude"]))


def test_the_output_names_its_epoch_and_mode(tools):
    bench = navigating(tools)
    bench.step()
    output = bench.state["navigation"]
    assert output["epoch"] == bench.firmware.epoch
    assert output["mode"] == STRAPDOWN


def test_a_lost_epoch_is_bridged(tools):
    bench, whole = navigating(tools), navigating(tools)
    bench.step([])
    whole.step()
    for _ in range(200):
        bench.step()
        whole.step()
    assert bench.mode == STRAPDOWN
    assert bench.state["faults"]["bridged_epochs"] == 1
    assert bench.state["faults"]["consecutive_bridged"] == 0
    velocity = bench.state["navigation"]["velocity_n"] - whole.state["navigation"]["velocity_n"]
    assert np.abs(velocity).max() < 1e-6  # the counts of two epochs differ by one each
    assert bench.state["ins"]["velocity_n"][0] != whole.state["ins"]["velocity_n"][0]


@pytest.mark.parametrize("bridge_s", [0.0, 0.02, 0.1])
def test_a_gap_longer_than_is_bridged_loses_the_sensors(tools, bridge_s):
    bench = navigating(tools, bridge_s=bridge_s)
    for _ in range(round(bridge_s * 200)):
        bench.step([])
        assert bench.mode == STRAPDOWN
    bench.step([])
    assert bench.mode == Mode.FAULT
    assert bench.state["modes"]["fault"] == FirmwareFault.SENSORS_LOST


def test_gaps_with_a_sound_epoch_between_are_each_bridged(tools):
    bench = navigating(tools, bridge_s=0.02)
    for _ in range(50):
        for _ in range(4):
            bench.step([])
        bench.step()
    assert bench.mode == STRAPDOWN
    assert bench.state["faults"]["bridged_epochs"] == 200


@pytest.mark.parametrize("status", [1, 2, 3])
def test_a_saturated_sensor_is_left_out(tools, status):
    bench = navigating(tools)
    for _ in range(200):
        frames = bench.frames()
        frames[3] = tools.frame(
            "SENSOR_3",
            bench.epoch,
            status=status,
            gyro_dtheta=(1 << 23) - 1 if status & 1 else bench.counts(bench.epoch)[0][2],
            accelerometer_dv=(1 << 23) - 1 if status & 2 else bench.counts(bench.epoch)[1][2],
        )
        bench.step(frames)
    assert bench.mode == STRAPDOWN
    assert bench.state["faults"]["bridged_epochs"] == 0
    assert position_error(bench) < 1e-5


def test_nothing_is_bridged_before_there_is_a_hardware(tools):
    bench = tools.Bench()
    for _ in range(50):
        bench.step([])
    faults = bench.state["faults"]
    assert faults["bridged_epochs"] == faults["missing_frames"] == 0


def test_the_attitude_is_that_of_the_body_not_of_the_turned_sensors(tools):
    bench = navigating(tools)
    bench.axes_deg = [90.0, 30.0]
    bench.step()
    output = bench.state["navigation"]
    C_b_n = tools.body_to_navigation(output["roll"], output["pitch"], output["heading"])
    C_s_b = tools.rotation(0, math.radians(30)) @ tools.rotation(2, math.radians(90))
    assert C_b_n == pytest.approx(C_s_b.T, abs=1e-7)  # the sensors stood still


def test_a_self_aligned_attitude_ignores_the_one_given(tools):
    bench = navigating(tools, initial_attitude="self-aligned", alignment_s=1.0)
    bench.state["parameters"]["C_b_n"] = np.nan
    for _ in range(10):
        bench.step()
    assert bench.mode == STRAPDOWN


@pytest.mark.parametrize("rotating", [False, True])
def test_the_same_inputs_give_the_same_bytes(tools, rotating):
    def run():
        bench = navigating(tools, rotating, heading_deg=77.0)
        sent = hashlib.sha256()
        for k in range(100):
            for frame in bench.step([] if k == 50 else None):
                sent.update(frame.tobytes())
        return bench.ram.tobytes(), sent.hexdigest(), bench.firmware.trace.sha256()

    assert run() == run()


def test_a_copy_of_the_memory_goes_on_where_it_was_made(tools):
    bench = navigating(tools)
    kept, epoch = bench.ram.copy(), bench.epoch
    for _ in range(30):
        bench.step()
    after = bench.ram.tobytes()
    bench.ram[:] = kept
    bench.epoch = epoch
    for _ in range(30):
        bench.step()
    assert bench.ram.tobytes() == after
