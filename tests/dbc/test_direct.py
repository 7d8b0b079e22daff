"""Batches to and from a socket in compiled code, against the format that Python writes."""

from __future__ import annotations

import socket

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.dbc import direct
from rrins.dbc.direct import NOTHING, WORDS, Direct
from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import datagram

pytestmark = pytest.mark.skipif(not direct.AVAILABLE, reason="nothing is compiled")

OWN, OTHER = 0, 7
FRAME = st.tuples(st.integers(0, 0x7FF), st.integers(0, 8), st.integers(0, 2**64 - 1))


@pytest.fixture
def line():
    """Return a record for one end of a line, and the other end, which belongs to Python."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    lent = Direct.zeros()
    lent[0].fd, lent[0].door, lent[0].listener = ends[0].fileno(), -1, -1
    lent[0].opening = np.uint64(datagram.first_word(datagram.FRAMES, datagram.CLOSES_EPOCH))
    lent[0].own, lent[0].other = np.uint64(OWN), np.uint64(OTHER)
    with ends[0], ends[1]:
        yield lent[0], ends[1]


def written(frames, sender, epoch, time_ns, flags=datagram.CLOSES_EPOCH, kind=datagram.FRAMES):
    """Return a datagram as Python writes it."""
    buffer = bytearray(datagram.HEADER_SIZE)
    datagram.put_header(buffer, kind, flags, len(frames), sender, epoch, time_ns)
    return bytes(buffer) + frames.tobytes()


def array_of(values):
    frames = frame_array(len(values))
    for frame, (can_id, length, data) in zip(frames, values, strict=True):
        frame["can_id"], frame["length"], frame["data"] = can_id, length, data
    return frames


def words():
    return np.zeros(WORDS, dtype=np.uint64)


@given(values=st.lists(FRAME, max_size=40), epoch=st.integers(0, 2**40))
@settings(max_examples=50, deadline=None)
def test_what_is_sent_is_what_python_writes(values, epoch):
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    lent = Direct.zeros()
    lent[0].fd, lent[0].door, lent[0].listener = ends[0].fileno(), -1, -1
    lent[0].opening = np.uint64(datagram.first_word(datagram.FRAMES, datagram.CLOSES_EPOCH))
    lent[0].own, lent[0].other = np.uint64(OTHER), np.uint64(OTHER)
    frames = array_of(values)
    with ends[0], ends[1]:
        assert direct.send(lent[0], words(), frames, len(frames), epoch, 5 * epoch)
        sent = ends[1].recv(70_000)
        assert sent == written(frames, OTHER, epoch, 5 * epoch)
        ends[1].send(sent)
        taken = frame_array(64)
        assert direct.receive(lent[0], words(), taken) == len(frames)
        assert taken[: len(frames)].tobytes() == frames.tobytes()
        assert lent[0].time_ns == 5 * epoch


ONE = array_of([(0x123, 8, 5)])
LONG = written(array_of([(0x123, 8, 5)]), OTHER, 1, 1)[:-12] + b"\x09" + bytes(11)
LEFT_TO_PYTHON = {
    "does not close the epoch": written(ONE, OTHER, 1, 1, flags=0),
    "of somebody else": written(ONE, OTHER + 1, 1, 1),
    "a last word": datagram.control(datagram.BYE, sender=OTHER),
    "another program's": b"X" * 48,
    "too short": written(ONE, OTHER, 1, 1)[:-1],
    "a frame of nine bytes": LONG,
    "more than there is room for": written(frame_array(65), OTHER, 1, 1),
}


@pytest.mark.parametrize("data", LEFT_TO_PYTHON.values(), ids=LEFT_TO_PYTHON)
def test_whatever_else_comes_is_left_to_python_whole(line, data):
    lent, other = line
    other.send(data)
    room = words()
    assert direct.receive(lent, room, frame_array(64)) == NOTHING
    assert room.tobytes()[: lent.left_over] == data


TAKEN = {
    "closes an epoch": written(ONE, OTHER, 3, 15),
    "does not close an epoch": written(ONE, OTHER + 5, 3, 15, flags=0),
    "of a clock before zero": written(ONE, OWN, 3, -15),
    "without frames": written(ONE[:0], OTHER, 3, 15),
}


@pytest.mark.parametrize("data", TAKEN.values(), ids=TAKEN)
def test_an_observer_takes_the_batches_of_anybody(line, data):
    lent, other = line
    other.send(data)
    room, taken = words(), frame_array(64)
    count = direct.take(lent, room, taken)
    assert taken[:count].tobytes() == data[datagram.HEADER_SIZE :]
    assert int(np.int64(room[direct.TIME_WORD])) == datagram.time_of(bytearray(data))
    assert lent.left_over == 0
    assert direct.take(lent, room, taken) == NOTHING  # and does not wait
    assert lent.left_over == 0


@pytest.mark.parametrize(
    "data",
    [
        written(ONE, OTHER, 1, 1, flags=datagram.UNSTAMPED),
        written(frame_array(3), OTHER, 1, 1, kind=datagram.FRAMES_FD),
        *(LEFT_TO_PYTHON[what] for what in list(LEFT_TO_PYTHON)[2:]),
    ],
)
def test_an_observer_leaves_all_else_to_python_whole(line, data):
    lent, other = line
    other.send(data)
    room = words()
    assert direct.take(lent, room, frame_array(64)) == NOTHING
    assert room.tobytes()[: lent.left_over] == data


def test_an_end_or_an_open_door_is_left_to_python(line):
    lent, other = line
    guest, door = socket.socketpair()
    with guest, door:
        lent.door = door.fileno()
        other.send(written(ONE, OTHER, 1, 1))
        guest.send(b"!")
        assert direct.receive(lent, words(), frame_array(64)) == NOTHING
        assert lent.left_over == 0  # not yet received
        lent.door = -1
        assert direct.receive(lent, words(), frame_array(64)) == 1
    other.close()
    assert direct.receive(lent, words(), frame_array(64)) == NOTHING
    assert lent.left_over == 0


def test_a_listener_gets_what_either_side_sends(line):
    lent, other = line
    ears, listener = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ears, listener:
        lent.listener = ears.fileno()
        answer, room, frames = written(ONE, OTHER, 1, 1), words(), frame_array(64)
        assert direct.send(lent, room, ONE, 1, 1, 5)
        other.send(answer)
        assert direct.receive(lent, room, frames) == 1
        assert [listener.recv(99), listener.recv(99)] == [other.recv(99), answer]
        while direct.send(lent, room, frames, 64, 0, 0):  # until it has no more room
            other.recv(70_000)
        with pytest.raises(BlockingIOError):
            other.recv(9, socket.MSG_DONTWAIT)
        other.send(answer)
        assert direct.receive(lent, room, frames) == NOTHING
        assert room.tobytes()[: lent.left_over] == answer
        listener.send(b"!")
        assert direct.receive(lent, room, frames) == NOTHING


def test_a_socket_that_is_full_takes_nothing(line):
    lent, other = line
    room, frames = words(), frame_array(64)
    sent = 0
    while direct.send(lent, room, frames, 64, sent, 0):
        sent += 1
    assert sent > 1
    for epoch in range(sent):
        assert int.from_bytes(other.recv(70_000)[16:24], "little") == epoch
