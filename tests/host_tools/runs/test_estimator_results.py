"""Estimator's results of a run: seconds, summary, sensors against the truth, picture."""

from __future__ import annotations

import csv

import numpy as np
import pytest

import rrins
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.runs.results.estimates import estimator_lines
from rrins.host_tools.runs.results.estimator_plot import draw_estimates

RATE_HZ, FINE_S, DURATION_S = 50, 200, 60


@pytest.fixture(scope="module")
def runs():
    """The same run in one loop, and by frames."""
    changes = {"duration_s": DURATION_S, "rate_hz": RATE_HZ}
    changes |= {"estimator": {"enabled": True, "fine_alignment_s": FINE_S}}
    name = "rimu_rotating_aligned"
    return [rrins.simulate(name, frames=way, **changes)._result for way in (False, True)]


def test_every_second_is_there_whichever_way_it_was_run(runs):
    fast, frames = (run.seconds.estimates for run in runs)
    assert len(fast) >= FINE_S + DURATION_S - 2
    assert set(np.diff(fast["epoch"])) == {RATE_HZ}
    assert fast.tobytes() == frames.tobytes()
    assert runs[0].summary["estimator"] == runs[1].summary["estimator"]


def test_the_summary_says_what_aided(runs):
    found = runs[0].summary["estimator"]
    assert found["aided_by"] == ["zero_velocity", "known_position"]
    assert found["fine_alignment_s"] == FINE_S
    used = found["sources"]["zero_velocity"]["used"]
    assert 2 * (FINE_S - 2) <= used <= 2 * FINE_S  # the height is held
    assert found["sources"]["zero_velocity"]["rejected"] == 0
    assert found["sigma"]["position_m"][2] == 0
    lines = list(estimator_lines(runs[0].summary["firmware"]))
    assert f"aided by zero velocity: {used} used, 0 rejected" in lines[0]
    assert f"fine alignment {FINE_S} s" in lines[1]
    assert list(estimator_lines({})) == []


def test_what_is_seen_of_the_biases_is_the_fused_part(runs):
    sensors = runs[0].summary["estimator"]["sensors"]
    gyros, accelerometers = sensors["gyros"], sensors["accelerometers"]
    assert gyros["true_bias_dph"] == pytest.approx([0.1, 0.11, 0.12, 0.13])
    assert accelerometers["true_bias_ug"] == pytest.approx([50, 55, 60, 65])
    # A regular tetrahedron: what all have in common cancels.
    centred = np.array([-0.015, -0.005, 0.005, 0.015])
    assert np.linalg.norm(gyros["true_fused_bias_dph"]) == pytest.approx(
        np.linalg.norm(centred) * np.sqrt(3 / 4), rel=1e-3
    )
    error = np.subtract(accelerometers["fused_bias_ug"], accelerometers["true_fused_bias_ug"])
    assert np.abs(error).max() < 1.0
    assert np.abs(np.subtract(gyros["bias_dph"], gyros["true_bias_dph"])).min() > 0.1
    assert min(gyros["sigma_dph"]) > 0.05  # and the filter says that it does not know them


def test_errors_are_inside_three_sigma(runs):
    run = runs[0]
    seconds, errors = run.seconds.estimates, run.errors
    position = np.interp(errors.epoch, seconds["epoch"], seconds["position_sigma"][:, 1])
    assert np.all(np.abs(errors.position_north_m) <= 3 * position)
    up = np.interp(errors.epoch, seconds["epoch"], seconds["attitude_sigma"][:, 2])
    assert np.all(np.abs(errors.turn_up_arcsec) / 206264.8 <= 3 * up)


def test_turns_are_those_of_the_matrices(runs):
    run, at = runs[0], -1
    nav, true = (
        body_to_navigation(*(float(row[name][at]) for name in ("roll", "pitch", "heading")))
        for row in (run.navigation, run.truth)
    )
    turn = nav @ true.T
    expected = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    errors = run.errors
    found = (errors.turn_east_arcsec, errors.turn_north_arcsec, errors.turn_up_arcsec)
    arcsec = np.degrees(np.array(expected) / 2) * 3600
    assert [float(one[at]) for one in found] == pytest.approx(arcsec, abs=1e-4)


def test_picture_and_table_are_written(runs, tmp_path):
    paths = runs[0].write(tmp_path)
    assert tmp_path / "estimator.png" in paths
    with (tmp_path / "estimated_sensors.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["sensor"] for row in rows][:5] == [*(f"gyro {k}" for k in range(1, 5)), _X]
    assert float(rows[0]["true"]) == pytest.approx(0.1)
    run = runs[0]
    figure = draw_estimates(run.seconds.estimates, run.errors, 0.0, RATE_HZ, "a title")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert len(labels) == 7  # the vertical is held
    assert labels[0] == "attitude error\nabout east\n/ ″"
    assert labels[-1] == "position error\nnorth\n/ m"


_X = "fused gyros x"


def test_without_an_estimator_there_is_none(tmp_path):
    run = rrins.simulate("ideal", duration_s=5)._result
    assert run.summary["estimator"] is None
    assert len(run.seconds.estimates) == 0
    names = {path.name for path in run.write(tmp_path)}
    assert not names & {"estimator.png", "estimated_sensors.csv"}


SCHEME = [
    ("outer", 360), ("inner", 90), ("outer", -360), ("inner", 90), ("outer", 360), ("inner", 90),
    ("outer", -360), ("inner", -270), ("outer", 90), ("inner", 360), ("outer", -180),
    ("inner", -360), ("outer", 90),
]  # fmt: skip
CYCLE_S = sum(abs(angle) / 2 + 10 for _, angle in SCHEME)


def askew(seed=3, ppm=50, arcsec=30, **noise):
    """Return sensors with errors of all kinds."""
    rng = np.random.default_rng(seed)
    tables = {}
    for kind, key, bias in (("gyros", "bias_dph", 0.1), ("accelerometers", "bias_ug", 50)):
        tables[kind] = {
            key: list(bias * rng.standard_normal(4)),
            "scale_error_ppm": list(ppm * rng.standard_normal(4)),
            "asymmetric_scale_error_ppm": list(ppm / 5 * rng.standard_normal(4)),
            "installation_u_arcsec": list(arcsec * rng.standard_normal(4)),
            "installation_v_arcsec": list(arcsec * rng.standard_normal(4)),
        }
    return tables


@pytest.fixture(scope="module")
def found():
    """A round of a scheme that shows every error, and a while of navigation."""
    return rrins.simulate(
        "rimu_rotating_aligned",
        duration_s=600,
        firmware={"scheme": [{"axis": axis, "angle_deg": angle} for axis, angle in SCHEME]},
        estimator={"enabled": True, "constants": True, "fine_alignment_s": CYCLE_S},
        **askew(),
    )._result


def test_with_all_errors_as_states_a_round_of_a_scheme_finds_them(found):
    worst = found.summary["max_abs_position_error_m"]
    print(f"\n{worst}")
    assert np.hypot(worst["east"], worst["north"]) < 10.0
    sensors = found.summary["estimator"]["sensors"]
    for kind in sensors.values():
        asymmetry = kind["constants"]["asymmetric_scale_error_ppm"]
        off = np.subtract(asymmetry["estimated"], asymmetry["true"])
        assert np.abs(off).max() < 3.0
        for name, one in kind["constants"].items():
            off = np.subtract(one["estimated"], one["true"]) / one["sigma"]
            assert np.abs(off).max() < 4.0, name


def test_what_was_found_of_each_sensor_is_written_beside_the_truth(found, tmp_path):
    paths = found.write(tmp_path)
    assert tmp_path / "estimated_sensors.png" in paths
    with (tmp_path / "estimated_sensors.csv").open() as file:
        rows = {row["sensor"]: row for row in csv.DictReader(file)}
    row = rows["gyro 2 scale error"]
    expected = askew()["gyros"]["scale_error_ppm"][1]
    assert (row["unit"], float(row["true"])) == ("ppm", pytest.approx(expected, abs=1e-3))
    row = rows["accelerometer 4 installation v"]
    expected = askew()["accelerometers"]["installation_v_arcsec"][3]
    assert (row["unit"], float(row["true"])) == ("arcsec", pytest.approx(expected, abs=1e-3))
    assert len(rows) == 2 * (5 * 4 + 3)


def test_odometer_and_altimeter_are_told_beside_the_truth():
    summary = rrins.simulate("drive_aided", duration_s=120).summary["estimator"]
    for name, one in (summary["odometer"] | summary["altimeter"]).items():
        assert abs(one["estimated"] - one["true"]) < 4 * one["sigma"], name
    assert summary["odometer"]["scale_ppm"]["true"] == pytest.approx(-1996, abs=1)
    assert summary["odometer"]["yaw_deg"]["true"] == pytest.approx(0.5, abs=1e-3)
