"""The embedded bus behind an emulated slcan adapter, with python-can's own slcan interface."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import can
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bridges.slcan_bus import BUFFER_BYTES, command_of, datagram_of
from rrins.host_tools.bus.interface import RrinsBus

MESSAGES = [
    can.Message(arbitration_id=0x123, data=b"\x01\xab", is_extended_id=False),
    can.Message(arbitration_id=0x1ABCDEF0, data=bytes(range(8)), is_extended_id=True),
    can.Message(arbitration_id=0x7FF, is_remote_frame=True, dlc=4, is_extended_id=False),
    can.Message(arbitration_id=0, is_extended_id=False),
]


@pytest.fixture
def bus():
    with RrinsBus("slcan", name="node") as node:
        yield node


@pytest.fixture
def server(bus, start):
    command = start("slcan", "--channel", "slcan", "--link", "adapter")
    command.wait_for_line("Ctrl-C stops")
    command.port = re.search(r"on (\S+) \(adapter\)", command.said[-1])[1]
    yield command
    if command.process.poll() is None:
        end(command)


def end(command):
    command.process.send_signal(signal.SIGINT)
    assert command.finish()[0] == 130


def open_bus(port):
    return can.Bus(interface="slcan", channel=port, bitrate=1_000_000, sleep_after_open=0)


def until_open(bus, other):
    """Send until the other end has opened its channel."""
    while other.recv(0.01) is None:
        bus.send(can.Message(arbitration_id=1, is_extended_id=False))
    while other.recv(0.2) is not None:
        pass


def test_frames_pass_both_ways_and_programs_come_and_go(bus, server, tmp_path):
    assert str((tmp_path / "adapter").readlink()) == server.port
    for _ in range(2):
        with open_bus(server.port) as other:
            until_open(bus, other)
            for sender, receiver in ((bus, other), (other, bus)):
                for message in MESSAGES:
                    sender.send(message)
                    came = receiver.recv(5)
                    assert came is not None
                    assert came.equals(
                        message, timestamp_delta=None, check_channel=False, check_direction=False
                    )


def test_what_is_not_read_is_lost_and_slows_nobody(bus, server):
    frames = frame_array(4000)
    frames["length"] = 8
    descriptor = os.open(server.port, os.O_RDWR | os.O_NOCTTY)
    os.write(descriptor, b"O\r")
    assert os.read(descriptor, 1) == b"\r"
    for _ in range(4):
        bus.send_batch(frames, len(frames), timeout=120.0)
    heard = os.read(descriptor, 1)
    os.write(descriptor, b"t12301\rC\rV\r")  # it still obeys
    while not heard.endswith(b"V1013\r"):
        heard += os.read(descriptor, 65536)
    os.close(descriptor)
    read = heard.count(b"t00080000000000000000\r")
    end(server)
    told = re.fullmatch(
        r"rrins: (\d+) frames were lost: the program read too slowly", server.said[-2]
    )
    assert 0 < int(told[1]) <= 16_000 - read
    assert read > BUFFER_BYTES / 22


@pytest.mark.parametrize("message", MESSAGES)
def test_a_frame_is_told_and_read_as_the_protocol_says(message):
    known = {0x123: b"t123201AB", 0x1ABCDEF0: b"T1ABCDEF080001020304050607"}
    known |= {0x7FF: b"r7FF4", 0: b"t0000"}
    command = known[message.arbitration_id]
    raw = bytes(datagram_of(command, 3))[32:]
    identifier, length, data = int.from_bytes(raw[:4], "little"), raw[4], raw[8:16]
    assert identifier & 0x1FFF_FFFF == message.arbitration_id
    assert (length, data[: len(message.data)]) == (message.dlc, bytes(message.data))
    assert command_of(identifier, length, data) == command


def test_it_ends_with_the_bus_and_leaves_no_link(bus, start, tmp_path):
    command = start("slcan", "--channel", "nobody")
    assert command.finish()[0] == 4
    assert "nobody hosts channel 'nobody'" in command.said[-1]
    (tmp_path / "taken").write_text("")
    command = start("slcan", "--channel", "slcan", "--link", "taken")
    assert command.finish()[0] == 4
    assert command.said == ["rrins: pty:taken: cannot be linked: File exists"]
    assert Path(tmp_path / "taken").is_file()
