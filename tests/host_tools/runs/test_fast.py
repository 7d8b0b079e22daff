"""The fast path navigates bit for bit as the run with frames does."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from rrins.firmware_py.loop import Firmware
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.exchange import exchange_epoch
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.samples import NAVIGATION_SAMPLES, TRUTH_SAMPLES, read_samples
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

QUICK_TABLE = {
    "turntable": {axis: {"acceleration_limit_dps2": 200, "rate_limit_dps": 60}
                  for axis in ("inner", "outer")},
    "firmware": {"turn_rate_dps": 45, "stand_s": 1, "alignment_s": 0.5},
}  # fmt: skip
NOISY = {
    "gyros": {
        "bias_dph": 0.1,
        "angle_random_walk_deg_per_sqrt_h": 0.01,
        "bias_instability_dph": 0.3,
        "rate_random_walk_dph_per_sqrt_h": 0.5,
        "bias_temperature_dph_per_k": 0.1,
    },
    "accelerometers": {"white_noise_ug_per_sqrt_hz": 50, "bias_instability_ug": 20},
    "thermal": {"warm_up_k": 20, "time_constant_s": 10},
}
CROOKED = {
    "turntable": {
        "inner": {"jerk_limit_dps3": 200, "stiction_arcsec": 60, "run_out_um": 300,
                  "acceleration_limit_dps2": 100, "rate_limit_dps": 60},
        "outer": {"ripple_arcsec": 30, "encoder_bits": 16, "encoder_offset_deg": 0.001,
                  "acceleration_limit_dps2": 100, "rate_limit_dps": 60},
        "non_orthogonality_arcsec": 20,
        "wobble_arcsec": 5,
    },
}  # fmt: skip
MOVING = {
    "motion": {"kind": "drive", "duration_s": 60},
    "altimeter": {"bias_m": 3, "noise_m": 0.5},
    "gnss": {"rate_hz": 4, "latency_s": 0.2, "position_correlated_noise_m": 2,
             "outages": [{"at_s": 8, "for_s": 3}]},
    "odometer": {"latency_s": 0.03, "scale_error_ppm": 2000, "mounting_heading_deg": 1,
                 "lever_arm_m": [0.5, -1, -0.3]},
    "zero_velocity": [{"at_s": 2, "for_s": 3}, {"at_s": 14, "for_s": 100}],
    "firmware": {"height_channel": "damped", "alignment_s": 0.5},
    "sensors": "tactical",
}  # fmt: skip
FAULTS = {
    "faults": [
        {"kind": "axis_runaway", "axis": "outer", "at_s": 9, "for_s": 1},
        {"kind": "axis_stall", "axis": "inner", "at_s": 4, "for_s": 0.1},
        {"kind": "encoder_offset", "axis": "inner", "offset_deg": 0.1, "at_s": 5, "for_s": 2},
        {"kind": "gyro_absent", "sensor": 2, "at_s": 3, "for_s": 3},
        {"kind": "gyro_noise", "sensor": 1, "at_s": 5},
        {"kind": "accelerometer_stuck", "sensor": 4, "at_s": 8, "for_s": 0.5},
        {"kind": "gyro_absent", "at_s": 7, "for_s": 0.05},
    ]
}
EIGHT = {
    "rimu": {
        "geometry": "custom",
        "gyro_axes_deg": [[0, 0], *([60, 360 / 7 * k] for k in range(7))],
        "accelerometer_axes_deg": [[0, 0], *([60, 360 / 5 * k] for k in range(5))],
    },
    "gyros": {"range_dps": 40, "resolution_arcsec": 0.01, "latency_ms": 7.7, "bandwidth_hz": 40},
}
OPERATOR = {
    "operator": [
        {"at_s": 1, "request": "NAVIGATE_STRAPDOWN"},
        {"at_s": 4, "request": "NAVIGATE_ROTATING"},
        {"at_s": 8, "request": "STANDBY"},
        {"at_s": 9, "request": "NAVIGATE_ROTATING"},
    ]
}
SCENARIOS = {
    "noise and drift": NOISY | QUICK_TABLE,
    "a crooked table": CROOKED | {"firmware": QUICK_TABLE["firmware"]},
    "motion with altimeter": MOVING,
    "sway, free height": {"motion": {"kind": "sway"}, "firmware": {"height_channel": "free"}},
    "faults of the hardware": FAULTS | QUICK_TABLE,
    "eight gyros, six accelerometers": EIGHT | QUICK_TABLE,
    "dodecahedron, self-aligned, 100 Hz": {
        "rimu": {"geometry": "dodecahedron"},
        "sensors": "navigation",
        "rate_hz": 100,
        "firmware": {"initial_attitude": "self-aligned", "alignment_s": 5},
    },
    "400 Hz, southern, clock error": {
        "rate_hz": 400,
        "site": {"latitude_deg": -33, "longitude_deg": -179.9999},
        "firmware": {"clock_error_ppm": 300},
    },
    "requests of the operator": OPERATOR | QUICK_TABLE,
    "isolated heading": MOVING
    | OPERATOR
    | QUICK_TABLE
    | {"firmware": MOVING["firmware"] | QUICK_TABLE["firmware"] | {"isolate_heading": True}},
}


def scenario_of(tables):
    return Scenario.model_validate({"duration_s": 15, "seed": 5} | tables)


@pytest.mark.parametrize("name", SCENARIOS)
def test_without_frames_it_navigates_to_the_same_bytes(name, tmp_path):
    scenario = scenario_of(SCENARIOS[name])
    rows = {}
    summaries = {}
    for run in (run_direct, run_without_frames):
        folder = tmp_path / run.__name__
        folder.mkdir()
        outcome = run(scenario, folder)
        summaries[run] = outcome.firmware
        assert outcome.hardware["epochs"] == scenario.epochs + 1
        rows[run] = [(folder / file).read_bytes() for file in (NAVIGATION_SAMPLES, TRUTH_SAMPLES)]
    with_frames, without = summaries[run_direct], summaries[run_without_frames]
    for key in (
        "navigation_sha256",
        "epochs_navigated",
        "mode",
        "fault",
        "scheme_cycles",
        "axes_not_following",
    ):
        assert with_frames[key] == without[key], key
    assert with_frames["faults"]["bridged_epochs"] == without["faults"]["bridged_epochs"]
    assert rows[run_direct][0] == rows[run_without_frames][0]
    assert with_frames["epochs_navigated"] > 14 * scenario.rate_hz - 200


def test_without_frames_the_firmware_takes_the_same_fixes_and_distances():
    scenario = scenario_of(MOVING)
    epochs = scenario.epochs
    fast = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    fast.run(epochs)
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario))
    count = 0
    for epoch in range(epochs):
        count = exchange_epoch(hardware, firmware, epoch, count, 0.0)
    gnss = firmware.ram[0]["gnss"]
    assert gnss["fixes"] == epochs // 50 - 13  # of the outage
    assert (gnss["losses"], gnss["available"]) == (1, True)
    for name in set(gnss.dtype.names) - {"word"}:  # which a frame protects
        assert gnss[name].tobytes() == fast.ram[0]["gnss"][name].tobytes(), name
    zero = firmware.ram[0]["zero_velocity"]
    assert zero["standing"]
    for name in set(zero.dtype.names) - {"counter"}:
        assert zero[name].tobytes() == fast.ram[0]["zero_velocity"][name].tobytes(), name
    odometer = firmware.ram[0]["odometer"]
    assert odometer["measurements"] == (epochs - 1 - 6) // 20
    assert odometer["travelled"] > 10
    for name in set(odometer.dtype.names) - {"word"}:
        assert odometer[name].tobytes() == fast.ram[0]["odometer"][name].tobytes(), name


def test_calibrated_it_navigates_to_the_same_bytes(tmp_path):
    path = tmp_path / "cal.toml"
    path.write_text(
        "[gyros]\nbias_dph = [0.1, 0.2, 0.3, 0.4]\nscale_error_ppm = 50\n"
        "[accelerometers]\nasymmetric_scale_error_ppm = 30\ninstallation_u_arcsec = 10\n"
    )
    firmware = QUICK_TABLE["firmware"] | {"calibration": str(path)}
    scenario = scenario_of(NOISY | QUICK_TABLE | {"firmware": firmware})
    digests = {
        run(scenario).firmware["navigation_sha256"] for run in (run_direct, run_without_frames)
    }
    assert len(digests) == 1
    assert digests != {
        run_without_frames(scenario_of(NOISY | QUICK_TABLE)).firmware["navigation_sha256"]
    }


def test_the_logs_agree_with_the_truth_of_the_same_epochs(tmp_path):
    from rrins.firmware_py.core.records.memory import NavigationOutput
    from rrins.host_tools.hardware.memory import Truth

    scenario = scenario_of(MOVING)
    run_without_frames(scenario, tmp_path)
    navigation = read_samples(tmp_path / NAVIGATION_SAMPLES, NavigationOutput)
    truth = read_samples(tmp_path / TRUTH_SAMPLES, Truth)
    assert np.isin(navigation["epoch"], truth["epoch"]).all()
    assert (navigation["epoch"] % 20 == 0).all()


def test_in_parts_it_is_the_same_run():
    scenario = scenario_of(NOISY | MOVING)
    parts = [(1, 2999, 500), (3500,)]
    outcomes = []
    for epochs in parts:
        run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
        tracks = [run.run(count) for count in epochs]
        outcomes.append(b"".join(track.navigation.tobytes() for track in tracks))
    assert outcomes[0] == outcomes[1]


def test_sound_sensors_are_compared_as_in_the_computer():
    scenario = scenario_of({"sensors": "prototype", "redundancy": {"enabled": True}})
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    run.run(2000)
    redundancy = run.ram[0].redundancy
    assert (redundancy.gyros.excluded, redundancy.accelerometers.excluded) == (0, 0)
    assert (redundancy.gyros.alarm_epoch, redundancy.accelerometers.alarm_epoch) == (0, 0)


def test_it_stops_when_told_and_reports_on_the_way():
    scenario = scenario_of({"duration_s": 200})
    said = []
    outcome = run_without_frames(
        scenario, on_progress=lambda f, h: said.append((f, h)), should_stop=lambda: len(said) == 3
    )
    firmware, hardware = outcome.firmware, outcome.hardware
    assert len(said) == 3
    assert hardware["epochs"] == 3 * 20 * 200
    assert said[-1][1]["epoch"] == said[-1][0]["epoch"] == 3 * 20 * 200 - 1
    assert firmware["mode"] == "NAVIGATION_ROTATING"


PLAIN = """
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.scenario.scenario import Scenario
alike = {
    "mode": "rotating", "duration_s": 1, "rate_hz": 50, "navigate_at_s": 0.1,
    "sensors": "tactical", "gyros": {"latency_ms": 3, "resolution_arcsec": 0.01},
}
moving = Scenario.model_validate(alike | {
    "motion": {"kind": "drive", "duration_s": 30}, "altimeter": {"noise_m": 1},
    "thermal": {"warm_up_k": 5},
    "turntable": {"wobble_arcsec": 3, "inner": {"stiction_arcsec": 1, "jerk_limit_dps3": 50,
                  "ripple_arcsec": 2, "run_out_um": 10}},
    "faults": [{"kind": "gyro_noise", "sensor": 1, "at_s": 1.8},
               {"kind": "axis_stall", "axis": "inner", "at_s": 1.9, "for_s": 0.1}],
    "firmware": {"alignment_s": 0.1, "height_channel": "damped"},
})
wired = Scenario.model_validate(alike | {
    "body": {"roll_deg": 3, "pitch_deg": 2, "heading_deg": 200}, "bus": {"bitrate": 500000},
    "faults": [{"kind": "corrupt", "probability": 0.05, "at_s": 1},
               {"kind": "duplicate", "probability": 0.1, "at_s": 1}],
    "firmware": {"alignment_s": 0.1, "initial_attitude": "self-aligned"},
})
ways = run_without_frames(moving).firmware, run_direct(wired).firmware
said = [[one["epochs_navigated"], one["navigation_sha256"], one["faults"]] for one in ways]
"""


@pytest.mark.slow
def test_plain_python_runs_to_the_same_bytes():
    """Without frames, and with frames on a wire that destroys some."""
    scope = {}
    exec(PLAIN, scope)
    compiled = scope["said"]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    code = f"{PLAIN}import json; print(json.dumps(said))"
    arguments = [sys.executable, "-W", "ignore", "-c", code]
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr.splitlines()[-1]
    assert json.loads(done.stdout) == compiled
    assert all(epochs > 40 for epochs, *_ in compiled)
    assert compiled[1][2]["crc_errors"] + compiled[1][2]["counter_errors"] > 0
