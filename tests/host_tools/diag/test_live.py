"""The tool at rehearsals of two processes: what it reads, and that it disturbs nothing."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_py.diagnostics import table
from host_tools.bus.interface import RrinsBus
from host_tools.cli import rrins
from host_tools.diag.target import Target
from host_tools.diag.tester import Tester as Tool
from host_tools.direct import run_direct
from host_tools.errors import BusError, NoAnswerError
from host_tools.scenario import load, text_of
from host_tools.testing.processes import fresh_channel

START_S = 300


class Rehearsal:
    """A rehearsal under way."""

    def __init__(self, folder: Path, scenario: str, *options: str) -> None:
        self.channel = fresh_channel()
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "host_tools", "rehearse", scenario, "--json"),
                *("--channel", self.channel, "--out", str(folder / self.channel), *options),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def connect(self, **wishes: object) -> Tool:
        """Return a tester, once the firmware answers."""
        end = time.monotonic() + START_S
        while True:
            try:
                tester = Tool(Target(channel=self.channel), **wishes)  # type: ignore[arg-type]
            except BusError:
                assert time.monotonic() < end
                assert self.process.poll() is None
                time.sleep(0.02)  # nobody hosts the bus yet
                continue
            try:
                tester.read([table.identifier("epoch")])
            except (BusError, NoAnswerError):
                tester.close()
                assert time.monotonic() < end
            else:
                return tester

    def summary(self) -> dict:
        out, _ = self.process.communicate(timeout=START_S)
        return json.loads(out)

    def stop(self) -> None:
        self.process.terminate()
        self.process.communicate(timeout=60)


def read_until_the_end(tester: Tool) -> int:
    """Read every identifier in a loop until the rehearsal is over; return how often."""
    times = 0
    with tester:
        dids = tester.has(table.IDENTIFIERS)
        while True:
            try:
                tester.read(dids)
            except (BusError, NoAnswerError):
                return times
            times += 1


@pytest.mark.timeout(400)
def test_in_lockstep_reading_leaves_the_navigation_as_it_is(tmp_path):
    reference, _, _ = run_direct(load("rimu_rotating", duration_s=120.0))
    rehearsal = Rehearsal(tmp_path, "rimu_rotating", "--duration", "120", "--speed", "30")
    tester = rehearsal.connect()
    assert tester.connection.keeps_pace
    assert read_until_the_end(tester) > 20
    summary = rehearsal.summary()
    assert summary["navigation_sha256"] == reference["navigation_sha256"]
    assert summary["frames_lost"] == 0


@pytest.mark.timeout(400)
def test_in_lockstep_sessions_and_transfers_last_as_long_as_they_need(tmp_path):
    rehearsal = Rehearsal(tmp_path, "rimu_rotating")
    bridge = table.identifier("bridge")
    with rehearsal.connect(is_securing=True) as tester:
        tester.write(bridge, {"bridge_s": 0.2})
        time.sleep(1.0)  # a minute and more of a rehearsal that does not wait for the tool
        found = tester.read([bridge, table.identifier("active_session")])
        assert found == {"bridge": {"bridge_s": 0.2}, "active_session": {"session": 3}}
        file = tester.pull()
        tester.push(file)
        assert tester.pull() == file
    rehearsal.stop()


def overruns(folder: Path, scenario: Path, with_tool: bool) -> tuple[int, dict]:
    rehearsal = Rehearsal(folder, str(scenario), "--speed", "1")
    if with_tool:
        tester = rehearsal.connect()
        assert not tester.connection.keeps_pace
        assert read_until_the_end(tester) > 10
    summary = rehearsal.summary()
    return summary["firmware"]["faults"]["overruns"], summary


@pytest.mark.timeout(400)
def test_in_real_time_at_400_hz_reading_costs_no_overruns(tmp_path):
    """Other processes of the machine cost some: so the comparison is tried again."""
    scenario = tmp_path / "fast.toml"
    text = text_of("rimu_rotating").replace("rate_hz = 200", "rate_hz = 400")
    scenario.write_text(text.replace("duration_s = 6000", "duration_s = 5", 1))
    for _ in range(4):
        without, reference = overruns(tmp_path, scenario, with_tool=False)
        with_tool, summary = overruns(tmp_path, scenario, with_tool=True)
        if with_tool <= without:
            break
    assert with_tool <= without
    if with_tool == summary["frames_lost"] == reference["frames_lost"] == without == 0:
        assert summary["navigation_sha256"] == reference["navigation_sha256"]


@pytest.mark.timeout(120)
def test_a_bus_without_a_navigation_computer():
    channel = fresh_channel()
    with RrinsBus(channel, host="auto"):
        ended = CliRunner().invoke(rrins, ["diag", "identify", "--channel", channel])
    assert ended.exit_code == 21
    assert "nobody answers diagnostic requests" in ended.stderr
    ended = CliRunner().invoke(rrins, ["diag", "identify", "--channel", fresh_channel()])
    assert ended.exit_code == 4
    assert len(ended.stderr.splitlines()) == 1
