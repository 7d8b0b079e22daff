"""pyxcp as the master of a rehearsal in lockstep on the embedded bus."""

from __future__ import annotations

import json
import os
import re
import subprocess
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyxcp")

from rrins.firmware_py.xcp.protocol import Resource
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.port import open_when_there
from rrins.host_tools.errors import BusError, XcpError
from rrins.host_tools.runs.direct import run_without_frames
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.testing.processes import fresh_channel
from rrins.host_tools.xcp.master import XcpMaster, values_of
from rrins.host_tools.xcp.recording import Recording, record
from rrins.host_tools.xcp.signals import signals_of
from tests.host_tools.xcp.conftest import Rehearsed, Sides, rehearse
from tests.processes import Fork

NAMES = (
    "epoch", "steps", "navigation.latitude", "navigation.longitude", "navigation.height",
    "navigation.velocity_n", "navigation.roll", "navigation.pitch", "navigation.heading",
    "assembly.gyro_dtheta[0]", "assembly.gyro_dtheta[1]", "assembly.gyro_dtheta[2]",
    "assembly.accelerometer_dv[0]", "assembly.accelerometer_dv[3]", "assembly.encoder_angle_deg",
    "sequencer.running", "modes.mode", "faults.crc_errors",
)  # fmt: skip
SIGNALS = signals_of(NAMES)
SECONDS = 10.0
SCENARIO = load("ideal").varied(duration_s=60.0, xcp={})


@dataclass
class Visit:
    """What a master saw."""

    rehearsed: Rehearsed
    recording: Recording
    by_second: Recording
    after_write: dict[str, float]
    refusals: list[str]


@pytest.fixture(scope="module")
def visit() -> Visit:
    seen: dict[str, Any] = {"refusals": []}

    def refused(action: Any) -> None:
        with pytest.raises(XcpError) as error:
            action()
        seen["refusals"].append(str(error.value))

    def guest(address: Address) -> None:
        with XcpMaster(address, timeout_s=30.0) as master:
            seen["recording"] = record(master, SIGNALS, SECONDS)
            (height,) = signals_of(["parameters.height"])  # where navigation started: of no effect
            master.write(height, 12.5)
            seen["after_write"] = values_of(master, [height])
            refused(lambda: master.write(height, 1e9))
            refused(lambda: master.write(SIGNALS[0], 0))
            refused(lambda: master.read_bytes(0x0FFF_FFFF, 1))
            seen["by_second"] = record(master, SIGNALS[:2], 4.0, event=1)  # type: ignore[arg-type]

    watch = [(signal.address, signal.size) for signal in SIGNALS]
    rehearsed = rehearse(SCENARIO, guest, watch)
    return Visit(rehearsed, **seen)


def check_values(recording: Recording, watched: dict[int, bytes], seconds: float) -> None:
    epochs = recording.values["epoch"]
    assert recording.count == round(seconds * SCENARIO.rate_hz)
    assert np.all(np.diff(epochs) == 1)
    assert np.array_equal(np.rint(recording.time_s * SCENARIO.rate_hz), epochs)
    for k, epoch in enumerate(epochs.tolist()):
        row = b"".join(column[k].tobytes() for column in recording.values.values())
        assert row == watched[epoch]


def test_every_value_is_that_of_the_memory_in_its_epoch(visit):
    check_values(visit.recording, visit.rehearsed.watched, SECONDS)


def test_nothing_is_missing_and_the_load_is_told(visit):
    recording = visit.recording
    assert len(recording.values) >= 20
    assert recording.overloads == recording.torn == 0
    packets = 1 + -(-(sum(signal.size for signal in SIGNALS) - 3) // 7)
    assert recording.bus_share == pytest.approx(packets * 135 * 200 / 1e6)


def test_the_event_of_the_second_comes_at_whole_seconds(visit):
    assert visit.by_second.count == 4
    assert np.all(visit.by_second.values["epoch"] % 200 == 0)


def test_the_navigation_is_that_without_xcp(visit):
    alone = run_without_frames(SCENARIO.varied(xcp=None))
    assert visit.rehearsed.firmware.trace.sha256() == alone.firmware["navigation_sha256"]


def test_a_parameter_is_written_and_read_back(visit):
    assert visit.after_write == {"parameters.height": 12.5}
    assert visit.rehearsed.firmware.ram[0].parameters.height == 12.5


def test_what_cannot_be_done_is_told_in_one_line(visit):
    limits, measured, memory = visit.refusals
    assert limits == "signal parameters.height: 1e+09 is not from -1000 to 100000"
    assert measured == "signal epoch: is measured, and cannot be written"
    assert re.fullmatch(r"xcp read: refused, .*ACCESS_DENIED.*", memory)
    assert Resource.CALIBRATION == 1


def test_without_the_table_nobody_answers():
    def guest(address: Address) -> None:
        with pytest.raises(XcpError, match=r"no answer over XCP; .*\[xcp\]"):
            XcpMaster(address, timeout_s=0.3)

    rehearse(SCENARIO.varied(xcp=None, duration_s=20.0), guest)


def test_without_a_bus_there_is_no_master():
    with pytest.raises(BusError, match="not running"):
        XcpMaster(Address("rrins", "xcp-nobody"))


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_six_hundred_seconds_of_twenty_signals_are_whole():
    scenario = SCENARIO.varied(duration_s=900.0)
    recordings: list[Recording] = []

    def guest(address: Address) -> None:
        with XcpMaster(address, timeout_s=60.0) as master:
            recordings.append(record(master, SIGNALS, 600.0))

    watch = [(signal.address, signal.size) for signal in SIGNALS]
    rehearsed = rehearse(scenario, guest, watch)
    (recording,) = recordings
    check_values(recording, rehearsed.watched, 600.0)
    assert recording.overloads == recording.torn == 0
    alone = run_without_frames(scenario.varied(xcp=None))
    assert rehearsed.firmware.trace.sha256() == alone.firmware["navigation_sha256"]


@pytest.mark.soak
@pytest.mark.skipif("RRINS_REAL_TIME" not in os.environ, reason="RRINS_REAL_TIME is not set")
@pytest.mark.timeout(1800)
def test_twenty_signals_in_real_time_are_those_of_the_memory(tmp_path):
    """RRINS_XCP_S sets the length, s. The memory of each epoch is that of a run without a bus.

    A machine that is busy with something else makes overruns: they are shown (`-rP`).
    """
    seconds = float(os.environ.get("RRINS_XCP_S", "600"))
    scenario, channel = SCENARIO.varied(duration_s=seconds + 40), fresh_channel()
    (tmp_path / "measured.toml").write_text(scenario.toml(), encoding="utf-8")
    words = ["rrins", "rehearse", tmp_path / "measured.toml", "--channel", channel, "--speed", "1"]
    out = ["--json", "--out", tmp_path / "out"]
    with Fork([*words, *out], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        there = {"host": "never", "role": "observer", "name": "first"}
        open_when_there(Address("rrins", channel), 120, **there).shutdown()
        with XcpMaster(Address("rrins", channel), timeout_s=10.0) as master:
            recording = record(master, SIGNALS, seconds)
        summary = json.loads(process.communicate()[0])
    shown = {key: summary[key] for key in ("epochs", "overruns", "frames_lost")}
    print(recording.count, recording.overloads, recording.torn, recording.bus_share, shown)
    assert recording.count == round(seconds * SCENARIO.rate_hz)
    assert recording.overloads == recording.torn == 0
    if summary["frames_lost"]:
        return  # the machine stood still for longer than the firmware waits
    sides, watched = Sides(scenario.varied(xcp=None)), {}
    image = sides.firmware.ram.view(np.uint8)
    del recording.values["steps"]  # also those without frames, which the clock makes
    compared = [one for one in SIGNALS if one.name != "steps"]
    places = [k for one in compared for k in range(one.address, one.address + one.size)]
    for _ in range(sides.epochs):
        sides.step([])
        watched[int(sides.firmware.ram[0].epoch)] = image[places].tobytes()
    check_values(recording, watched, seconds)
    alone = run_without_frames(scenario.varied(xcp=None))
    assert summary["navigation_sha256"] == alone.firmware["navigation_sha256"]
