"""A start by transfer over the bus: its latency, what is lost, and the ways to run it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rrins
from rrins.firmware_py.core.maths.earth import SEMI_MAJOR_AXIS
from rrins.firmware_py.core.records.estimator_records import ATTITUDE, Aid
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings

ARCSEC = math.radians(1 / 3600)
TURN_S = 258.0
"""Since the motion began: the car turns at 24.5 °/s."""


def scenario_of(starts_s=3.0, **changes):
    """Return a drive under way that is to start in a curve, `starts_s` after power-on."""
    motion = {"kind": "drive", "duration_s": 900, "begins_s": starts_s - TURN_S, "seed": 4}
    firmware = {"initial_attitude": "transferred", "alignment_s": 2, "height_channel": "free"}
    keys = {"sensors": "ideal", "gnss": None, "odometer": None, "estimator": {"enabled": False}}
    return rrins.load_scenario(
        "drive_begun",
        **{"duration_s": 6} | keys | {"motion": motion, "firmware": firmware} | changes,
    )


def written(scenario, folder):
    path = folder / "transfer.toml"
    path.write_text(scenario.toml(), encoding="utf-8")
    return path


def turns_arcsec(errors):
    return np.array([errors.turn_east_arcsec, errors.turn_north_arcsec, errors.turn_up_arcsec])


@pytest.mark.parametrize("latency_s", [0.0, 0.5, 0.95])
def test_a_latency_costs_nothing_in_a_curve(latency_s):
    scenario = scenario_of(master={"latency_s": latency_s})
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    track = run.run(scenario.navigation_epoch + 40)
    first, true = track.navigation[0], track.truth[0]
    assert first["epoch"] <= scenario.navigation_epoch + 10
    off = np.abs(turns_arcsec(compare(track.navigation, track.truth, scenario.rate_hz))[:, 0]).max()
    velocity = np.abs(first["velocity_n"] - true["velocity_n"]).max()
    north, east = (
        (float(first[name]) - float(true[name])) * SEMI_MAJOR_AXIS
        for name in ("latitude", "longitude")
    )
    age_s = float(run.ram[0].master.age_epochs) / scenario.rate_hz
    print(f"\nafter {age_s:.2f} s: {off:.3f}″, {velocity:.1e} m/s, {north:.1e} m, {east:.1e} m")
    assert off < 0.1
    assert velocity < 1e-3
    assert max(abs(north), abs(east), abs(first["height"] - true["height"])) < 2e-3


def test_lost_and_harmed_frames_are_never_used_and_the_alignment_waits(run, tmp_path):
    faults = [
        {"kind": "corrupt", "message": "MASTER_HEADING", "at_s": 0, "for_s": 3.2},
        {"kind": "drop", "message": "MASTER_LEVEL", "at_s": 3.2, "for_s": 2.5},
    ]
    scenario = scenario_of(starts_s=6.1, faults=faults)
    summary = run("simulate", written(scenario, tmp_path))
    waited = round((6.1 - 3.0) * scenario.rate_hz)
    assert summary["firmware"]["epochs_navigated"] == pytest.approx(
        6 * scenario.rate_hz - waited, abs=10
    )
    assert summary["firmware"]["faults"]["crc_errors"] == 4
    assert max(summary["max_abs_position_error_m"].values()) < 0.01
    assert max(summary["max_abs_velocity_error_mps"].values()) < 2e-3


def test_in_an_outage_of_the_master_the_alignment_waits(tmp_path):
    scenario = scenario_of(master={"outages": [{"at_s": 0, "for_s": 4.5}]})
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    track = run.run(scenario.epochs)
    epoch = int(track.navigation["epoch"][0])
    assert epoch / scenario.rate_hz == pytest.approx(5.1, abs=0.05)  # valid at 5 s


def test_with_frames_and_without_it_is_the_same():
    errors = {"heading_error_sigma_arcsec": 600, "velocity_error_sigma_mps": 0.2}
    scenario = scenario_of(
        sensors="tactical", gnss={}, estimator={"enabled": True}, master={"latency_s": 0.4}
    ).varied(firmware=errors | scenario_of().firmware.model_dump(exclude_unset=True))
    one, other = (way(scenario).firmware for way in (run_direct, run_without_frames))
    assert one["navigation_sha256"] == other["navigation_sha256"]
    assert one["estimator"] == other["estimator"]
    assert one["epochs_navigated"] >= 6 * scenario.rate_hz - 10


def test_a_fine_alignment_after_it_finds_that_the_vehicle_stands():
    errors = {"level": 300.0, "heading": 1800.0}  # ″
    seconds = 400
    scenario = rrins.load_scenario(
        "rimu_rotating_aligned",
        duration_s=1,
        seed=3,
        sensors="prototype",
        body={"roll_deg": 3, "pitch_deg": -4, "heading_deg": 20},
        estimator={"enabled": True, "fine_alignment_s": seconds},
        master={"latency_s": 0.3},
        firmware={
            "initial_attitude": "transferred",
            "alignment_s": 5,
            "scheme": "16-position",
            "turn_rate_dps": 2,
            "stand_s": 10,
            "velocity_error_sigma_mps": 0.1,
            **{f"{name}_error_sigma_arcsec": sigma for name, sigma in errors.items()},
        },
    )
    run = FastRun.of(firmware_settings(scenario), hardware_settings(scenario))
    track = run.run(scenario.epochs)
    estimator = run.ram[0].estimator
    begun_s = track.navigation["epoch"][0] / scenario.rate_hz
    assert begun_s == pytest.approx(5 + 1 + seconds, abs=0.1)  # 1 s: the next valid one
    assert estimator.sources[int(Aid.ZERO_VELOCITY)].used > 1.9 * seconds  # east and north
    assert not estimator.standing  # it ends with the mode
    sigma = np.array(estimator.sigma[ATTITUDE : ATTITUDE + 3]) / ARCSEC
    off = turns_arcsec(compare(track.navigation, track.truth, scenario.rate_hz))[:, 0]
    print(f"\nafter {seconds} s: {off.round(1)}″, sigma {sigma.round(1)}″")
    assert sigma[:2].max() < 0.02 * errors["level"]
    assert sigma[2] < 0.5 * errors["heading"]
    assert np.all(np.abs(off) < 3 * sigma)


def test_a_master_is_for_a_start_by_transfer():
    with pytest.raises(rrins.ScenarioError, match="master: needs"):
        rrins.load_scenario("drive_begun", master={})
    with pytest.raises(rrins.ScenarioError, match=r"master\.latency_s: 0\.5 s"):
        scenario_of(master={"rate_hz": 2, "latency_s": 0.5})
