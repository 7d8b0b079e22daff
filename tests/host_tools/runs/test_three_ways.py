"""One scenario, one seed: the same navigation output, bit for bit, however it is run."""

from __future__ import annotations

import json
import threading

import pytest

from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.loop import run_lockstep as run_firmware
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

SENSORS_LOST = 8  # exit status

SCENARIO = """
title = "Everything that can differ: noise, clock error, an own scheme"
duration_s = 4
seed = 7
[site]
latitude_deg = -33
longitude_deg = 151
[gyros]
bias_dph = [0.1, 0.2, 0.3, 0.4]
angle_random_walk_deg_per_sqrt_h = 0.001
[accelerometers]
white_noise_ug_per_sqrt_hz = 20
[turntable]
inner = { acceleration_limit_dps2 = 100 }
outer = { acceleration_limit_dps2 = 100 }
[firmware]
turn_rate_dps = 30
stand_s = 0.5
clock_error_ppm = 150
alignment_s = 0.5
scheme = [{axis = "inner", angle_deg = 20}, {axis = "outer", angle_deg = -20}]
"""


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


def test_lockstep_paced_lockstep_and_direct_are_the_same(run, scenario):
    ways = {
        "direct": run("simulate", scenario),
        "lockstep": run("rehearse", scenario),
        "at four times real time": run("rehearse", scenario, "--speed", 4),
    }
    assert {name: way["epochs"] for name, way in ways.items()} == dict.fromkeys(ways, 1102)
    assert len({way["navigation_sha256"] for way in ways.values()}) == 1
    assert all(way["frames_lost"] == 0 for way in ways.values())


FAULTS = """
[[faults]]
kind = "drop"
probability = 0.1
at_s = 1.5
for_s = 0.7
[[faults]]
kind = "corrupt"
probability = 0.2
at_s = 2.5
for_s = 0.5
[[faults]]
kind = "silence"
message = "SENSOR_2"
at_s = 3
for_s = 0.2
"""


def test_faults_on_the_wire_are_the_same_in_lockstep_paced_and_directly(run, scenario):
    scenario.write_text(SCENARIO + FAULTS, encoding="utf-8")
    ways = [
        run("simulate", scenario),
        run("rehearse", scenario),
        run("rehearse", scenario, "--speed", 4),
    ]
    assert len({way["navigation_sha256"] for way in ways}) == 1
    first, *others = [[way[side]["faults"] for side in ("firmware", "hardware")] for way in ways]
    assert first[0]["missing_frames"] > 100
    assert first[1]["missing_commands"] > 10
    assert others == [first, first]


def test_real_time_is_the_same_as_long_as_no_deadline_was_missed(run, start, scenario):
    reference = run("simulate", scenario)
    command = start("rehearse", scenario, "--speed", 1, "--json")
    status, out = command.finish()
    summary = json.loads(out)
    if status == SENSORS_LOST:  # the machine stood still for longer than the firmware waits
        assert summary["overruns"] > 0
        return
    assert status == 0, command.said
    lateness = summary["firmware"]["lateness_us"]
    assert lateness["epochs"] >= summary["epochs"] - 2
    # The loop does not drift: at least as many seconds as were simulated.
    assert summary["wall_s"] > summary["epochs"] / 200 - 0.5
    if summary["overruns"] == summary["frames_lost"] == 0:
        assert summary["navigation_sha256"] == reference["navigation_sha256"]


def test_frame_by_frame_over_any_python_can_interface_is_the_same():
    scenario = Scenario.model_validate({"duration_s": 3, "mode": "rotating"})
    reference = run_direct(scenario).firmware
    address = Address("virtual", "frame-by-frame")
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario))
    firmware_port = MessagePort(address, "firmware")
    hardware_port = MessagePort(address, "hardware")

    def navigate():
        firmware_port.meet()
        run_firmware(firmware, firmware_port)

    thread = threading.Thread(target=navigate)
    thread.start()
    hardware_port.meet()
    run_hardware(hardware, hardware_port, scenario.epochs + 1)
    thread.join()
    firmware_port.close()
    hardware_port.close()
    assert firmware.trace.sha256() == reference["navigation_sha256"]
    assert firmware.frames_received == hardware.frames_sent
    assert hardware.frames_received == firmware.frames_sent


def test_another_seed_is_another_run(run, scenario):
    digests = {run("simulate", scenario, "--seed", seed)["navigation_sha256"] for seed in (1, 2)}
    assert len(digests) == 2
