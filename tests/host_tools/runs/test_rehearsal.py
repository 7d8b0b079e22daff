"""Two real processes on the embedded bus, and every way in which such a run can end."""

from __future__ import annotations

import functools
import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time

import can
import pytest
from click.testing import CliRunner
from rich.console import Console

from rrins.host_tools.bus import channel as channel_module
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.run import Overrides, Plan, rehearse
from rrins.host_tools.scenario.scenario import load

in_soak = functools.partial(pytest.param, marks=pytest.mark.soak)


@pytest.fixture
def channel():
    return f"test-{os.getpid()}"


def test_a_rehearsal_ends_with_summary_pictures_and_rows(run, tmp_path):
    summary = run("rehearse", "rimu_rotating", "--duration", 120, "--out", "out")
    assert summary["completed"]
    assert summary["interface"] == "rrins"
    assert summary["epochs"] == 600 + 120 * 200 + 2
    assert summary["frames_lost"] == 0
    assert summary["overruns"] == 0
    assert len(summary["navigation_sha256"]) == 64
    assert 0 < summary["max_abs_position_error_m"]["east"] < 10
    assert summary["paper"]["max_abs_position_error_m"] == {"east": 5, "north": 2}
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == [
        "errors.csv", "horizontal_track.png", "navigation_errors.png", "parity.png",
        "summary.json",
    ]  # fmt: skip
    assert json.loads((out / "summary.json").read_text()) == summary
    assert (out / "navigation_errors.png").read_bytes().startswith(b"\x89PNG")


def test_ctrl_c_stops_both_sides_and_keeps_what_was_recorded(start, assert_gone, tmp_path):
    record = tmp_path / "bus.log"
    record.write_text("(0.0) can0 010#00\n")
    began_s = time.time()
    command = start(
        "rehearse", "ideal", "--record", record, "--timestamps", "unix", "--out", "out"
    )  # fmt: skip
    command.wait_for_line("10 %")
    children = command.children().values()
    command.process.send_signal(signal.SIGINT)
    status, out = command.finish()
    assert status == 130
    assert command.said[-1] == "rrins: stopped by the user"
    assert_gone(children)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert not summary["completed"]
    assert summary["frames_lost"] is None, "frames that were under way are not lost"
    assert "frames lost" not in out
    (seconds,) = re.findall(r"^over (\S+) s of 1600 s$", out, re.MULTILINE)
    assert 100 < float(seconds) < 1600
    previous = tmp_path / "previous" / "bus.log"
    assert f"rrins: the recording that was {record} is kept in {previous}" in command.said
    with can.LogReader(record) as log:
        messages = list(itertools.islice(log, 20_000))
    assert 0 <= messages[0].timestamp - began_s < 60
    identifiers = {message.arbitration_id for message in messages}
    assert {0x10, 0x20, 0x40, 0x61, 0x120} <= identifiers


def test_a_stopped_run_leaves_the_finished_one_where_it_is(start, run, tmp_path):
    finished = run("simulate", "ideal", "--duration", 2, "--out", "out")
    files = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    command = start("rehearse", "ideal", "--out", "out")
    command.wait_for_line("10 %")
    command.process.send_signal(signal.SIGINT)
    assert command.finish()[0] == 130
    assert (
        "rrins: out keeps the run that finished there; this one is in out/stopped" in command.said
    )
    stopped = tmp_path / "out" / "stopped"
    assert not json.loads((stopped / "summary.json").read_text())["completed"]
    assert {name: (tmp_path / "out" / name).read_bytes() for name in files} == files
    assert json.loads(files["summary.json"]) == finished


@pytest.mark.slow
def test_a_stall_of_the_machine_is_named_as_the_cause_of_the_fault(start, tmp_path):
    (tmp_path / "own.toml").write_text(
        'mode = "strapdown"\nduration_s = 4\n[firmware]\nalignment_s = 0.5\n'
    )
    command = start("rehearse", "own.toml", "--speed", "1", "--out", "out")
    command.wait_for_line("50 %")
    hardware = command.children()["hardware"]
    os.kill(hardware, signal.SIGSTOP)
    time.sleep(0.5)
    os.kill(hardware, signal.SIGCONT)
    assert command.finish()[0] == 8
    stall = json.loads((tmp_path / "out" / "summary.json").read_text())["stall"]
    assert stall["side"] == "hardware"
    assert stall["late_ms"] >= 490
    assert stall["at_s"] > 2
    assert command.said[-1] == (
        f"rrins: the firmware ended in FAULT: SENSORS_LOST; the hardware was {stall['late_ms']:.0f}"
        f" ms late at {stall['at_s']:.1f} s: the machine stalled; rehearse where less runs beside, "
        "or without --speed 1"
    )


@pytest.mark.slow
def test_a_stall_of_the_firmware_alone_is_made_up_for_and_named(start, tmp_path):
    (tmp_path / "own.toml").write_text(
        'mode = "strapdown"\nduration_s = 4\n[firmware]\nalignment_s = 0.5\n'
    )
    command = start("rehearse", "own.toml", "--speed", "1", "--out", "out")
    command.wait_for_line("50 %")
    firmware = command.children()["firmware"]
    os.kill(firmware, signal.SIGSTOP)
    time.sleep(2)
    os.kill(firmware, signal.SIGCONT)
    status, out = command.finish()
    assert status == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["completed"]
    assert summary["frames_lost"] == 0
    assert summary["stall"] is None, "there was no fault"
    lateness = summary["firmware"]["lateness_us"]
    stall = max(lateness["stalls"], key=lambda stall: stall["late_ms"])
    assert 1990 <= stall["late_ms"] == pytest.approx(lateness["max"] / 1e3, abs=0.1)
    assert stall["at_s"] > 2
    assert f"max {lateness['max']:.0f} µs at {stall['at_s']:.1f} s, " in out


@pytest.mark.parametrize(
    ("side", "number", "words"),
    [
        ("firmware", signal.SIGKILL, "killed by SIGKILL"),
        in_soak("hardware", signal.SIGKILL, "killed by SIGKILL"),
        in_soak("firmware", signal.SIGTERM, "stopped by SIGTERM or SIGINT"),
        ("hardware", signal.SIGTERM, "stopped by SIGTERM or SIGINT"),
    ],
)
def test_a_side_that_is_ended_ends_the_other_and_is_named(
    start, assert_gone, tmp_path, side, number, words
):
    command = start("rehearse", "ideal", "--out", "out")
    command.wait_for_line("10 %")
    children = command.children()
    os.kill(children[side], number)
    status, _ = command.finish()
    assert status == 5
    last = command.said[-1]
    assert last.startswith(f"rrins: the {side} process {children[side]} was {words}")
    assert sum(line.startswith("rrins:") for line in command.said) == 1
    assert_gone(children.values())
    assert (tmp_path / "out" / "errors.csv").stat().st_size > 0


def test_a_killed_rehearsal_leaves_no_orphans(start):
    command = start("rehearse", "ideal", "--out", "out")
    command.wait_for_line("10 %")
    # The two sides hold the write end of standard error: it is over when both have ended.
    command.process.kill()
    command.process.communicate(timeout=120)


def test_a_side_that_is_stopped_and_continued_changes_nothing(start, run, tmp_path):
    reference = run("simulate", "rimu_rotating", "--duration", 120)["navigation_sha256"]
    for side in ("firmware", "hardware"):
        command = start("rehearse", "rimu_rotating", "--duration", 120, "--out", "out")
        command.wait_for_line("10 %")
        stopped = command.children()[side]
        os.kill(stopped, signal.SIGSTOP)
        with pytest.raises(subprocess.TimeoutExpired):
            command.process.wait(0.5)  # the world pauses
        os.kill(stopped, signal.SIGCONT)
        assert command.finish()[0] == 0
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        assert summary["navigation_sha256"] == reference


def test_a_second_firmware_and_a_taken_channel_are_refused(start, channel):
    command = start("rehearse", "ideal", "--channel", channel, "--out", "out")
    command.wait_for_line("10 %")
    firmware = start("firmware", "ideal", "--channel", channel, "--speed", "max")
    second = start("rehearse", "ideal", "--channel", channel, "--out", "second")
    for refused, words in (
        (firmware, f"process {command.children()['firmware']}"),
        (second, channel),
    ):
        assert refused.finish()[0] == 4
        assert words in refused.said[-1]
    command.process.send_signal(signal.SIGINT)
    assert command.finish()[0] == 130


def test_a_channel_that_is_taken_while_both_sides_prepare_is_replaced_by_the_next(
    monkeypatch, tmp_path
):
    with RrinsBus("rrins0"):
        found = iter([[], []])  # it was still free when it was looked for
        detect = channel_module.detect
        monkeypatch.setattr(channel_module, "detect", lambda: next(found, None) or detect())
        scenario = load("ideal", duration_s=1)
        plan = Plan("ideal", scenario, Overrides(duration_s=1))
        with RunDisplay(scenario, Console(), quiet=True) as display:
            result = rehearse(plan, display, tmp_path)
    result.check()
    assert result.summary["completed"]


def test_each_side_alone_on_a_named_channel(start, channel):
    hardware = start("hardware", "ideal", "--duration", 5, "--channel", channel, "--speed", "max")
    firmware = start(
        "firmware", "ideal", "--duration", 5, "--channel", channel, "--speed", "max",
        "--attach-wait", 60, "--json",
    )  # fmt: skip
    status, out = firmware.finish()
    assert status == 0
    assert hardware.finish()[0] == 0
    summary = json.loads(out)
    assert summary["mode"] == "SHUTDOWN"
    assert summary["epochs_navigated"] == 5 * 200 + 1


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("rehearse", "ideal", "--interface", "nonsense", "--channel", "x"), 4, "nonsense"),
        (("rehearse", "ideal", "--interface", "socketcan"), 4, "--channel"),
        (("rehearse", "idael"), 3, "did you mean ideal"),
        (("rehearse", "ideal", "--record", "x.unknown"), 6, ".blf"),
        (("rehearse", "ideal", "--record", "no/folder/x.log"), 6, "no such folder"),
        (("simulate", "ideal", "--out", "/proc/nowhere"), 1, "/proc/nowhere"),
        (("rehearse", "ideal", "--speed", "0"), 2, "--speed"),
        (("simulate", "ideal", "--duration", "-1"), 3, "duration_s"),
    ],
)
def test_a_wrong_call_ends_in_one_clear_line(monkeypatch, tmp_path, arguments, status, words):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(rrins, arguments)
    assert (done.exit_code, done.stdout) == (status, "")
    assert words in done.stderr.splitlines()[-1]
    assert isinstance(done.exception, SystemExit)


def test_a_side_that_has_failed_is_asked_to_end_and_says_nothing_more():
    """Both sides fail alike, and the rehearsal ends the second while it ends by itself."""
    heard, report = os.pipe()
    words = ("firmware", "ideal", "--interface", "nonsense", "--channel", "x")
    command = (sys.executable, "-m", "rrins", *words, "--report-fd", str(report))
    with subprocess.Popen(command, pass_fds=(report,), stderr=subprocess.PIPE) as side:
        os.close(report)
        told = b""
        while b"nonsense" not in told and (piece := os.read(heard, 65536)):
            told += piece
        side.terminate()
        assert (side.wait(), side.stderr.read()) == (4, b"")
    os.close(heard)


def test_a_side_without_a_host_ends_in_one_clear_line(start):
    running = start("firmware", "ideal", "--channel", "nowhere")
    assert running.finish() == (4, "")
    assert "not running; start" in running.said[-1]
