"""The whole step: gaps bridged or not, sensors left out, the same bytes every time."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys

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


@pytest.mark.parametrize("initial_attitude", ["given", "self-aligned"])
def test_a_standing_vehicle_stays_where_it_is(tools, initial_attitude):
    bench = navigating(
        tools,
        roll_deg=5.0,
        pitch_deg=-3.0,
        heading_deg=200.0,
        alignment_s=2.0,
        initial_attitude=initial_attitude,
    )
    for _ in range(2000):
        bench.step()
    output = bench.state["navigation"]
    # What counting leaves: a count is 4e-9 rad or 1.25e-7 m/s; aligned by 400 epochs of counts.
    limit = 1e-5 if initial_attitude == "given" else 1e-3
    assert position_error(bench) < limit
    assert np.abs(output["velocity_n"]).max() < limit
    angles = np.degrees([output["roll"], output["pitch"], output["heading"]])
    assert angles[:2] == pytest.approx([5.0, -3.0], abs=1e-4)
    assert angles[2] == pytest.approx(200.0, abs=1e-4 if initial_attitude == "given" else 0.1)


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


def test_two_dead_sensors_of_four_are_one_too_many(tools):
    bench = navigating(tools)
    for _ in range(5):
        bench.step(bench.frames()[:1] + bench.frames()[3:])
    assert bench.mode == Mode.FAULT
    assert bench.state["modes"]["fault"] == FirmwareFault.SENSORS_LOST


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


BOTH_SIDES = """
import sys
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario
scenario = Scenario.model_validate({
    "mode": "rotating", "duration_s": 1, "rate_hz": 50, "navigate_at_s": 0.1,
    "body": {"roll_deg": 3, "pitch_deg": 2, "heading_deg": 200},
    "gyros": {"bias_dph": 0.1, "scale_error_ppm": 50, "angle_random_walk_deg_per_sqrt_h": 0.01},
    "accelerometers": {"bias_ug": 50, "white_noise_ug_per_sqrt_hz": 20},
    "firmware": {"alignment_s": 0.1, "initial_attitude": sys.argv[1], "height_channel": "damped"},
})
firmware, hardware = Firmware(firmware_settings(scenario)), Hardware(hardware_settings(scenario))
count = 0
for epoch in range(75):
    sent = hardware.step(firmware.outbox, count)
    count, _ = firmware.step(hardware.outbox, 0, sent, epoch * firmware.period_ns)
print(firmware.trace.epochs, firmware.trace.sha256(), firmware.mode.name)
"""


def run_both_sides(compiled, initial_attitude):
    environment = os.environ | {"NUMBA_DISABLE_JIT": "0" if compiled else "1"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    arguments = [sys.executable, "-W", "ignore", "-c", BOTH_SIDES, initial_attitude]
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr.splitlines()[-1]
    return done.stdout.split()


@pytest.mark.slow
@pytest.mark.parametrize("initial_attitude", ["given", "self-aligned"])
def test_plain_python_navigates_to_the_same_bytes(initial_attitude):
    compiled = run_both_sides(True, initial_attitude)
    assert int(compiled[0]) > 40
    assert compiled[2] == "NAVIGATION_ROTATING"
    assert compiled == run_both_sides(False, initial_attitude)
