"""Signals by name, over time, and the commands' words."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.logs.pictures import draw_series
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.series import Changes, Envelope, gather
from rrins.host_tools.logs.signals import find_signals, signals_of
from rrins.host_tools.recording.errors import RecordError


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["SENSOR_1.gyro_dtheta"], ["SENSOR_1.gyro_dtheta"]),
        (["roll_deg"], ["NAV_ATTITUDE.roll_deg"]),
        (["SENSOR_[12].gyro_*"], ["SENSOR_1.gyro_dtheta", "SENSOR_2.gyro_dtheta"]),
        (["NAV_VELOCITY.*"], ["NAV_VELOCITY.velocity_east", "NAV_VELOCITY.velocity_north"]),
        (["NAV_*.velocity_*", "NAV_VELOCITY.velocity_east"],
         ["NAV_VELOCITY.velocity_east", "NAV_VELOCITY.velocity_north", "NAV_HEIGHT.velocity_up"]),
        (["SYNC.*crc"], ["SYNC.crc"]),
    ],
)  # fmt: skip
def test_signals_are_found_by_name(words, found):
    assert [signal.full_name for signal in find_signals(words)] == found


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("latitude_dg", "did you mean latitude_deg"),
        ("SENSOR_1.gyro_dteta", r"did you mean SENSOR_1\.gyro_dtheta"),
        ("sensor_1.gyro_dtheta", r"did you mean .*SENSOR_1\.gyro_dtheta"),
        ("gyro_dtheta", r"in 16 messages: name one of SENSOR_1\.gyro_dtheta.*or \*\.gyro_dtheta"),
        ("SENSORS_*.x", "not in the DBC"),
    ],
)
def test_a_word_that_is_not_clear_is_told(word, hint):
    with pytest.raises(RecordError, match=hint):
        find_signals([word])


def test_columns_end_with_their_unit():
    columns = {
        s.full_name: s.column for m in ("SENSOR_1", "NAV_HEIGHT", "SYNC") for s in signals_of(m)
    }
    assert columns["SENSOR_1.gyro_dtheta"] == "gyro_dtheta_rad"
    assert columns["SENSOR_1.accelerometer_dv"] == "accelerometer_dv_mps"
    assert columns["NAV_HEIGHT.height"] == "height_m"
    assert columns["SYNC.time_us"] == "time_us"


@given(
    values=arrays.arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e6, 1e6)),
    cuts=st.lists(st.integers(0, 400), max_size=5),
)
def test_an_envelope_keeps_the_extremes(values, cuts):
    envelope = Envelope(capacity=16)
    time_s = np.arange(len(values))
    at = sorted(min(cut, len(values)) for cut in cuts)
    for when, part in zip(np.split(time_s, at), np.split(values, at), strict=True):
        envelope.add(when, part)
    when, line = envelope.line()
    assert line.min() == values.min()
    assert line.max() == values.max()
    assert len(line) <= 4 * 16 + 2
    assert np.isin(line, values).all()
    assert np.all(np.diff(when) >= 0)


@given(
    arrays.arrays(np.int64, st.integers(1, 100), elements=st.integers(0, 3)), st.integers(0, 100)
)
def test_changes_keep_every_change(values, cut):
    changes = Changes()
    time_s = np.arange(len(values))
    cut = min(cut, len(values))
    changes.add(time_s[:cut], values[:cut])
    changes.add(time_s[cut:], values[cut:])
    at, what = changes.line()
    rebuilt = what[np.searchsorted(at[:-1], time_s, side="right") - 1]
    assert np.array_equal(rebuilt, values)
    assert at[-1] == time_s[-1]


def test_a_picture_has_a_panel_for_each_unit_and_names_on_the_scale(recordings):
    words = ["SENSOR_[1-4].gyro_dtheta", "*.encoder_angle_deg", "NAV_ATTITUDE.*", "mode"]
    series, contents = gather(Log(recordings().path), find_signals(words), 1.0, 3.0)
    figure = draw_series(series, contents, "bus.log")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert re.fullmatch(r"gyro dtheta\n/ .?rad", labels[0])
    assert labels[1] == "angle\n/ °"  # of axes and of the attitude
    assert "mode" in labels
    assert not [label for label in labels if not re.match("[a-z]", label)], "a unit alone"
    assert [axes.get_xlabel() for axes in figure.axes][-1] == "time since the log's first frame / s"
    names = [text.get_text() for text in figure.axes[-1].get_yticklabels()]
    assert "NAVIGATION_ROTATING (5)" in names
    styles = {(line.get_linestyle(), line.get_color()) for line in figure.axes[0].get_lines()}
    assert len(styles) == 4
    for line in figure.axes[0].get_lines():
        assert min(line.get_xdata()) >= 1.0
        assert max(line.get_xdata()) <= 3.0


@pytest.mark.parametrize(("signal", "what"), [("SYNC.time_us", "time"), ("SYNC.epoch", "epoch")])
def test_many_digits_stand_at_the_label_and_not_over_the_legend(
    tmp_path, write_candump, signal, what
):
    codec = load()
    frames = frame_array(200)
    for k, frame in enumerate(frames):
        raws = {"time_us": 200_000 * k, "epoch": 80_000 * k, "crc": 0, "alive_counter": 0}
        frame["data"] = int.from_bytes(codec.database.encode_message("SYNC", raws), "little")
    frames["can_id"], frames["length"] = codec.frame_id("SYNC"), 8
    write_candump(tmp_path / "long.log", frames, np.arange(200) / 5)
    figure = draw_series(*gather(Log(tmp_path / "long.log"), find_signals([signal])), "long.log")
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert axes.yaxis.get_offset_text().get_text() == ""
    assert axes.get_ylabel().startswith(f"{what}\n/ $10^{{6}}$")
    last = float(axes.get_lines()[0].get_ydata()[-1])
    assert last == pytest.approx({"SYNC.time_us": 39.8, "SYNC.epoch": 15.92}[signal])


def call(*arguments):
    result = CliRunner().invoke(rrins, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result


@pytest.mark.pictures
def test_the_commands_from_end_to_end(recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = recordings().path
    assert call("plot", path, "*.encoder_angle_deg").exit_code == 0
    assert (tmp_path / "bus.png").read_bytes().startswith(b"\x89PNG")
    assert call("plot", path, "mode", "--format", "svg").stdout == "bus.svg\n"
    listed = call("plot", path, "--list").output
    assert "SENSOR_4: 702 frames, 200.0 per second" in listed
    assert "SENSOR_4.gyro_dtheta [rad]" in listed
    assert "SENSOR_5" not in listed
    assert "SYNC.csv" in call("export", path, "tables", "--format", "csv").output
    again = call("replay", path, "--firmware", "--compare")
    assert again.exit_code == 0
    assert "as recorded" in again.output
    assert "no difference in" in again.output
    made = {file.name for file in (tmp_path / "out" / "bus").iterdir()}
    assert made == {
        "navigation.csv", "navigation.png", "navigation_errors.png", "horizontal_track.png",
        "errors.csv", "parity.png", "summary.json",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "picture"),
    [("run.2026.01.log", "run.2026.01.png"), ("run.1.LOG.gz", "run.1.png"), ("a.log.log", "a.png")],
)
def test_a_picture_has_the_name_of_its_log(copy, tmp_path, monkeypatch, name, picture):
    monkeypatch.chdir(tmp_path)
    content = copy().read_bytes()
    Path(name).write_bytes(gzip.compress(content, 1) if name.endswith("gz") else content)
    assert call("plot", name, "mode").stdout == f"{picture}\n"
    assert Path(picture).is_file()


@pytest.mark.pictures
@pytest.mark.parametrize("name", ["$a$ $\\frac{$.log", "no-utf-8\udcff.log", "[b] :x:.log"])
@pytest.mark.parametrize("time_s", [1e9, 1e12, 1e14])
def test_any_name_and_any_time_are_drawn(tmp_path, monkeypatch, name, time_s):
    monkeypatch.chdir(tmp_path)
    lines = (f"({time_s + k:.0f}.5) can0 010#0000000000000000\n" for k in range(3))
    Path(name).write_text("".join(lines))
    assert call("plot", name, "SYNC.epoch", "--out", "x.png").exit_code == 0
    assert Path("x.png").stat().st_size > 1000


@pytest.mark.parametrize("time_s", [1e15, 1e300])
def test_times_that_no_clock_has_are_one_line(tmp_path, time_s):
    path = tmp_path / "far.log"
    path.write_text(f"({time_s:.0f}.5) can0 010#0000000000000000\n")
    result = call("plot", path, "SYNC.epoch", "--out", tmp_path / "x.png")
    assert (result.exit_code, result.stderr) == (
        6,
        f"rrins: {path}: 1 line is not a frame; skipped\n",
    )
    assert not (tmp_path / "x.png").exists()


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (["../x.log"], "no name of a file in this folder: '../x.log'"),
        (["/etc/passwd"], "no name of a file"),
        ([""], "no name of a file"),
        ([".."], "no name of a file"),
        (["x" * 300], "no name of a file"),
        (["a\0b"], "no name of a file"),
        (["copy.log", "copy.log"], "a file is named twice"),
    ],
)
def test_parts_that_are_no_names_are_one_line(copy, parts, words):
    path = copy()
    beside = path.with_name(f"{path.name}.json")
    note = json.loads(beside.read_text())
    note["parts"] = [{"file": name, "first_s": 0.0} for name in parts]
    beside.write_text(json.dumps(note))
    result = call("plot", path, "--list")
    assert (result.exit_code, words in result.stderr) == (6, True)
    assert result.stderr.count("\n") == 1


def test_tables_of_another_export_are_told_of_and_stay(copy, tmp_path):
    path, folder = copy(), tmp_path / "tables"
    assert "another export" not in call("export", path, folder).stderr
    assert "another export" not in call("export", path, folder).stderr
    (folder / "SENSOR_9.csv").write_text("before")
    (folder / "own.csv").write_text("of the user")
    made = call("export", path, folder)
    assert f"{folder}: 1 table of another export remains there" in made.stderr
    assert (folder / "SENSOR_9.csv").read_text() == "before"


def test_channels_that_are_mixed_are_told_and_one_can_be_chosen(copy, tmp_path):
    path = copy()
    lines = path.read_text().splitlines(keepends=True)
    channel = lines[0].split()[1]
    doubled = "".join(line + line.replace(channel, "can1") for line in lines)
    path.write_text(doubled)
    mixed = call("export", path, tmp_path / "mixed")
    count = len(lines)
    assert (
        f"{path}: mixed channels: {channel} ({count} frames), can1 ({count} frames); "
        "select one with --log-channel" in mixed.stderr
    )
    chosen = call("export", path, tmp_path / "chosen", "--log-channel", "can1", "--json")
    assert json.loads(chosen.stdout)["frames"] == count
    assert chosen.stderr == ""
    assert f"{count} frames in" in call("plot", path, "--list", "--log-channel", channel).stdout
    again = call("replay", path, "--firmware", "--compare", "--log-channel", channel,
                 "--out", tmp_path / "out")  # fmt: skip
    assert "no difference in" in again.output
    missing = call("plot", path, "mode", "--log-channel", "can7")
    assert missing.exit_code == 6
    assert missing.stderr.endswith(f"has no frames on channel can7 ({channel}, can1)\n")


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("replay", "nowhere.log"), 6, "no such file"),
        (("replay", "LOG", "--only", "SENSR_1"), 6, "did you mean SENSOR_1"),
        (("replay", "LOG", "ideal"), 2, "only --firmware accepts a scenario"),
        (("replay", "LOG", "--speed", "0"), 2, "--speed"),
        (("replay", "LOG", "idael", "--firmware"), 3, "did you mean ideal"),
        (("replay", "ALONE", "--firmware"), 6, "SCENARIO --firmware"),
        (("replay", "LOG", "--compare", "nowhere.log"), 6, "no such file"),
        (("export", "LOG.json", "out"), 6, "not a readable log"),
        (("plot", "LOG", "latitude"), 6, "did you mean"),
        (("plot", "LOG", "SENSOR_9.gyro_dtheta"), 6, "no frames of SENSOR_9.gyro_dtheta"),
        (("plot", "LOG", "mode", "--from", "99"), 6, "in that time"),
        (("plot", "LOG"), 2, "--list"),
        (("plot", "LOG", "mode", "--out", "no/x.png"), 1, "cannot be written"),
        (("plot", "LOG", "mode", "--out", "x.doc"), 2, "'x.doc' ends in none of .png, .svg, .pdf"),
        (("record", "x.log", "--channel", "nowhere"), 4, "not running"),
        (("record", "x.xls"), 6, "must be one of"),
        (("record", "x.log", "--interface", "socketcan"), 4, "--channel"),
    ],
)
def test_a_wrong_call_is_one_line(copy, tmp_path, monkeypatch, arguments, status, words):
    monkeypatch.chdir(tmp_path)
    copy(".log", "LOG").rename("LOG.log")
    alone = copy(".log", "ALONE")
    alone.with_name("ALONE.log.json").unlink()
    names = {"LOG": "LOG.log", "ALONE": "ALONE.log", "LOG.json": "LOG.log.json"}
    result = call(*(names.get(argument, argument) for argument in arguments))
    assert result.exit_code == status
    assert words in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.output


def test_a_difference_ends_with_its_own_status(copy):
    path = copy()
    lines = path.read_text().splitlines(keepends=True)
    hit = next(k for k, line in enumerate(lines) if " 120#" in line)
    lines[hit] = lines[hit].replace("120#", "120#FF")[:-5] + " R\n"
    path.write_text("".join(lines))
    result = call("replay", path, "--firmware", "--compare", "--out", path.parent / "out")
    assert result.exit_code == 10
    assert "the first difference is at epoch" in result.stderr
    assert call("replay", path, "--compare", path).exit_code == 0
