"""The embedded bus on the kernel's vcan0, by python-can's bridge, as docs/attach.md says.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import can
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.interface import RrinsBus

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


@pytest.mark.timeout(200)
def test_frames_go_both_ways(heard: list[int]) -> None:
    first = "--bus1-interface rrins --bus1-channel bridged --bus1-bus-kwargs host=never"
    words = f"{first} role=observer --bus2-interface socketcan --bus2-channel vcan0".split()
    bridge = subprocess.Popen([sys.executable, "-m", "can.bridge", *words])
    try:
        with can.Bus("vcan0", interface="socketcan") as bus:
            message = bus.recv(150)
            assert message is not None
            assert message.arbitration_id == OURS
            while THEIRS not in heard:
                bus.send(can.Message(arbitration_id=THEIRS, is_extended_id=False))
                assert bus.recv(10) is not None
    finally:
        bridge.send_signal(signal.SIGINT)
        bridge.wait(30)
