"""A given attitude that is off: for the firmware only, and told for the sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from rrins.host_tools.runs.set_up import given_attitude
from rrins.host_tools.runs.set_up.given_attitude import error_arcsec
from rrins.host_tools.runs.set_up.settings import first_pose, given_pose, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario


def scenario_of(duration_s=5, **tables):
    return Scenario.model_validate({"duration_s": duration_s} | tables)


def firmware(**keys):
    return {"firmware": keys}


def largest_m(errors):
    return float(np.hypot(errors.position_east_m, errors.position_north_m).max())


def test_the_firmware_is_given_the_error_and_the_truth_is_not():
    body = {"roll_deg": 1.0, "pitch_deg": -2.0, "heading_deg": 30.0}
    keys = {"roll_error_arcsec": 36, "pitch_error_arcsec": -72, "heading_error_arcsec": 360}
    off = scenario_of(body=body, **firmware(**keys))
    pose = given_pose(off)
    assert (pose.roll_deg, pose.pitch_deg) == pytest.approx((1.01, -2.02))
    assert pose.heading_deg == pytest.approx(30.1)
    right = scenario_of(body=body)
    assert first_pose(off) == first_pose(right) == given_pose(right)
    assert hardware_settings(off) == hardware_settings(right)


def test_what_is_drawn_depends_on_the_seed_and_has_its_deviation():
    keys = {"level_error_sigma_arcsec": 10, "heading_error_sigma_arcsec": 200}
    poses = [given_pose(scenario_of(seed=seed, **firmware(**keys))) for seed in range(400)]
    drawn = 3600 * np.array([[p.roll_deg, p.pitch_deg, p.heading_deg] for p in poses])
    assert drawn.std(axis=0) == pytest.approx([10, 10, 200], rel=0.12)
    assert np.abs(drawn.mean(axis=0) / [10, 10, 200]).max() < 4 / math.sqrt(400)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < 0.2
    assert poses[7] == given_pose(scenario_of(seed=7, **firmware(**keys)))


def test_a_pitch_beyond_the_vertical_is_the_same_attitude_over_the_top():
    body = {"pitch_deg": 90.0, "roll_deg": 10.0}
    pose = given_pose(scenario_of(body=body, **firmware(pitch_error_arcsec=3600)))
    assert pose.pitch_deg == pytest.approx(89)
    assert abs(pose.heading_deg) == pytest.approx(180)
    assert pose.roll_deg == pytest.approx(-170)


def test_errors_of_a_self_aligned_attitude_are_refused():
    for keys in ({"heading_error_arcsec": 1}, {"level_error_sigma_arcsec": 1}):
        with pytest.raises(
            ValidationError, match='for initial_attitude = "given" or "transferred" only'
        ):
            scenario_of(**firmware(initial_attitude="self-aligned", **keys))


def test_navigation_begins_with_the_error(fly):
    keys = {"pitch_error_arcsec": 30, "heading_error_arcsec": -90}
    _, errors = fly(scenario_of(20, mode="strapdown", **firmware(**keys)))
    assert 3600 * errors.pitch_deg[0] == pytest.approx(30, abs=0.1)
    assert 3600 * errors.heading_deg[0] == pytest.approx(-90, abs=0.1)
    # Pitched up, the vehicle seems to be pushed: g δ t² / 2 to the south.
    tilt, time_s = 30 / 3600 * math.pi / 180, errors.time_s[-1]
    assert errors.position_north_m[-1] == pytest.approx(-9.80 * tilt * time_s**2 / 2, rel=0.01)


@pytest.mark.parametrize(
    ("tables", "expected"),
    [
        ({"turntable": {"non_orthogonality_arcsec": 60}}, (0, -60, 0)),
        ({"turntable": {"wobble_arcsec": 20}}, (-20, 0, 0)),
        ({"turntable": {"inner": {"encoder_offset_deg": 0.01}}}, (0, 0, 36)),
        ({"turntable": {"outer": {"encoder_offset_deg": -0.01}}}, (-36, 0, 0)),
        (firmware(roll_error_arcsec=5, pitch_error_arcsec=7), (7, 5, 0)),
        (firmware(heading_error_arcsec=9), (0, 0, -9)),
        (
            {"turntable": {"non_orthogonality_arcsec": 60}, "body": {"heading_deg": 90}},
            (-60, 0, 0),
        ),
    ],
)
def test_the_error_of_the_sensors_is_that_of_all_causes(tables, expected):
    error = error_arcsec(scenario_of(**tables))
    assert (error["east"], error["north"], error["up"]) == pytest.approx(expected, abs=0.01)


def test_there_is_none_where_nothing_is_off():
    assert error_arcsec(scenario_of()) is None
    tilted = {"turntable": {"non_orthogonality_arcsec": 60}}
    assert error_arcsec(scenario_of(**tilted, **firmware(initial_attitude="self-aligned"))) is None


@pytest.mark.slow
def test_a_tilted_axis_costs_a_given_attitude_kilometres_and_a_self_aligned_one_nothing(fly):
    tilted = {"turntable": {"non_orthogonality_arcsec": 60}}
    _, given = fly(scenario_of(1600, **tilted))
    own = firmware(initial_attitude="self-aligned", alignment_s=60)
    _, self_aligned = fly(scenario_of(1600, **tilted, **own))
    assert largest_m(given) == pytest.approx(2600, rel=0.01)
    assert largest_m(self_aligned) < 0.05


def test_the_summary_tells_it_only_where_it_is_not_zero(run, tmp_path):
    (tmp_path / "off.toml").write_text(
        "duration_s = 1\n[turntable]\nnon_orthogonality_arcsec = 60\n"
        "[firmware]\nheading_error_arcsec = 120\n"
    )
    error = run("simulate", "off.toml")["given_attitude_error_arcsec"]
    assert error == pytest.approx({"east": 0, "north": -60, "up": -120}, abs=0.1)
    assert given_attitude.words(error) == (
        "given attitude, for the sensors: level off by 60.0″, heading by 120″"
    )
