"""Increments to others and from others, from Python."""

from __future__ import annotations

import pytest

import rrins


def test_increments_that_were_written_become_a_log(tmp_path):
    written = rrins.write_increments("ideal", tmp_path, duration_s=3)
    assert written.has_truth
    assert written.rows == 3 * 200 + 1
    fixes = "".join(f"{second},40.3554,116.668,0\n" for second in range(3, 7))
    (tmp_path / "gnss.csv").write_text("time_s,latitude_deg,longitude_deg,height_m\n" + fixes)
    imported = rrins.import_recording(
        tmp_path, tmp_path / "vehicle.log", attitude_deg=(0.0, 0.0, 0.0)
    )
    assert imported.file.is_file()
    assert imported.scenario.duration_s == pytest.approx(3, abs=0.1)
    assert "SENSOR_1" in rrins.open_log(imported.file).messages


def test_what_is_wrong_is_one_line(tmp_path):
    with pytest.raises(rrins.ScenarioError, match="did you mean ideal"):
        rrins.write_increments("idael", tmp_path)
    with pytest.raises(rrins.RehearsalError, match="nothing"):
        rrins.import_recording(tmp_path / "nothing", tmp_path / "vehicle.log")
