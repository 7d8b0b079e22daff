"""A log replayed onto a bus: the frames that were asked for, in order, when they are due."""

from __future__ import annotations

import threading

import can
import numpy as np
import pytest

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.address import Address
from rrins.host_tools.errors import BusError
from rrins.host_tools.logs import playback
from rrins.host_tools.logs.playback import Playback, identifiers_of
from rrins.host_tools.logs.reader import Log, Piece
from rrins.host_tools.recording.errors import RecordError

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


@pytest.mark.parametrize("ending", [".log", ".log.gz", ".asc", ".blf", ".mf4", ".db"])
def test_all_frames_come_in_order_and_as_they_were(recordings, read, heard, ending):
    player = Playback(ADDRESS, None)
    player.play(Log(recordings(ending).path))
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


class SlowLog:
    """A log in pieces; `before` is called with the number of each before it is read."""

    def __init__(self, pieces, before=lambda number: None):
        self.pieces_read = [Piece(frames_at(times_s), np.array(times_s)) for times_s in pieces]
        self.before = before

    def pieces(self, size):
        for number, piece in enumerate(self.pieces_read):
            self.before(number)
            yield piece


def frames_at(times_s):
    frames = frame_array(len(times_s))
    frames["can_id"] = 0x10
    return frames


def test_what_it_takes_to_begin_to_read_delays_the_log_and_hurries_nothing(clock, monkeypatch):
    bus = TimedBus(clock)
    monkeypatch.setattr(playback, "open_bus", lambda address: bus)
    player = Playback(ADDRESS)
    for begin_s in (0.0, 10.0):  # each time that it is played
        clock.now = 100.0 + begin_s

        def open_slowly(number):
            if number == 0:
                clock.now += 0.5

        player.play(SlowLog([[3.0, 3.1, 3.2]], open_slowly))
        sent = [now for now, _ in bus.sent[-3:]]
        assert sent == pytest.approx([begin_s + 0.5, begin_s + 0.6, begin_s + 0.7])
    player.close()
    assert player.played.latest_s < 1e-6


def test_the_log_is_read_ahead_of_what_is_due(clock, monkeypatch):
    is_read = threading.Event()

    class WaitingBus(TimedBus):
        def send(self, message, timeout):
            assert is_read.wait(10), "nothing is read while frames wait to be sent"
            super().send(message, timeout)

    bus = WaitingBus(clock)
    monkeypatch.setattr(playback, "open_bus", lambda address: bus)
    player = Playback(ADDRESS)
    pieces = [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
    player.play(SlowLog(pieces, lambda number: is_read.set() if number == 2 else None))
    player.close()
    assert [time_s for _, time_s in bus.sent] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_frames_of_one_time_are_sent_together_wherever_the_log_is_cut():
    player = Playback(Address("rrins", "together"), None)
    with can.Bus(interface="rrins", channel="together", host="never") as bus:
        player.play(SlowLog([[0.0, 1.0], [1.0], [1.0, 2.0], [2.0]]))
        into = frame_array(16)
        batches = []
        for _ in range(3):
            batch = bus.recv_batch(into, 5.0)
            batches.append((batch.time_ns / 1e9, batch.count))
    player.close()
    assert batches == [(0.0, 1), (1.0, 3), (2.0, 2)]


def test_an_error_of_the_reader_reaches_who_plays(heard):
    def fail(number):
        if number == 2:
            raise RecordError("the disk is gone")

    player = Playback(ADDRESS, None)
    with pytest.raises(RecordError, match="the disk is gone"):
        player.play(SlowLog([[0.0], [1.0], [2.0]], fail))
    player.close()
    assert not readers()


def test_nothing_is_read_on_when_the_bus_has_failed(recordings, monkeypatch, clock):
    class BrokenBus(TimedBus):
        def send(self, message, timeout):
            raise can.CanOperationError("unplugged")

    monkeypatch.setattr(playback, "open_bus", lambda address: BrokenBus(clock))
    player = Playback(ADDRESS, None)
    with pytest.raises(BusError, match="unplugged"):
        player.play(Log(recordings(".blf").path))
    player.close()
    assert not readers()


def readers():
    return [thread for thread in threading.enumerate() if thread.name == playback.READER]


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
