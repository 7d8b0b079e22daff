"""`rrins motion`: what is found in a file, and true motions that can be read again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.drawing.style import POINTS
from rrins.host_tools.motion.build import follow, load_recording
from rrins.host_tools.motion.plots import draw_check
from rrins.host_tools.scenario.motion import Motion


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def runner(*arguments, status=0):
        result = CliRunner().invoke(rrins, ["motion", *map(str, arguments)])
        assert result.exit_code == status, result.output
        return result

    return runner


@pytest.mark.pictures
@pytest.mark.slow
def test_check_tells_what_is_in_a_file(run, write, exported, tmp_path):
    lines = list(exported["pos"])
    del lines[200:220]
    found = json.loads(run("check", write(lines), "--json", "--out", "pictures").stdout)
    assert found["format"] == "pos"
    assert found["span_s"] == 150
    assert found["rate_hz"] == 4
    assert found["would_be_refused"]
    assert found["counts"] == {"gap": 1}
    assert found["irregularities"][0]["line"] == 201
    assert found["speed_max_mps"] > 10
    assert found["position_residual_m"]["max"] < 0.02
    assert (tmp_path / "pictures" / "own.png").stat().st_size > 20_000


def test_the_picture_of_a_long_file_is_small_and_keeps_its_peaks(write, exported):
    recording = load_recording(Motion(kind="file", path=str(write(exported["pos"]))), Path())
    smoothed = follow(recording, Motion(), 5_000_000)
    count = 4 * 3600 * 50
    times, jolt = np.linspace(0.0, 4 * 3600.0, count), np.zeros((count, 3))
    jolt[count // 3] = 7.0
    residuals = replace(smoothed.residuals, time_s=times, line=np.arange(count), position=jolt)
    figure = draw_check(recording, replace(smoothed, residuals=residuals))
    position = figure.axes[5]
    assert all(len(line.get_xdata()) <= POINTS + 2 for line in position.lines)
    assert max(position.lines[0].get_ydata()) == 7.0


def test_check_tells_what_the_attitude_is_and_where_it_is_made_up(run, write, exported):
    lines = list(exported["csv"])
    del lines[201:261]
    found = json.loads(run("check", write(lines[:500], "own.csv"), "--json").stdout)["attitude"]
    assert found["source"] == "file"
    low, high = found["range_deg"]["pitch"]
    assert -5 < low < high < 5
    assert found["residual_deg"]["pitch"]["max"] < 0.1
    assert found["gaps"] == 1
    assert found["longest_gap_s"] == pytest.approx(15.25)
    assert found["longest_gap_before_line"] == 202
    assert found["held_before_s"] == pytest.approx(3)
    text = run("check", "own.csv").stdout
    assert "attitude of file roll " in text
    assert "smoothed - file: roll rms " in text
    assert "held in 1 gap of 15.2 s before line 202" in text


def test_check_uses_as_much_of_the_file_as_asked(run, write, exported):
    path = write(exported["pos"])  # 150 s
    found = json.loads(run("check", path, "--json", "--duration", 31).stdout)
    assert found["span_s"] == 31
    assert found["lines"] == found["samples"] == 125


def test_check_prints_a_line_for_each_irregularity(run, write, exported):
    lines = list(exported["pos"])
    lines.insert(200, lines[199])
    text = run("check", write(lines)).stdout
    assert "line 201: duplicate time: left out" in text
    assert "would be refused" in text


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["check", "missing.pos"], 9, "rrins: motion missing.pos: cannot be read"),
        (["export", "missing.csv", "out.csv"], 9, "rrins: motion missing.csv: cannot be read"),
        (["export", "drive", "out.txt"], 9, "rrins: motion out.txt: must end in .csv or .pos"),
        (["export", "drive", "nowhere/out.csv"], 9, "no such folder: nowhere"),
        (["export", "sway", "s.csv", "--picture", "/dev/null/p.png"], 1, "/dev/null"),
        (["export", "sway", "s.csv", "--picture", "p.doc"], 2, "ends in none of .png, .svg, .pdf"),
        (["export", "drive", "out.csv", "--duration", "5"], 2, "duration_s"),
        (["export", "ideal", "out.csv"], 9, "is stationary"),
        (["export", "nothing", "out.csv"], 3, "neither built in nor a file"),
    ],
)
def test_an_error_is_one_line(run, tmp_path, arguments, status, words):
    result = run(*arguments, status=status)
    assert words in result.stderr
    assert "Traceback" not in result.output
    assert not (tmp_path / "out.csv").exists()


def test_a_refused_file_leaves_the_old_export(run, write, exported, tmp_path):
    lines = list(exported["pos"])
    del lines[200:220]
    (tmp_path / "out.csv").write_text("before")
    run("export", write(lines), "out.csv", "--irregularities", "refuse", status=9)
    assert (tmp_path / "out.csv").read_text() == "before"


@pytest.mark.parametrize("ending", ["csv", "pos"])
def test_an_export_has_the_rate_asked_for_and_reads_as_sound(run, ending):
    run("export", "drive", f"d.{ending}", "--duration", 60, "--rate", 20)
    found = json.loads(run("check", f"d.{ending}", "--json").stdout)
    assert found["samples"] == 1201
    assert found["rate_hz"] == pytest.approx(20)
    assert not found["would_be_refused"]


@pytest.mark.pictures
def test_an_exported_csv_holds_what_a_rimu_feels(run, tmp_path):
    run("export", "sway", "s.csv", "--duration", 100, "--picture", "s.png")
    table = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True)
    assert len(table) == 1001
    assert table["specific_force_b_z_mps2"].mean() == pytest.approx(9.80, abs=0.02)
    assert np.hypot(table["omega_ib_b_y_dps"][0], table["omega_ib_b_z_dps"][0]) == pytest.approx(
        np.degrees(7.292115e-5), rel=1e-5
    )
    assert (tmp_path / "s.png").stat().st_size > 20_000


def test_a_recorded_file_is_exported_smooth(run, write, exported, tmp_path):
    run("export", write(exported["pos"]), "out.csv", "--rate", 50)
    assert len((tmp_path / "out.csv").read_text().splitlines()) > 7500
