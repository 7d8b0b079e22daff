"""Programs by others at the embedded bus, called as docs/attach.md calls them."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.interface import RrinsBus
from tests.processes import Fork

ROOT = Path(__file__).parents[3]
DBC = ROOT / "dbc" / "rrins.dbc"
CHANNEL = "tools"
RRINS = ("-i", "rrins", "-c", CHANNEL, "--bus-kwargs", "host=never", "role=observer")
PATIENCE_S = 60

pytestmark = pytest.mark.slow

STATUS = load().database.get_message_by_name("AXIS_INNER_STATUS")


def axis_frames() -> Any:
    """Return a SYNC and a frame of an axis that stands at 90°."""
    values = {signal.name: 0 for signal in STATUS.signals} | {"encoder_angle_deg": 90}
    frames = frame_array(2)
    frames["can_id"], frames["length"] = [load().frame_id("SYNC"), STATUS.frame_id], 8
    frames["data"][1] = int.from_bytes(STATUS.encode(values), "little")
    return frames


@pytest.fixture
def traffic(runtime_directory: Path) -> Iterator[None]:
    """A bus with SYNC and the status of an axis every 5 ms of its time."""
    has_ended = threading.Event()
    frames, is_there = axis_frames(), threading.Event()

    def send() -> None:
        with RrinsBus(CHANNEL, host="here", name="hardware") as bus:
            is_there.set()
            epoch = 0
            while not has_ended.wait(0.005):
                bus.send_batch(frames, 2, epoch=epoch, time_ns=epoch * 5_000_000)
                bus.recv(0)
                epoch += 1

    thread = threading.Thread(target=send)
    thread.start()
    is_there.wait()
    yield
    has_ended.set()
    thread.join()


def await_(holds: Any) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


def await_message(bus: RrinsBus, identifier: int) -> None:
    end = time.monotonic() + PATIENCE_S
    while getattr(bus.recv(1.0), "arbitration_id", None) != identifier:
        assert time.monotonic() < end


def start(*command: object, **options: Any) -> subprocess.Popen[bytes]:
    if any(str(word).endswith(".mf4") for word in command):  # asammdf is imported at the start
        return subprocess.Popen([sys.executable, "-m", *map(str, command)], **options)
    return Fork(command, **options)


def finish(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    process.wait(PATIENCE_S)


def shown(pattern: bytes, *command: object) -> bytes:
    """Run a program on a terminal until it shows a pattern; return what it has written."""
    master, slave = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "LINES": "40", "COLUMNS": "100"}
    process = start(*command, stdin=slave, stdout=slave, stderr=slave, env=environment)
    os.close(slave)
    written = b""
    try:
        while not re.search(pattern, written):
            written += os.read(master, 65536)
    finally:
        process.kill()
        process.wait()
        os.close(master)
    return written


@pytest.mark.usefixtures("traffic")
def test_loggers_file_has_unix_time_and_cantools_plots_it(tmp_path: Path) -> None:
    log, picture = tmp_path / "bus.log", tmp_path / "angle.png"
    before_s = time.time()
    logger = start("can.logger", *RRINS, "timestamps=unix", "-f", log, stdout=subprocess.DEVNULL)
    await_(lambda: log.is_file() and len(log.read_bytes().splitlines()) > 50)
    finish(logger)
    with can.LogReader(log) as reader:
        times_s = [message.timestamp for message in reader]
    assert before_s - 60 < times_s[0] < times_s[-1] < time.time() + 1
    assert times_s[2] - times_s[0] == pytest.approx(0.005, abs=2e-6)  # of whole microseconds
    with log.open("rb") as lines:
        plot = start(
            "cantools", "plot", "-o", picture, DBC, "*.encoder_angle_deg", stdin=lines,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        said, _ = plot.communicate(timeout=PATIENCE_S)
    assert plot.returncode == 0, said
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("traffic")
def test_viewers_show_frames_and_signals() -> None:
    shown(rb"0x060", "can.viewer", *RRINS)
    shown(rb"encoder_angle_deg: 90", "cantools", "monitor", DBC, *RRINS)


@pytest.mark.usefixtures("traffic")
def test_a_bridge_carries_frames_both_ways() -> None:
    pytest.importorskip("can.bridge", reason="python-can 4.5 has it")
    words: list[str] = []
    for number, channel in enumerate((CHANNEL, "far"), 1):
        words += [f"--bus{number}-interface", "rrins", f"--bus{number}-channel", channel]
        words += [f"--bus{number}-bus-kwargs", "host=never", "role=observer"]
    with (
        RrinsBus("far", name="far") as far,
        RrinsBus(CHANNEL, host="never", role="observer", name="near") as near,
    ):
        bridge = start("can.bridge", *words, stdout=subprocess.DEVNULL)
        try:
            await_message(far, STATUS.frame_id)
            far.send(can.Message(arbitration_id=0x7E0, is_extended_id=False, data=[1, 2]))
            await_message(near, 0x7E0)
        finally:
            finish(bridge)


@pytest.mark.usefixtures("traffic")
def test_scapy_reads_and_writes() -> None:
    config = pytest.importorskip("scapy.config")
    config.conf.contribs["CANSocket"] = {"use-python-can": True}
    from scapy.contrib.cansocket_python_can import PythonCANSocket
    from scapy.layers.can import CAN

    options = {"interface": "rrins", "channel": CHANNEL, "host": "never", "role": "observer"}
    with PythonCANSocket(**options) as end:
        packet = end.sniff(count=2, timeout=PATIENCE_S)[-1]
        assert packet.identifier == STATUS.frame_id
        assert STATUS.decode(bytes(packet.data))["encoder_angle_deg"] == 90
        with RrinsBus(CHANNEL, host="never", role="observer") as reader:
            end.send(CAN(identifier=0x555, length=2, data=b"\x01\x02"))
            heard = iter(lambda: reader.recv(PATIENCE_S), None)
            message = next(one for one in heard if one.arbitration_id == 0x555)
    assert message.data == b"\x01\x02"


@pytest.mark.usefixtures("traffic")
def test_asammdf_reads_signals_of_a_recording(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "bus.mf4"
    done = start("rrins", "record", path, "--channel", CHANNEL, "--for", "0.5", "--observer")
    assert done.wait(PATIENCE_S) == 0
    with asammdf.MDF(path) as log:
        signals = log.extract_bus_logging(database_files={"CAN": [(str(DBC), 0)]})
        angle = signals.get("AXIS_INNER_STATUS.encoder_angle_deg")
    assert angle.unit == "deg"
    assert set(angle.samples.tolist()) == {90}
    assert len(angle.samples) == pytest.approx(101, abs=1)
