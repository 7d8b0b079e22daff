"""Errors against the truth, and files that are there whole or not at all."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.runs.results.results import compare, east_north_m, write_errors, write_whole

ARC_SECOND = math.radians(1 / 3600)


def logs(epochs, latitude=0.7, longitude=0.0):
    navigation, truth = (
        np.zeros(len(epochs), NavigationOutput.dtype),
        np.zeros(len(epochs), Truth.dtype),
    )
    for log in (navigation, truth):
        log["epoch"] = epochs
        log["latitude"] = latitude
        log["longitude"] = longitude
    return navigation, truth


def test_an_arc_second_of_latitude_and_longitude_in_metres():
    # WGS-84 at the equator: 30.715 m of latitude, 30.922 m of longitude.
    east, north = east_north_m(ARC_SECOND, ARC_SECOND, 0.0, 0.0, 0.0)
    assert north == pytest.approx(30.715, abs=1e-3)
    assert east == pytest.approx(30.922, abs=1e-3)


def test_the_date_line_is_no_jump():
    east, _ = east_north_m(0.0, -math.pi + 1e-9, 0.0, math.pi - 1e-9, 0.0)
    assert east == pytest.approx(2e-9 * 6378137.0, rel=1e-6)


def test_only_epochs_of_both_logs_are_compared():
    navigation, _ = logs([20, 40, 60])
    _, truth = logs([0, 20, 40])
    errors = compare(navigation, truth, rate_hz=200)
    assert errors.epoch.tolist() == [20, 40]
    assert errors.time_s.tolist() == [0.0, 0.1]


def test_the_largest_error_has_no_sign_and_the_end_counts_both_axes():
    navigation, truth = logs([0, 20, 40])
    navigation["velocity_n"][:, 0] = [0.0, -3.0, 1.0]
    navigation["latitude"][2] += 3 * ARC_SECOND
    found = compare(navigation, truth, 200).largest()
    assert found["max_abs_velocity_error_mps"]["east"] == 3.0
    north = found["max_abs_position_error_m"]["north"]
    assert found["end_position_error_m"] == pytest.approx(north)


def test_an_empty_run_has_no_figures():
    navigation, truth = logs([])
    assert compare(navigation, truth, 200).largest()["end_position_error_m"] is None


def test_heading_error_does_not_jump_at_north():
    navigation, truth = logs([0])
    navigation["heading"] = math.radians(359.9)
    assert compare(navigation, truth, 200).heading_deg[0] == pytest.approx(-0.1)


def test_the_csv_has_a_column_for_every_error(tmp_path):
    navigation, truth = logs([0, 20])
    path = tmp_path / "errors.csv"
    write_errors(path, compare(navigation, truth, 200))
    rows = list(csv.DictReader(path.open(encoding="utf-8")))
    assert len(rows) == 2
    assert rows[1]["epoch"] == "20"
    assert float(rows[1]["time_s"]) == 0.1
    assert {"position_east_m", "velocity_north_mps", "heading_deg", "inner_deg"} <= set(rows[0])


def test_a_failing_write_leaves_the_file_before_it(tmp_path):
    path = tmp_path / "summary.json"
    path.write_text("before")

    def fail(file):
        file.write("half")
        raise OSError("disk full")

    with pytest.raises(RehearsalError, match=r"summary.json: cannot be written: disk full"):
        write_whole(path, fail)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
