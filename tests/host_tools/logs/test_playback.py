"""A log replayed onto a bus: the frames that were asked for, in order, when they are due."""

from __future__ import annotations

import can
import numpy as np
import pytest

from dbc.codec import load
from host_tools.errors import BusError
from host_tools.logs import playback
from host_tools.logs.playback import Playback, identifiers_of
from host_tools.logs.reader import Log
from host_tools.port import Address

ADDRESS = Address("virtual", "playback")


class Clock:
    """Time that passes only while somebody sleeps."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(playback, "time", clock)
    return clock


@pytest.fixture
def heard():
    """Return a function that gives what has been sent since."""
    bus = can.Bus(interface="virtual", channel="playback")

    def take():
        found = []
        while message := bus.recv(0):
            found.append(message)
        return found

    yield take
    bus.shutdown()


def test_all_frames_come_in_order_and_as_they_were(recordings, read, heard):
    player = Playback(ADDRESS, None)
    player.play(Log(recordings().path))
    player.close()
    frames = read(recordings().path).frames
    messages = heard()
    assert [m.arbitration_id for m in messages] == frames["can_id"].tolist()
    words = [int.from_bytes(m.data, "little") for m in messages]
    assert words == frames["data"].tolist()
    assert player.played.frames == len(frames)


class TimedBus:
    """A bus that notes when each message is sent."""

    def __init__(self, clock):
        self.clock = clock
        self.sent = []

    def send(self, message, timeout):
        self.sent.append((self.clock.now - 100.0, message.timestamp))

    def recv(self, timeout):
        return None

    def shutdown(self):
        pass


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_frames_come_when_they_are_due(recordings, clock, monkeypatch, speed):
    bus = TimedBus(clock)
    monkeypatch.setattr(playback, "open_bus", lambda address: bus)
    player = Playback(ADDRESS, speed)
    player.play(Log(recordings().path))
    player.play(Log(recordings().path))  # as often as one likes
    player.close()
    due = np.array([time_s for _, time_s in bus.sent]) / speed
    again = len(due) // 2
    due[again:] += due[again - 1]
    assert np.allclose([now for now, _ in bus.sent], due, atol=1e-6)
    assert player.played.latest_s < 1e-6


def test_a_clock_that_goes_back_is_not_waited_for(recordings, read, write_candump, clock, tmp_path):
    piece = read(recordings().path)
    time_s = piece.time_s.copy()
    time_s[time_s > 1.0] -= 0.9
    path = tmp_path / "back.log"
    write_candump(path, piece.frames, time_s)
    player = Playback(ADDRESS)
    player.play(Log(path))
    player.close()
    assert clock.now - 100.0 == pytest.approx(time_s.max())


def test_only_one_side_is_sent(recordings, read, heard):
    codec = load()
    firmware = {m.frame_id for m in codec.database.messages if "FIRMWARE" in m.senders}
    for words, wanted in (
        (["hardware"], lambda name: name not in firmware),
        (["firmware"], lambda name: name in firmware),
        (["SENSOR_*", "SYNC"], lambda name: name == 0x10 or 0x40 <= name <= 0x4F),
    ):
        player = Playback(ADDRESS, None, identifiers_of(words))
        player.play(Log(recordings().path))
        player.close()
        expected = [i for i in read(recordings().path).frames["can_id"].tolist() if wanted(i)]
        assert [message.arbitration_id for message in heard()] == expected


def test_the_embedded_bus_keeps_the_time_of_the_log(recordings, read, write_candump, tmp_path):
    piece = read(recordings().path)
    path = tmp_path / "begin.log"
    write_candump(path, piece.frames[:9], np.full(9, 12.5))
    player = Playback(Address("rrins", "replayed"), None)  # nobody hosts it: it is begun
    with can.Bus(interface="rrins", channel="replayed", host="never") as bus:
        player.play(Log(path))
        messages = [bus.recv(5.0) for _ in range(9)]
    player.close()
    assert [m.timestamp for m in messages] == [12.5] * 9
    assert [m.arbitration_id for m in messages] == piece.frames["can_id"][:9].tolist()


def test_a_bus_that_is_not_there_is_one_line():
    with pytest.raises(BusError, match="cannot be opened"):
        Playback(Address("nonsense", "x"))
