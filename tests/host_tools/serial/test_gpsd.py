"""The real gpsd reads the firmware's NMEA output from a pseudo-terminal."""

from __future__ import annotations

import json
import math
import os
import select
import shutil
import socket
import subprocess
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.serial.lines import SerialLines
from rrins.firmware_py.serial.port import parse_port
from rrins.firmware_py.serial.settings import SerialSettings
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.scenario import scenario as scenarios

GPSD = shutil.which("gpsd") or shutil.which("gpsd", path="/usr/sbin:/sbin")
if GPSD is None and os.environ.get("RRINS_REQUIRE_GPSD") != "1":
    pytest.skip("gpsd is not installed (Debian: apt-get install gpsd)", allow_module_level=True)

DEAD_RECKONING = 5  # status of gpsd's TPV


class Gpsd:
    """A gpsd on one port, and a client that watches it."""

    def __init__(self, port):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            number = free.getsockname()[1]
        self.process = subprocess.Popen(
            [GPSD, "-N", "-n", "-D", "3", "-S", str(number), port],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
        )
        self._wait_for(b"listening on port")
        os.set_blocking(self.process.stderr.fileno(), False)
        self.socket = socket.create_connection(("127.0.0.1", number), timeout=120.0)
        self.socket.sendall(b'?WATCH={"enable":true,"json":true};\n')
        self._data = b""

    def _wait_for(self, words):
        for line in self.process.stderr:
            if words in line:
                return
        raise AssertionError("gpsd does not start")

    def reports(self, timeout_s):
        """Return the reports that come within a time of silence."""
        found = []
        while select.select([self.socket], [], [], timeout_s)[0]:
            data = self.socket.recv(65536)
            assert data, "gpsd has ended"
            *lines, self._data = (self._data + data).split(b"\n")
            found += [json.loads(line) for line in lines]
            timeout_s = 0.02
        self.process.stderr.read()  # lest its log fill the pipe
        return found

    def close(self):
        self.socket.close()
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def gpsd():
    started = []

    def start(port):
        started.append(Gpsd(port))
        return started[-1]

    yield start
    for one in started:
        one.close()


def newest(reports, kind):
    return next((report for report in reversed(reports) if report["class"] == kind), {})


@pytest.mark.parametrize("rate_hz", [1, 10])
def test_gpsd_reports_the_navigation(gpsd, rate_hz):
    firmware = Firmware(firmware_settings(scenarios.load("rimu_rotating")))
    start = datetime(2026, 5, 31, 23, 59, 50, tzinfo=UTC)
    settings = SerialSettings(nmea=parse_port("pty", 0), nmea_rate_hz=rate_hz, utc=start)
    lines = SerialLines(settings, firmware, lambda text: None)
    daemon = gpsd(lines.statistics()["serial"]["nmea"]["port"])
    state = firmware.ram[0]
    state["clock"]["synchronised"] = True
    output = state["navigation"]
    checked = 0
    for k in range(120):
        state["epoch"] = epoch = k * lines.every
        if k == 3:
            state["modes"]["mode"] = Mode.NAVIGATION_ROTATING
        latitude, longitude = 59.9999 + k * 1e-5, -0.0005 + k * 1e-5
        output["latitude"], output["longitude"] = np.radians([latitude, longitude])
        output["height"] = 1234.5 + k
        output["velocity_n"] = (-120.0, 90.0, 1.0)
        angles = (-12.345, 6.789, 359.9)
        output["roll"], output["pitch"], output["heading"] = np.radians(angles)
        lines.run(epoch)
        reports = daemon.reports(0.2)
        fix, attitude = newest(reports, "TPV"), newest(reports, "ATT")
        time = start + timedelta(seconds=epoch * firmware.period_ns * 1e-9)
        told = fix.get("time", "").replace("Z", "+00:00")
        if not told or datetime.fromisoformat(told) != time:
            continue  # it looks for the baud rate and probes for receivers at first
        assert fix["mode"] == 3
        assert fix["status"] == DEAD_RECKONING
        assert fix["lat"] == pytest.approx(latitude, abs=2e-9)
        assert fix["lon"] == pytest.approx(longitude, abs=2e-9)
        assert fix["altHAE"] == pytest.approx(1234.5 + k, abs=1e-3)
        assert fix["speed"] == pytest.approx(150, abs=1e-3)
        assert fix["track"] == pytest.approx(math.degrees(math.atan2(-120, 90)) + 360, abs=0.01)
        assert attitude["heading"] == pytest.approx(359.9, abs=1e-3)
        assert attitude["roll"] == pytest.approx(-12.345, abs=0.0051)  # gpsd has two decimals
        assert attitude["pitch"] == pytest.approx(6.789, abs=0.0051)
        checked += 1
        if checked == 12:  # over midnight and the end of a month at either rate, or into it
            break
    lines.close()
    assert checked == 12


def test_gpsd_has_no_fix_without_navigation(gpsd):
    firmware = Firmware(firmware_settings(scenarios.load("rimu_rotating")))
    lines = SerialLines(SerialSettings(nmea=parse_port("pty", 0)), firmware, lambda text: None)
    daemon = gpsd(lines.statistics()["serial"]["nmea"]["port"])
    state = firmware.ram[0]
    state["clock"]["synchronised"] = True
    seen = []
    for k in range(60):
        state["epoch"] = k * lines.every
        lines.run(k * lines.every)
        seen += [report for report in daemon.reports(0.1) if report["class"] == "TPV"]
        if len(seen) >= 3:
            break
    lines.close()
    assert len(seen) >= 3
    assert {fix["mode"] for fix in seen} == {1}
    assert not any("lat" in fix for fix in seen)


def test_gpsd_follows_a_rehearsal_in_real_time(gpsd, start, scenario, tmp_path):
    link = tmp_path / "nmea"
    options = ("--speed", 1, "--duration", 600, "--nmea", f"pty:{link}", "--nmea-rate", 10)
    running = start("rehearse", scenario, *options)
    running.wait_for_line("10 Hz")
    daemon = gpsd(str(link))
    fix = attitude = {}
    for _ in range(300):
        reports = daemon.reports(1.0)
        fix, attitude = newest(reports, "TPV") or fix, newest(reports, "ATT") or attitude
        if fix.get("mode") == 3 and "roll" in attitude:
            break
    running.process.terminate()
    running.finish()
    assert fix["status"] == DEAD_RECKONING
    assert fix["lat"] == pytest.approx(-33.8568, abs=0.1)
    assert fix["lon"] == pytest.approx(151.2153, abs=0.1)
    assert attitude["heading"] == pytest.approx(217.4, abs=2)
    assert attitude["roll"] == pytest.approx(1.25, abs=2)
    assert attitude["pitch"] == pytest.approx(-2.5, abs=2)
