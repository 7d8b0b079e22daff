"""Gaps, jumps and wrong timestamps: reported with the line, mended or refused."""

from __future__ import annotations

import pytest

from rrins.host_tools.motion.errors import MotionError

AT = 150  # index of a line while driving


def cells_changed(line, **changes):
    """Change cells of a line of `.pos`: c2 is the latitude, c1 the clock."""
    cells = line.split()
    for name, value in changes.items():
        cells[int(name[1:])] = value
    return " ".join(cells)


def later(line, seconds):
    hours, minutes, clock = line.split()[1].split(":")
    total = int(hours) * 3600 + int(minutes) * 60 + float(clock) + seconds
    text = f"{int(total // 3600):02d}:{int(total % 3600 // 60):02d}:{total % 60:06.3f}"
    return cells_changed(line, c1=text)


def moved(line, degrees):
    return cells_changed(line, c2=f"{float(line.split()[2]) + degrees:.9f}")


@pytest.fixture
def lines(exported):
    return list(exported["pos"])


def check(write, load, lines, expected):
    """Compare line, kind and words of all irregularities; then the same file must be refused."""
    path = write(lines)
    recording = load(path)
    found = [(i.line, i.kind) for i in recording.irregularities]
    assert found == [entry[:2] for entry in expected]
    for irregular, entry in zip(recording.irregularities, expected, strict=True):
        assert entry[2] in str(irregular)
    with pytest.raises(MotionError, match=f"own.pos: line {expected[0][0]}: ") as caught:
        load(path, irregularities="refuse")
    assert caught.value.exit_status == 9
    assert "\n" not in str(caught.value)
    return recording


def test_a_sound_file_passes_either_way(write, load, lines):
    path = write(lines)
    assert not load(path).irregularities
    assert len(load(path, irregularities="refuse")) == 601


def test_a_repeated_time(write, load, lines):
    lines.insert(AT, lines[AT - 1])
    check(write, load, lines, [(AT + 1, "repeated_time", "duplicate time: left out")])


def test_a_gap(write, load, lines):
    del lines[AT : AT + 20]
    check(write, load, lines, [(AT + 1, "gap", "gap of 5.25 s instead of 0.250 s: bridged")])


def test_a_gap_that_is_a_line_left_out_is_told_once(write, load, lines):
    lines[AT] = "garbage"
    check(write, load, lines, [(AT + 1, "columns", "1 columns instead of")])


@pytest.mark.parametrize("degrees", [1e-4, 1e-2, 5.0])
def test_a_position_that_is_off(write, load, lines, degrees):
    lines[AT] = moved(lines[AT], degrees)
    recording = check(write, load, lines, [(AT + 1, "jump", "m off: left out")])
    assert AT + 1 not in recording.line


def test_positions_that_are_off_for_a_while(write, load, lines):
    lines[AT : AT + 8] = [moved(line, 1e-3) for line in lines[AT : AT + 8]]
    check(write, load, lines, [(AT + 1 + k, "jump", "left out") for k in range(8)])


@pytest.mark.parametrize(
    ("changed", "degrees"),
    [(slice(AT, None), 1e-4), (slice(AT, AT + 21), 1.0), (slice(-1, None), 1)],
)
def test_positions_that_do_not_return_are_refused(write, load, lines, changed, degrees):
    line = range(1, len(lines) + 1)[changed][0]
    lines[changed] = [moved(one, degrees) for one in lines[changed]]
    with pytest.raises(MotionError, match=f"line {line}: position jumps by .* m and does not ret"):
        load(write(lines))


def test_without_velocities_jumps_are_seen_against_the_neighbours(write, load, exported):
    lines = [",".join(line.split(",")[:4]) for line in exported["csv"]]
    cells = lines[AT].split(",")
    lines[AT] = ",".join([cells[0], f"{float(cells[1]) + 1e-4:.9f}", *cells[2:]])
    recording = load(write(lines, "a.csv"))
    assert [(i.line, i.kind) for i in recording.irregularities] == [(AT + 1, "jump")]


def test_a_speed_beyond_the_limit_is_a_jump(write, load, exported):
    lines = [",".join(line.split(",")[:4]) for line in exported["csv"]]
    with pytest.raises(MotionError, match=r"position jumps by .* raise speed_limit_mps"):
        load(write(lines, "a.csv"), speed_limit_mps=8.0)


def test_a_file_that_begins_and_ends_in_motion(write, load, lines):
    part = [*lines[:2], *lines[100:170]]
    expected = [(3, "motion", "begins in motion"), (72, "motion", "ends in motion")]
    check(write, load, part, expected)


@pytest.mark.parametrize(
    ("keep", "words"),
    [(slice(2, 6), "4 samples, at least 8 needed"), (slice(2, 2), "no data lines")],
)
def test_too_little_is_no_motion(write, load, lines, keep, words):
    with pytest.raises(MotionError, match=words):
        load(write(lines[keep]))


def test_a_file_of_garbage_is_no_motion(write, load, lines):
    with pytest.raises(MotionError, match="only 188 of 588 lines"):
        load(write([*lines[:190], *(["?"] * 400)]), duration_s=50)


@pytest.mark.parametrize(
    ("changed", "seconds", "line", "words"),
    [
        (slice(AT, AT + 1), -20, AT + 1, f"time is 19.8 s before that of line {AT}; correct"),
        (slice(AT, AT + 1), 30, AT + 2, f"time is 29.8 s before that of line {AT + 1}; correct"),
        (slice(AT, None), 2000, AT + 1, "gap of 2,000 s, longer than"),
        (slice(-1, None), 5000, 603, "gap of 5,000 s, longer than"),
    ],
)
def test_wrong_times_are_refused(write, load, lines, changed, seconds, line, words):
    lines[changed] = [later(one, seconds) for one in lines[changed]]
    with pytest.raises(MotionError, match=f"own.pos: line {line}: {words}"):
        load(write(lines))


def test_a_part_of_the_file(write, load, lines):
    assert load(write(lines), duration_s=60).time_s[-1] == 60


def test_of_a_part_only_its_own_lines_count(write, load, lines):
    lines[60] = "garbage"
    recording = load(write([*lines, *(["?"] * 400)]), duration_s=30)
    assert len(recording) == 120
    assert recording.lines == 121
    assert [(i.line, i.kind) for i in recording.irregularities] == [
        (61, "columns"),
        (123, "motion"),
    ]
