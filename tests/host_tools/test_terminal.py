"""Tables and progress as printed, at any width."""

from __future__ import annotations

import io
import re
import sys

import pytest
from rich.console import Console
from rich.table import Table

from rrins.host_tools.cli.output import print_text
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import print_line, print_table, progress_line

VALUES = (-8.2112e-05, 1234.5678, -1 / 3, 2e9, -7.5e-12, 0.25, -66.0)
NUMBERS = [f"{value:.4e} µrad/s" for value in VALUES]
NUMBER = re.compile(r"-?\d\.\d{4}e[+-]\d\d µrad/s")


def wide_table():
    table = Table(
        title="Seven numbers, and a title that is longer than eighty columns, " + "x" * 40
    )
    table.add_column("what", no_wrap=True)
    for number, _ in enumerate(NUMBERS):
        table.add_column(f"number {number}", justify="right")
    table.add_row("the first of two rows", *NUMBERS)
    table.add_row("second", *reversed(NUMBERS))
    return table


def printed(width, is_terminal):
    shown = io.StringIO()
    print_table(wide_table(), Console(file=shown, width=width, force_terminal=is_terminal))
    return re.sub(r"\x1b\[[0-9;]*m", "", shown.getvalue()).splitlines()


def test_a_table_in_a_pipe_is_never_wrapped_nor_cut():
    title, *lines = printed(80, is_terminal=False)
    assert title.endswith("x" * 40)
    (first,) = (line for line in lines if "first" in line)
    assert NUMBER.findall(first) == NUMBERS
    assert len(lines) == 6


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_a_table_that_does_not_fit_continues_below_with_whole_numbers(width):
    lines = printed(width, is_terminal=True)[1:]
    table = [line for line in lines if line and "x" * 5 not in line]
    assert max(map(len, table)) <= width
    firsts = [line for line in table if "first" in line]
    assert NUMBER.findall(" ".join(firsts)) == NUMBERS
    assert firsts


class Screen(io.StringIO):
    def lines(self):
        """Return each line that was shown, as it was."""
        text = re.sub(r"\x1b\[\??[0-9;]*[A-Za-z]", "", self.getvalue())
        return [line for line in re.split(r"[\r\n]+", text) if line.strip()]


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_progress_has_a_bar_the_mode_and_the_time_left_at_any_width(width):
    screen = Screen()
    scenario = load("rimu_rotating")
    half = scenario.epochs // 2
    report = {
        "kind": "progress",
        "side": "firmware",
        "epoch": half,
        "mode": "NAVIGATION_ROTATING",
        "fault": "NONE",
        "position": "12 of 16",
        "navigating": False,
    }
    with RunDisplay(scenario, Console(file=screen, width=width, force_terminal=True)) as display:
        display.report({"kind": "preparing", "side": "firmware"})
        display.report({"kind": "started"})
        display.report(report)
        display.report(report | {"epoch": half + 1})
        display._progress.refresh()
    last = screen.lines()[-1]
    assert len(last.rstrip()) <= width
    assert re.match(r"navigation rotating [━╸╺]+ +50 % \S+", last), last
    assert re.search(r" ((\d+:)?\d+:\d\d| -:--)" + (" left" if width > 40 else ""), last), last
    assert "…" not in last
    assert ("12 of 16" in last) == (width == 120)


@pytest.mark.parametrize("quiet", [False, True])
def test_a_long_task_says_every_five_minutes_how_far_it_is_where_there_is_no_terminal(quiet):
    now_s, shown = 0.0, io.StringIO()
    console = Console(file=shown, width=80, force_terminal=False)
    with progress_line(console, quiet, get_time=lambda: now_s) as progress:
        task = progress.add_task("runs", total=300)
        for done in range(1, 151):
            now_s += 5.0
            progress.update(task, completed=done, state=("3 failed",))
    expected = ["runs: 20 %, 20:00 left  3 failed", "runs: 40 %, 15:00 left  3 failed"]
    assert shown.getvalue().splitlines() == ([] if quiet else expected)


def test_progress_elsewhere_is_a_line_now_and_then(capsys):
    shown = io.StringIO()
    scenario = load("rimu_rotating")
    with RunDisplay(scenario, Console(file=shown, width=40)) as display:
        display.report({"kind": "started"})
        display.report(
            {
                "kind": "progress",
                "side": "firmware",
                "epoch": scenario.epochs // 2 + 1,
                "mode": "FAULT",
                "fault": "SENSORS_LOST",
                "position": "12 of 16",
                "navigating": False,
            }
        )
    started, half = shown.getvalue().splitlines()
    assert started == "running"
    assert re.match(r" 50 %  fault \(sensors lost\)  \d+ s .*× real time  position 12 of 16$", half)


@pytest.mark.parametrize("is_terminal", [True, False])
@pytest.mark.parametrize("is_quiet", [True, False])
def test_that_only_the_first_start_compiles_is_said_once(is_terminal, is_quiet):
    screen = Screen()
    console = Console(file=screen, width=80, force_terminal=is_terminal)
    with RunDisplay(load("rimu_rotating"), console, is_quiet) as display:
        for functions in (1, 2):
            for side in ("firmware", "hardware"):
                display.report({"kind": "compiling", "side": side, "functions": functions})
        display._progress.refresh()
    note = "compiling, up to half a minute on two cores; later starts load what is compiled"
    lines = [line.strip() for line in screen.lines()]
    assert lines.count(note) == (not is_quiet)
    count = "compiling functions: firmware 2, hardware 2"
    assert any(line.startswith(count) for line in lines) == (is_terminal and not is_quiet)


@pytest.mark.parametrize("first", ["firmware", "hardware"])
def test_progress_shows_the_latest_error_whichever_side_reports_first(first):
    shown = io.StringIO()
    scenario = load("rimu_rotating")
    north = 1e-6
    reports = {
        "firmware": {"mode": "NAVIGATION_ROTATING", "fault": "NONE", "position": 1}
        | {"navigating": True, "longitude": 0.0},
        "hardware": {"latitude": 0.0, "longitude": 0.0},
    }
    with RunDisplay(scenario, Console(file=shown, width=200)) as display:
        display.report({"kind": "started"})
        for tenth in range(1, 4):
            epoch = scenario.epochs * tenth // 10 + 1
            reports["firmware"]["latitude"] = tenth * north
            for side in sorted(reports, key=lambda side: side != first):
                place = {"kind": "progress", "side": side, "epoch": epoch}
                display.report(place | reports[side])
    errors = re.findall(r"error ([\d.]+) m ", shown.getvalue())
    late = first == "firmware"  # its line is printed before the truth is known
    expected = [6.36, 12.7, 19.1][: 2 if late else 3]
    assert [float(error) for error in errors] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_long_line_is_broken_between_words_in_a_terminal_only(monkeypatch, capfd, is_terminal):
    text = "  a line of results " + "with many words " * 10 + "/a/path" * 14
    shown = io.StringIO()
    print_line(Console(file=shown, width=80, force_terminal=is_terminal), text, highlight=False)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: is_terminal)
    print_text(text)
    for lines in (shown.getvalue().splitlines(), capfd.readouterr().out.splitlines()):
        assert " ".join(" ".join(lines).split()) == " ".join(text.split())
        assert (len(lines) == 1) == (not is_terminal)
        assert all(len(line) <= 80 for line in lines if "/a/path" not in line) or not is_terminal
