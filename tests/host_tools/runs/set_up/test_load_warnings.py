"""Settings that may surprise give a warning when the scenario is loaded."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from rrins import simulate
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.runs.set_up.load_warnings import azimuth_error, warnings_of
from rrins.host_tools.scenario.scenario import Scenario, load, names


def scenario(**tables):
    return Scenario.model_validate({"duration_s": 10} | tables)


def self_aligned(alignment_s, **tables):
    firmware = {"initial_attitude": "self-aligned", "alignment_s": alignment_s}
    return scenario(firmware=firmware, **tables)


@pytest.mark.parametrize("name", names())
def test_no_built_in_scenario_has_any(name):
    assert warnings_of(load(name)) == []


def test_frames_that_hold_less_than_the_sensors_measure():
    assert warnings_of(scenario(rate_hz=200)) == []
    (line,) = warnings_of(scenario(rate_hz=50))
    assert "at rate_hz = 50 a frame holds 96.1°/s of gyros.range_dps = 300" in line
    assert "5.35 g of accelerometers.range_g = 20" in line
    (line,) = warnings_of(scenario(rate_hz=100, accelerometers={"range_g": 10}))
    assert "192°/s of gyros.range_dps = 300" in line
    assert "range_g" not in line
    ranges = {"gyros": {"range_dps": 96}, "accelerometers": {"range_g": 5}}
    assert warnings_of(scenario(rate_hz=50, **ranges)) == []


def test_a_vehicle_that_turns_faster_than_the_gyros_measure():
    tables = {"motion": {"kind": "drive"}, "firmware": {"height_channel": "free"}}
    assert warnings_of(scenario(gyros={"range_dps": 40}, **tables)) == []
    (line,) = warnings_of(scenario(gyros={"range_dps": 20}, **tables))
    assert "the vehicle turns at up to 26.1°/s and the table at 2°/s" in line
    assert "measure up to 20.0°/s at rate_hz = 200" in line


@pytest.mark.parametrize(
    ("name", "bitrate", "rate_hz", "frames"),
    [
        ("rimu_rotating", 500_000, 200, None),
        ("rimu_rotating", 250_000, 200, 8),
        ("drive_aided", 1_000_000, 200, None),
        ("drive_aided", 500_000, 200, 15),
        ("drive_aided", 500_000, 100, None),
    ],
)
def test_a_wire_too_slow_for_what_an_epoch_sends_is_told_and_loses_frames(
    name, bitrate, rate_hz, frames
):
    ranges = {"gyros": {"range_dps": 150}, "accelerometers": {"range_g": 10}}
    wanted = load(name, duration_s=3).varied(rate_hz=rate_hz, bus={"bitrate": bitrate}, **ranges)
    lines = warnings_of(wanted)
    faults = simulate(wanted).summary["firmware"]["faults"]
    assert (faults["counter_errors"] > 0) == (frames is not None)
    assert len(lines) == (frames is not None)
    for line in lines:
        assert f"bus.bitrate = {bitrate} the hardware's {frames} frames of one epoch take" in line


def test_a_self_alignment_that_is_too_short():
    assert warnings_of(self_aligned(60)) == []
    (line,) = warnings_of(self_aligned(0.001, duration_s=6000))
    assert "self-alignment of 0.001 s" in line
    assert "azimuth error of 0.29° (1 σ), which becomes about 11 km over 6000 s" in line
    noisy = {"angle_random_walk_deg_per_sqrt_h": 0.01}
    (line,) = warnings_of(self_aligned(60, gyros=noisy))
    assert "azimuth error of 0.34°" in line
    assert warnings_of(scenario(gyros=noisy, firmware={"alignment_s": 0.001})) == []


def test_the_fine_alignment_goes_on_with_the_heading():
    noisy = {"angle_random_walk_deg_per_sqrt_h": 0.01}
    fine = {"enabled": True, "fine_alignment_s": 4000}
    assert warnings_of(self_aligned(1, gyros=noisy, estimator=fine)) == []
    (line,) = warnings_of(self_aligned(1, gyros=noisy, estimator=fine | {"fine_alignment_s": 59}))
    assert "self-alignment of 1 s and fine alignment of 59 s: " in line
    assert "azimuth error of 0.34°" in line
    assert line.endswith("a longer estimator.fine_alignment_s helps")
    fixes = {"gnss": {}, "estimator": {"enabled": True}}
    assert warnings_of(self_aligned(1, gyros=noisy, **fixes)) == []


@pytest.mark.parametrize(
    ("noise", "alignment_s"), [(0.001, 2), (0.0, 0.001), (0.0, 0.02)], ids=["noise", "1", "20 ms"]
)
def test_the_expected_azimuth_error_is_that_of_runs(fly, noise, alignment_s):
    found = []
    for k in range(24):
        one = self_aligned(
            alignment_s,
            duration_s=0.2,
            seed=k,
            mode="strapdown",
            body={"heading_deg": 15 * k},
            gyros={"angle_random_walk_deg_per_sqrt_h": noise},
        )
        found.append(math.radians(fly(one)[1].heading_deg[0]))
    rms = math.sqrt(np.mean(np.square(found)))
    assert rms == pytest.approx(azimuth_error(one), rel=0.35)


def test_warnings_are_told_on_standard_error_and_in_the_summary(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text("duration_s = 1\nrate_hz = 50\n")
    result = CliRunner().invoke(rrins, ["simulate", "own.toml", "--json"])
    assert result.exit_code == 0, result.output
    (line,) = json.loads(result.stdout)["warnings"]
    assert f"rrins: warning: {line}\n" in result.stderr
