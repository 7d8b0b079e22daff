"""The C client against the host in Python, with the sanitizers of gcc."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.interface import RrinsBus

ECHO = Path(__file__).with_name("echo.c")
EPOCHS = 200


@pytest.fixture
def echo(build: Callable[[Path], Path]) -> Path:
    return build(ECHO)


def start(program: Path, channel: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [program, channel], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_batches_go_there_and_back_whole_and_in_order(echo: Path, tmp_path: Path) -> None:
    channel = tmp_path / "bus.sock"
    program = start(echo, channel)  # waits for the host
    frames, answer = frame_array(datagram.MAX_FRAMES), frame_array(datagram.MAX_FRAMES)
    with RrinsBus(channel=str(channel), host="here", name="hardware", exclusive=True) as bus:
        bus.wait_for("firmware", 10)
        for epoch in range(EPOCHS):
            count = (epoch * 37) % datagram.MAX_FRAMES
            frames["can_id"][:count] = range(count)
            frames["length"][:count] = epoch % 9
            frames["data"][:count] = epoch
            time_ns = epoch * 5_000_000
            bus.send_batch(frames, count, epoch=epoch, time_ns=time_ns, closes_epoch=True)
            batch = bus.recv_batch(answer, 10)
            assert batch is not None
            assert (batch.epoch, batch.time_ns, batch.count) == (epoch, time_ns, count)
            assert batch.closes_epoch
            frames["can_id"][:count] += 1
            assert answer[:count].tobytes() == frames[:count].tobytes()
    said, faults = program.communicate(timeout=120.0)
    assert program.returncode == 0, faults
    assert "has closed it" in said


def test_two_ends_that_send_at_once_wait_for_room_and_lose_nothing(
    echo: Path, tmp_path: Path
) -> None:
    channel = tmp_path / "bus.sock"
    program = start(echo, channel)
    frames = frame_array(datagram.MAX_FRAMES)
    received: list[int] = []
    with RrinsBus(channel=str(channel), host="here", name="hardware") as bus:
        bus.wait_for("firmware", 10)

        def send() -> None:
            for epoch in range(EPOCHS):
                bus.send_batch(frames, len(frames), epoch=epoch, time_ns=0, closes_epoch=True)

        sender = threading.Thread(target=send)
        sender.start()
        answer = frame_array(datagram.MAX_FRAMES)
        while len(received) < EPOCHS:
            batch = bus.recv_batch(answer, 10)
            assert batch is not None
            received.append(batch.epoch)
        sender.join()
    _, faults = program.communicate(timeout=120.0)
    assert program.returncode == 0, faults
    assert received == list(range(EPOCHS))


def test_a_refusal_is_one_line(echo: Path, tmp_path: Path) -> None:
    channel = tmp_path / "bus.sock"
    with RrinsBus(channel=str(channel), host="here", name="firmware", exclusive=True) as bus:
        program = start(echo, channel)
        while program.poll() is None:
            bus.recv(0.01)
        said, faults = program.communicate(timeout=120.0)
    assert program.returncode == 1, faults
    assert "the name 'firmware' on channel" in said
    assert said.count("\n") == 1


def test_a_host_that_disappears_is_the_end(echo: Path, tmp_path: Path) -> None:
    channel = tmp_path / "bus.sock"
    program = start(echo, channel)
    bus = RrinsBus(channel=str(channel), host="here", name="hardware")
    bus.wait_for("firmware", 10)
    bus.shutdown()
    said, faults = program.communicate(timeout=120.0)
    assert program.returncode == 0, faults
    assert said.startswith(f"channel {channel}: process ")
