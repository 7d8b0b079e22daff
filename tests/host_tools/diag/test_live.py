"""The tool at rehearsals of two processes: what it reads, and that it disturbs nothing."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.firmware_py.diagnostics import table
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.interface import RrinsBus
from rrins.host_tools.bus.port import open_when_there
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.tester import Tester as Tool
from rrins.host_tools.errors import BusError, NoAnswerError
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.scenario.scenario import load, text_of
from rrins.host_tools.testing.processes import fresh_channel
from tests.processes import Fork

START_S = 300
PAIRS = int(os.environ.get("RRINS_PAIRS", "0"))


class Rehearsal:
    """A rehearsal under way."""

    def __init__(self, folder: Path, scenario: str, *options: str) -> None:
        self.channel = fresh_channel()
        self.process = Fork(
            [
                *("rrins", "rehearse", scenario, "--json"),
                *("--channel", self.channel, "--out", str(folder / self.channel), *options),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    def connect(self, **wishes: object) -> Tool:
        """Return a tester, once the firmware answers."""
        end = time.monotonic() + START_S
        there = {"host": "never", "role": "observer", "name": "first"}
        open_when_there(Address("rrins", self.channel), START_S, **there).shutdown()
        while True:
            tester = Tool(Target(channel=self.channel), **wishes)  # type: ignore[arg-type]  # of several types
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


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_in_lockstep_reading_leaves_the_navigation_as_it_is(tmp_path):
    reference = run_direct(load("rimu_rotating", duration_s=90.0)).firmware
    rehearsal = Rehearsal(tmp_path, "rimu_rotating", "--duration", "90", "--speed", "30")
    tester = rehearsal.connect()
    assert tester.conversation.connection.keeps_pace
    assert read_until_the_end(tester) > 20
    summary = rehearsal.summary()
    assert summary["navigation_sha256"] == reference["navigation_sha256"]
    assert summary["frames_lost"] == 0


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_in_lockstep_sessions_and_transfers_last_as_long_as_they_need(tmp_path):
    rehearsal = Rehearsal(tmp_path, "rimu_rotating")
    bridge = table.identifier("bridge")
    with rehearsal.connect(is_securing=True) as tester:
        tester.write(bridge, {"bridge_s": 0.2})
        time.sleep(0.3)  # many seconds of a rehearsal that does not wait for the tool
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
        assert not tester.conversation.connection.keeps_pace
        assert read_until_the_end(tester) > 10
    summary = rehearsal.summary()
    return summary["firmware"]["faults"]["overruns"], summary


@pytest.mark.skipif(not PAIRS, reason="RRINS_PAIRS says how many pairs of 20 s to compare")
@pytest.mark.timeout(60 + 120 * PAIRS)
def test_in_real_time_at_400_hz_reading_costs_no_overruns(tmp_path):
    """Other work on the machine costs time with and without the tool: medians are compared."""
    scenario = tmp_path / "fast.toml"
    text = text_of("rimu_rotating").replace("rate_hz = 200", "rate_hz = 400")
    scenario.write_text(text.replace("duration_s = 6000", "duration_s = 20", 1))
    found: dict[bool, list[int]] = {False: [], True: []}
    digests = set()
    for number in range(PAIRS):
        for with_tool in (number % 2 == 0, number % 2 == 1):
            count, summary = overruns(tmp_path, scenario, with_tool)
            found[with_tool].append(count)
            if count == summary["hardware"]["faults"]["overruns"] == 0:
                digests.add(summary["navigation_sha256"])
    print(f"overruns without {found[False]}, with the tool {found[True]}")
    assert len(digests) <= 1
    assert statistics.median(found[True]) <= statistics.median(found[False]) + 1


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


@pytest.mark.soak
def test_at_400_hz_an_epoch_with_requests_is_far_from_its_deadline(rrins_bench):
    """By the processor's time, of the dearest epoch of each reading of all identifiers.

    Another program on the same core makes single epochs dearer, not most of the dearest.
    """
    bench = rrins_bench("rimu_rotating", way="direct", rate_hz=400)
    bench.advance(4.0)
    firmware = bench._execution.firmware
    step = firmware.step_whole
    costs_ns = []

    def timed(*frames):
        begun_ns = time.thread_time_ns()
        sent = step(*frames)
        costs_ns.append(time.thread_time_ns() - begun_ns)
        return sent

    with bench.tester() as tester:
        dids = tester.has(table.IDENTIFIERS)
        tester.read(dids)
        firmware.step_whole = timed
        dearest_us, epochs = [], 0
        for _ in range(40):
            costs_ns.clear()
            tester.read(dids)
            epochs += len(costs_ns)
            dearest_us.append(max(costs_ns) / 1000)
    assert epochs > 4000
    print(f"dearest epoch of a reading, us: {np.percentile(dearest_us, (0, 50, 100))}")
    assert statistics.median(dearest_us) < 0.5 * 2500
