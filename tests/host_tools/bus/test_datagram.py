"""Malformed datagrams: one error for all of them, and the cut-off of whoever sent one."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable, Iterator

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import connect
from rrins.host_tools.bus.interface import RrinsBus

_FIELDS = {
    "magic": st.sampled_from([datagram.MAGIC, datagram.MAGIC, datagram.MAGIC, 0]),
    "kind": st.integers(0, 8),
    "flags": st.integers(0, 255) | st.integers(0, 3),
    "count": st.integers(0, 20) | st.integers(0, 65535),
    "sender": st.integers(0, 3) | st.integers(0, 2**32 - 1),
    "reserved": st.sampled_from([0, 0, 0, 1]),
    "epoch": st.integers(0, 2**64 - 1),
    "time_ns": st.integers(-(2**63), 2**63 - 1),
}


@st.composite
def almost_datagrams(draw: st.DrawFn) -> bytes:
    """Headers of which each field may be wrong, with bodies that often have the right length."""
    fields = [draw(strategy) for strategy in _FIELDS.values()]
    size = min(2_000, {5: 16, 6: 72}.get(fields[1], 1) * fields[3])
    body = draw(st.binary(max_size=64) | st.sampled_from([bytes(size), b"\x09" * size]))
    return datagram.HEADER.pack(*fields) + body


anything = almost_datagrams() | st.binary(min_size=1, max_size=200)


def well_formed(data: bytes | bytearray) -> bool:
    """The format's own words, written a second time."""
    if len(data) < 32 or len(data) > 65536:
        return False
    magic, kind, flags, count, _, reserved, _, _ = datagram.HEADER.unpack_from(data)
    if magic != datagram.MAGIC or reserved:
        return False
    body = data[32:]
    if kind in (1, 2, 3, 4, 7, 8):
        return bool(len(body) == count <= 512 and flags <= 15)
    if kind not in (5, 6) or flags > 3:
        return False
    size, most = {5: (16, 8), 6: (72, 64)}[kind]
    return len(body) == count * size and all(body[i * size + 4] <= most for i in range(count))


@settings(max_examples=10 * settings.default.max_examples, deadline=None)
@given(anything)
def test_a_datagram_is_read_or_rejected(data: bytes) -> None:
    if well_formed(data):
        fields = datagram.HEADER.unpack_from(data)
        assert datagram.parse(bytearray(data), len(data)) == (*fields[1:5], *fields[6:])
    else:
        with pytest.raises(datagram.ProtocolError):
            datagram.parse(bytearray(data), len(data))


@pytest.mark.parametrize(
    ("kind", "count", "size"),
    [
        (datagram.FRAMES, datagram.MAX_FRAMES + 1, 16),
        (datagram.FRAMES_FD, datagram.MAX_FD_FRAMES + 1, 72),
        (datagram.BYE, datagram.MAX_TEXT + 1, 1),
    ],
)
def test_a_datagram_has_a_longest_length(kind: int, count: int, size: int) -> None:
    for number, is_fine in ((count - 1, True), (count, False)):
        data = bytearray(datagram.HEADER_SIZE + number * size)
        datagram.put_header(data, kind, 0, number, 0, 0, 0)
        assert well_formed(data) is is_fine
        if is_fine:
            assert datagram.parse(data, len(data))[0] == kind
        else:
            with pytest.raises(datagram.ProtocolError):
                datagram.parse(data, len(data))


def test_the_header_is_what_the_table_says() -> None:
    buffer = bytearray(32)
    datagram.put_header(buffer, datagram.FRAMES, 1, 2, 3, 4, 5)
    assert buffer.hex(" ", 4) == (
        "52524231 05010200 03000000 00000000 04000000 00000000 05000000 00000000"
    )
    datagram.put_time(buffer, 3, -1)
    assert buffer[5] == 1
    assert datagram.time_of(buffer) == -1


def _say_hello(host: RrinsBus, name: str) -> socket.socket:
    """Attach by hand, with nothing but a socket."""
    end = connect(host.channel, 5.0)
    end.send(datagram.control(datagram.HELLO, name))
    host.wait_for(name, 5.0)
    assert end.recv(1000)[4] == datagram.WELCOME
    return end


def _is_over(end: socket.socket) -> bool:
    poll = select.poll()
    poll.register(end, 0)
    return bool(poll.poll(0))


@settings(
    max_examples=4 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=anything)
def test_whatever_a_peer_sends_the_host_goes_on(hub: RrinsBus, data: bytes) -> None:
    with _say_hello(hub, "stranger") as end:
        number = hub.peers[-1].number
        end.send(data)
        into = frame_array(64)
        batch = hub.recv_batch(into, 0)
        fields = datagram.HEADER.unpack_from(data) if len(data) >= 32 else None
        if well_formed(data) and fields and fields[1] >= 5 and fields[4] == number:
            assert not _is_over(end)
            assert fields[1] == 6 or (batch is not None and batch.sender == number)
        else:
            assert batch is None
            assert _is_over(end)
    while hub.peers:
        hub.recv_batch(into, 0)


@settings(
    max_examples=2 * settings.default.max_examples,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=anything)
def test_whatever_a_caller_says_the_host_goes_on(hub: RrinsBus, data: bytes) -> None:
    with connect(hub.channel, 5.0) as end:
        end.send(data)
        while hub.recv_batch(frame_array(1), 0) is not None:
            pass
        is_hello = well_formed(data) and data[4] == datagram.HELLO
        name = data[32:].decode(errors="replace")
        is_name = 1 <= len(name) <= 64 and all("!" <= letter <= "~" for letter in name)
        assert bool(hub.peers) == (is_hello and is_name)
        if not hub.peers:
            assert _is_over(end)
    while hub.peers:
        hub.recv_batch(frame_array(1), 0)


@pytest.fixture
def hub() -> Iterator[RrinsBus]:
    with RrinsBus("test", host="here") as bus:
        yield bus


def test_a_cut_off_peer_is_told_and_the_others_are_not(
    hub: RrinsBus, attach_to: Callable[..., RrinsBus], caplog: pytest.LogCaptureFixture
) -> None:
    peer = attach_to(hub)
    with _say_hello(hub, "stranger") as end:
        end.send(b"not a datagram")
        assert hub.recv(0) is None
        farewell = end.recv(1000)
        assert farewell[4] == datagram.BYE
        assert b"this peer was cut off" in farewell
        assert end.recv(1000) == b""
    assert len(caplog.records) == 1
    hub.send(can.Message(), 1.0)
    assert peer.recv(5.0) is not None
