"""The embedded bus on the kernel's vcan0, by python-can's bridge, as docs/attach.md says.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from multiprocessing.synchronize import Event
from pathlib import Path

import can
import can.bridge
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.interface import RrinsBus
from tests.socketcan.conftest import forked

OURS, THEIRS = 0x010, 0x7E0


@pytest.fixture
def heard() -> Iterator[list[int]]:
    """Frames that the host of a bus receives, while it sends one every 5 ms."""
    frames, received = frame_array(1), []
    frames["can_id"] = OURS
    is_there, has_ended = threading.Event(), threading.Event()

    def host() -> None:
        with RrinsBus("bridged", host="here") as bus:
            is_there.set()
            while not has_ended.is_set():
                bus.send_batch(frames, 1)
                message = bus.recv(0.005)
                if message is not None:
                    received.append(message.arbitration_id)

    thread = threading.Thread(target=host)
    thread.start()
    is_there.wait()
    yield received
    has_ended.set()
    thread.join()


@pytest.fixture
def cross(tmp_path: Path) -> Iterator[Event]:
    """What lets python-can's bridge begin: a fork, which there is before there are threads."""
    may_begin = multiprocessing.get_context("fork").Event()

    def main() -> None:
        may_begin.wait()
        can.bridge.main()

    first = "--bus1-interface rrins --bus1-channel bridged --bus1-bus-kwargs host=never"
    words = f"{first} role=observer --bus2-interface socketcan --bus2-channel vcan0".split()
    process = forked(main, ["can.bridge", *words], tmp_path / "said.txt")
    yield may_begin
    os.kill(process.pid, signal.SIGINT)
    process.join(30)
    process.kill()


@pytest.mark.timeout(200)
def test_frames_go_both_ways(cross: Event, heard: list[int]) -> None:
    cross.set()
    with can.Bus("vcan0", interface="socketcan") as bus:
        message = bus.recv(150)
        assert message is not None
        assert message.arbitration_id == OURS
        while THEIRS not in heard:
            bus.send(can.Message(arbitration_id=THEIRS, is_extended_id=False))
            assert bus.recv(10) is not None
