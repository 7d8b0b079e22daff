"""The firmware's serial lines in each way to run it."""

from __future__ import annotations

import itertools
import os
import tty
from datetime import UTC, datetime

import click
import numpy as np
import pynmea2
import pytest
from click.testing import CliRunner

from rrins.firmware_py.core.records.memory import NavigationOutput
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial.nmea import SENTENCES as ALL_SENTENCES
from rrins.firmware_py.serial.port import parse_port
from rrins.firmware_py.serial.settings import DEFAULT_UTC, NO_LINES, SerialSettings
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.cli.run.serial_options import serial_options
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.runs.results.samples import read_samples
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario import scenario as scenarios
from rrins.host_tools.serial.arguments import arguments_of
from rrins.host_tools.serial.lines import Tasks, open_lines

SENTENCES = tuple(ALL_SENTENCES)


def settings(nmea=None, console=None, rate_hz=1, sentences=SENTENCES, utc=DEFAULT_UTC):
    names = [None if text is None else parse_port(text, 9600) for text in (nmea, console)]
    return SerialSettings(names[0], rate_hz, sentences, utc, names[1])


@pytest.fixture(scope="module")
def plain(scenario):
    """A run without serial lines."""
    return run_direct(scenarios.load(str(scenario))).firmware


def test_nmea_is_the_same_text_however_it_is_run(run, scenario, plain, tmp_path):
    paths = [tmp_path / name for name in ("direct.nmea", "lockstep.nmea")]
    utc = datetime(2024, 2, 29, 23, 59, 58, tzinfo=UTC)
    lines = settings(f"file:{paths[0]}", rate_hz=5, utc=utc)
    direct = run_direct(scenarios.load(str(scenario)), serial=lines).firmware
    options = ("--nmea", f"file:{paths[1]}", "--nmea-rate", 5, "--utc", "2024-03-01T00:59:58+01:00")
    lockstep = run("rehearse", scenario, *options, "--console", "pty")["firmware"]
    for summary, path in zip((direct, lockstep), paths, strict=True):
        assert summary["navigation_sha256"] == plain["navigation_sha256"]
        counts = summary["serial"]["nmea"]
        assert counts["sent"] == path.read_bytes().count(b"\r\n")
        assert counts["dropped"] == counts["unread"] == 0
    assert lockstep["serial"]["console"]["commands"] == 0
    assert paths[0].read_bytes() == paths[1].read_bytes()
    lines = paths[0].read_text().splitlines()
    assert len(lines) == (1 + plain["epoch"] // 40) * len(SENTENCES)
    found = [pynmea2.parse(line, check=True) for line in lines if line[3:6] == "RMC"]
    times = [rmc.datetime for rmc in found]
    assert all((b - a).total_seconds() == 0.2 for a, b in itertools.pairwise(times))
    assert str(times[0]) == "2024-02-29 23:59:58+00:00"
    assert str(times[-1].date()) == "2024-03-01"
    assert "".join(rmc.status for rmc in found).strip("V").strip("A") == ""
    assert {rmc.status for rmc in found} == {"A", "V"}


def test_sentences_are_those_of_the_navigation(scenario, tmp_path):
    path = tmp_path / "all.nmea"
    lines = settings(f"file:{path}", rate_hz=10, sentences=("GGA", "HDT", "PASHR"))
    run_direct(scenarios.load(str(scenario)), folder=tmp_path, serial=lines)
    rows = read_samples(tmp_path / "navigation.samples", NavigationOutput)
    sets = [line.split(b",") for line in path.read_bytes().splitlines() if b"GGA" in line]
    assert {line[1:6] for line in path.read_text().splitlines()} == {"PASHR", "INHDT", "INGGA"}
    checked = 0
    for row in rows:
        fields = sets[row["epoch"] // 20]
        position = pynmea2.parse(b",".join(fields).decode())
        if position.gps_qual == 6:
            assert position.latitude == pytest.approx(np.degrees(row["latitude"]), abs=1e-9)
            assert position.longitude == pytest.approx(np.degrees(row["longitude"]), abs=1e-9)
            assert position.altitude == pytest.approx(row["height"], abs=6e-4)
            checked += 1
    assert checked > 25


def test_a_pseudo_terminal_that_nobody_reads_costs_nothing(scenario, plain):
    lines = settings("pty", "pty", rate_hz=10)
    summary = run_direct(scenarios.load(str(scenario)), serial=lines).firmware
    assert summary["navigation_sha256"] == plain["navigation_sha256"]
    counts = summary["serial"]["nmea"]
    assert counts["sent"] == counts["dropped"] == 0
    assert counts["unread"] > 100


def reach(console, mode):
    """Ask for the status until it shows a mode."""
    answer = ""
    while f"mode    {mode}" not in answer:
        console.type("status\r")
        answer = console.wait_for("rrins> ")


@pytest.fixture
def device():
    """A serial device that a test can unplug: both ends, and the name of one."""
    other, own = os.openpty()
    tty.setraw(own)
    return other, own, os.ttyname(own)


def test_a_rehearsal_with_console_outlives_its_nmea_device(
    start, scenario, terminal, device, tmp_path
):
    other, own, name = device
    link = tmp_path / "console"
    options = ("--console", f"pty:{link}", "--nmea", f"{name}:4800", "--nmea-rate", 5)
    running = start("rehearse", scenario, "--speed", 1, "--duration", 600, *options)
    running.wait_for_line("sentences will be dropped")  # 4800 baud carry 480 bytes a second
    running.wait_for_line(f"({link})")
    console = terminal(link)
    assert console.wait_for("rrins> ").startswith("RRINS firmware")
    assert os.read(other, 7) == b"$PASHR,"
    reach(console, "NAVIGATION_ROTATING")
    os.close(own)
    os.close(other)
    running.wait_for_line(f"{name} at 4800 baud is lost: it hung up; continuing without it")
    console.type("nmea\r")
    console.wait_for("nmea lost: ")
    console.wait_for("rrins> ")
    console.type("mode strapdown\r")
    console.wait_for("requested NAVIGATE_STRAPDOWN")
    console.wait_for("rrins> ")
    reach(console, "NAVIGATION_STRAPDOWN")
    running.process.terminate()
    status, _ = running.finish()
    assert status == 130
    assert sum("is lost" in line for line in running.said) == 1
    assert not link.is_symlink()


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (settings("/dev/no-such-port"), "/dev/no-such-port: No such file or directory"),
        (settings(console="/dev/no-such-port"), "/dev/no-such-port: No such file or directory"),
        (
            settings("pty", rate_hz=7),
            "200 Hz is not a multiple of it; use one of 1, 2, 4, 5, 8, 10",
        ),
        (settings("pty:/dev/null"), "pty:/dev/null: cannot be linked: File exists"),
    ],
)
def test_lines_that_cannot_be_opened_are_one_line(lines, words):
    with pytest.raises(RehearsalError) as caught:
        open_lines(lines, Firmware(firmware_settings(scenarios.load("rimu_rotating"))), print)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_firmware_says_why_its_line_cannot_be_opened(start, scenario):
    command = start("firmware", scenario, "--nmea", "/dev/no-such-port")
    assert command.finish()[0] == 1
    assert command.said[-1] == "rrins: serial port /dev/no-such-port: No such file or directory"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--nmea", "pty", "--nmea-sentences", "gga,zda"), "'ZDA' is not one of PASHR"),
        (("--nmea", "pty", "--utc", "yesterday"), "'yesterday' is not a time such as"),
        (("--nmea", "pty", "--utc", "1850-01-01"), "must be from 1980 to 2079"),
        (("--nmea", "pty", "--nmea-rate", "11"), "11 is not in the range"),
        (("--nmea", "file:"), "file: needs a path"),
        (("--console", "file:x"), "the console needs a serial device"),
    ],
)
def test_wrong_options_are_wrong_use(options, words):
    result = CliRunner().invoke(rrins, ["rehearse", "ideal", *options])
    assert result.exit_code == 2
    assert words in result.output


@pytest.mark.parametrize(
    "lines",
    [
        NO_LINES,
        settings("pty:/run/x", "/dev/ttyS0:9600", 5, ("GGA",), datetime(2030, 1, 2, tzinfo=UTC)),
    ],
)
def test_the_firmware_of_a_rehearsal_gets_the_same_lines(lines):
    @click.command()
    @serial_options
    def command(serial):
        assert serial == lines

    result = CliRunner().invoke(command, arguments_of(lines), catch_exceptions=False)
    assert result.exit_code == 0, result.output


def test_tasks_come_at_their_epochs():
    told = []
    tasks = Tasks((6, lambda epoch: told.append(("a", epoch))), (0, told.append), (4, told.append))
    assert tasks.every == 2
    for epoch in range(0, 13, tasks.every):
        tasks.run(epoch)
    assert told == [("a", 0), 0, 4, ("a", 6), 8, ("a", 12), 12]
