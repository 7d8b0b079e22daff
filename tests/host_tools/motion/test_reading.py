"""Files are understood, or refused with the line's number."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.reading import read
from rrins.host_tools.scenario.motion import Motion

HEADER = "time_s,latitude_deg,longitude_deg,height_m"
ROWS = [f"{k},40.{k:03d},116.5,{100 + k}" for k in range(10)]
POS = "%  GPST  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"


def take(path, **keys):
    return read(path, Motion(kind="file", path=str(path), **keys))


def test_csv_with_position_only(write):
    found = take(write([HEADER, *ROWS], "a.csv"))
    assert found.time_s == pytest.approx(np.arange(10))
    assert np.degrees(found.place[3]) == pytest.approx([40.003, 116.5, np.degrees(103)])
    assert not found.has_velocity
    assert not found.has_attitude
    assert found.line.tolist() == list(range(2, 12))
    assert (found.place_deviation == 0.02).all()


def test_csv_in_any_order_with_velocity_attitude_and_comments(write):
    header = (
        "# made by hand\n\nheading_deg;roll_deg;pitch_deg;height_m;time_s;latitude_deg;"
        "longitude_deg;velocity_up_mps;velocity_east_mps;velocity_north_mps;sd_up_m;sd_east_m;sd_north_m;remark"
    )
    row = "{h};1;2;50;{t};40;116;0.3;0.1;0.2;0.5;0.6;0.7;x"
    path = write([header, *(row.format(t=t, h=355 + 2 * t) for t in range(9))], "a.csv")
    found = take(path)
    assert found.velocity_n[0] == pytest.approx([0.1, 0.2, 0.3])
    assert np.degrees(found.attitude[8]) == pytest.approx([1, 2, 371])
    assert found.place_deviation[0] == pytest.approx([0.6, 0.7, 0.5])
    assert found.unused == ("remark",)
    assert found.line[0] == 4


def test_headings_and_longitudes_go_on_over_their_edge(write):
    header = HEADER + ",roll_deg,pitch_deg,heading_deg"
    rows = [f"{t},10,{x},0,0,0,{h}" for t, (x, h) in enumerate([(179.9, 359), (-179.9, 1)])]
    found = take(write([header, *rows], "a.csv"))
    assert np.degrees(np.diff(found.place[:, 1])) == pytest.approx(0.2)
    assert np.degrees(np.diff(found.attitude[:, 2])) == pytest.approx(2)


def test_pos_with_date_and_clock(exported, write):
    found = take(write(exported["pos"]))
    assert found.kind == "pos"
    assert found.has_velocity
    assert np.diff(found.time_s) == pytest.approx(0.25)
    assert np.degrees(found.place[0, :2]) == pytest.approx([40.3554, 116.668])
    assert found.line[0] == 3
    assert (found.place_deviation == 0.002).all()


def test_pos_with_week_and_seconds_over_the_end_of_the_week(write):
    rows = [f"2374 {604798 + k}.500  40.0 116.0 50.0 1 9 0.01 0.02 0.03" for k in range(2)]
    rows += [f"2375 {k}.500  40.0 116.0 50.0 2 9 0.01 0.02 0.03" for k in range(2)]
    found = take(write([POS, *rows]))
    assert found.time_s == pytest.approx([0, 1, 2, 3])
    assert found.place_deviation[0] == pytest.approx([0.02, 0.01, 0.03])


def test_pos_over_midnight(write):
    times = ("2025/12/31 23:59:59.000", "2026/01/01 00:00:00.250")
    found = take(write([POS, *(f"{t} 40 116 50 1 9 .01 .01 .01" for t in times)]))
    assert np.diff(found.time_s) == pytest.approx(1.25)


def test_pos_without_a_header_has_the_columns_of_rtklib(exported, write):
    bare = [line for line in exported["pos"] if not line.startswith("%")]
    with_header, without = take(write(exported["pos"])), take(write(bare, "b.pos"))
    assert (with_header.velocity_n == without.velocity_n).all()


@pytest.mark.parametrize(
    ("row", "kind", "words"),
    [
        ("1,40", "columns", "2 columns instead of 4"),
        ("1,40,116,50,7", "columns", "5 columns instead of 4"),
        ("1,x,116,50", "not_a_number", "latitude_deg is 'x'"),
        ("1,,116,50", "not_a_number", "latitude_deg is ''"),
        ("1,nan,116,50", "not_a_number", "latitude_deg is nan"),
        ("1,40,inf,50", "not_a_number", "longitude_deg is inf"),
        ("soon,40,116,50", "not_a_number", "time_s is 'soon'"),
        ("1,140,116,50", "out_of_range", "latitude_deg is 140, not within -89.9 to 89.9"),
        ("1,40,116,-5000", "out_of_range", "height_m is -5000"),
    ],
)
def test_a_line_that_cannot_be_is_left_out_and_reported(write, row, kind, words):
    found = take(write([HEADER, *ROWS[:4], row, *ROWS[5:]], "a.csv"))
    (irregular,) = found.irregularities
    assert irregular.line == 6
    assert irregular.kind == kind
    assert words in irregular.text
    assert 6 not in found.line
    assert len(found) == 9


def test_a_wrong_velocity_costs_the_velocity_only(write):
    names = ",velocity_east_mps,velocity_north_mps,velocity_up_mps"
    rows = [f"{row},1,2,{'nan' if k == 3 else 3}" for k, row in enumerate(ROWS)]
    found = take(write([HEADER + names, *rows], "a.csv"))
    (irregular,) = found.irregularities
    assert irregular.mended == "the line's velocity left out"
    assert len(found) == 10
    assert np.isnan(found.velocity_n[3]).all()


def test_lines_of_no_solution_are_reported(write):
    rows = [f"2374 {k} 40.0 116.0 50.0 {int(k != 2)} 9 0.01 0.02 0.03" for k in range(5)]
    found = take(write([POS, *rows]))
    assert [(i.line, i.kind) for i in found.irregularities] == [(4, "no_solution")]


def test_a_time_that_no_receiver_gives_costs_its_line(write):
    rows = [f"2000 {k}.0 40.0 116.0 40.0 1 9" for k in range(5)]
    rows[1] = "9" * 400 + rows[1][4:]
    rows[2] = "-1" + rows[2][4:]
    rows[3] = "20\x000" + rows[3][4:]
    header = "%  GPST latitude(deg) longitude(deg) height(m) Q ns"
    found = take(write([header, *rows], "a.pos"))
    assert [(i.line, i.kind) for i in found.irregularities] == [
        (line, "not_a_number") for line in (3, 4, 5)
    ]
    assert found.irregularities[2].text == "not a time: 20\N{REPLACEMENT CHARACTER}0 3.0"


@pytest.mark.parametrize(
    ("name", "lines", "words"),
    [
        ("a.txt", ["x"], "must end in .csv or .pos"),
        ("a.csv", [""], "is empty"),
        ("a.pos", ["% only", "% comments"], "the file has no data lines"),
        ("a.csv", ["time_s,latitude,longitude_deg,height_m"], "rename latitude to it?"),
        ("a.csv", ROWS, "line 1: no header row with names such as time_s"),
        ("a.csv", [HEADER + ",height_m"], "line 1: duplicate column height_m"),
        ("a.csv", [HEADER + ",x" * 100_000], "line 1: 100004 columns, 1000 at most"),
        ("a.csv", [HEADER + ",x\0,x\0"], "duplicate column x\N{REPLACEMENT CHARACTER}"),
        ("a.csv", [HEADER + ",roll_deg"], "no column pitch_deg (group: roll_deg, pitch_deg, "),
        (
            "a.pos",
            ["%  GPST x-ecef(m) y-ecef(m) z-ecef(m) Q"],
            "latitude, longitude, height needed",
        ),
        ("a.pos", ["% UTC latitude(d'\") longitude(d'\") height(m) Q"], "decimal degrees"),
    ],
)
def test_a_file_that_cannot_be_read_is_told_in_one_line(write, name, lines, words):
    with pytest.raises(MotionError) as caught:
        take(write(lines, name))
    assert words in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_binary_and_folder(tmp_path):
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x81")
    (tmp_path / "c.csv").mkdir()
    for name, words in (("a.csv", "No such file"), ("b.csv", "UTF-8"), ("c.csv", "is a folder")):
        with pytest.raises(MotionError, match=words):
            take(tmp_path / name)
