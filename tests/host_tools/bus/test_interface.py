"""The batch face, the mix of both faces, the clock, and what a host can."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import can
import numpy as np
import pytest

from rrins.dbc.direct import Direct
from rrins.dbc.frame import Frame, FrameArray, frame_array
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.interface import RrinsBus

Attach = Callable[..., RrinsBus]


@pytest.fixture
def host() -> Iterator[RrinsBus]:
    with RrinsBus("test", host="here", name="hardware") as bus:
        yield bus


def numbered(count: int) -> FrameArray:
    frames = frame_array(count)
    frames["can_id"] = np.arange(count) % 0x7FF
    frames["length"] = 8
    frames["data"] = np.arange(count)
    return frames


def timestamp_of(bus: RrinsBus) -> float:
    """Receive a message and return its time stamp."""
    message = bus.recv(5.0)
    assert message is not None
    return message.timestamp


def test_a_batch_arrives_whole(host: RrinsBus, attach_to: Attach) -> None:
    peer = attach_to(host)
    sent, into = numbered(7), frame_array(64)
    host.send_batch(sent, 7, epoch=2**64 - 1, time_ns=-5, closes_epoch=True)
    batch = peer.recv_batch(into, 120.0)
    assert batch is not None
    assert (batch.count, batch.epoch, batch.time_ns) == (7, 2**64 - 1, -5)
    assert (batch.closes_epoch, batch.sender) == (True, 0)
    np.testing.assert_array_equal(into[:7], sent)
    peer.send_batch(sent, 6, epoch=1)
    answer = host.recv_batch(into, 120.0)
    assert answer is not None
    assert (answer.count, answer.epoch, answer.closes_epoch) == (6, 1, False)
    assert answer.sender == host.peers[0].number


def test_an_empty_batch_closes_an_epoch_and_is_no_message(
    host: RrinsBus, attach_to: Attach
) -> None:
    peer = attach_to(host)
    host.send_batch(frame_array(0), 0, epoch=3, closes_epoch=True)
    batch = peer.recv_batch(frame_array(1), 5.0)
    assert batch is not None
    assert (batch.count, batch.epoch, batch.closes_epoch) == (0, 3, True)
    host.send_batch(frame_array(0), 0)
    host.send_batch(numbered(2), 1)
    message = peer.recv(5.0)
    assert message is not None
    assert message.data == bytes(8)


def test_a_long_batch_comes_in_parts(host: RrinsBus, attach_to: Attach) -> None:
    peer = attach_to(host)
    sent, into = numbered(datagram.MAX_FRAMES), frame_array(1000)
    host.send_batch(sent, len(sent), epoch=9, closes_epoch=True)
    parts = []
    while True:
        batch = peer.recv_batch(into, 120.0)
        assert batch is not None
        assert batch.epoch == 9
        parts.append(into[: batch.count].copy())
        if batch.closes_epoch:
            break
    np.testing.assert_array_equal(np.concatenate(parts), sent)
    assert peer.recv_batch(into, 0) is None


def test_messages_and_batches_mix(host: RrinsBus, attach_to: Attach) -> None:
    peer = attach_to(host)
    into = frame_array(8)
    host.send_batch(numbered(4), 4, epoch=6, closes_epoch=True)
    first = peer.recv(5.0)
    assert first is not None
    assert first.arbitration_id == 0
    rest = peer.recv_batch(into, 120.0)
    assert rest is not None
    assert (rest.count, rest.epoch, rest.closes_epoch) == (3, 6, True)
    assert list(into["data"][:3]) == [1, 2, 3]
    peer.send(can.Message(arbitration_id=0x1ABCDE, data=b"\x01\x02"), 5.0)
    single = host.recv_batch(into, 120.0)
    assert single is not None
    assert (single.count, single.epoch, single.closes_epoch) == (1, 0, False)
    assert into[0]["can_id"] == 0x1ABCDE | 0x8000_0000
    assert (into[0]["length"], into[0]["data"]) == (2, 0x0201)


def test_fd_frames_pass_classic_ends_by(host: RrinsBus, attach_to: Attach) -> None:
    fd_bus = attach_to(host, "fd", fd=True)
    classic_bus = attach_to(host, "classic")
    assert fd_bus.protocol is can.CanProtocol.CAN_FD
    host.send(can.Message(data=b"first", is_extended_id=False), 5.0)
    fd_bus.send(can.Message(is_fd=True, data=bytes(64)), 5.0)
    fd_bus.send(can.Message(data=b"last", is_extended_id=False), 5.0)
    received = [classic_bus.recv(5.0)]
    assert host.recv_batch(frame_array(4), 5.0) is not None  # relays both on its way
    received.append(classic_bus.recv(5.0))
    assert [bytes(message.data) for message in received if message] == [b"first", b"last"]
    with pytest.raises(can.CanOperationError, match="fd=True"):
        classic_bus.send(can.Message(is_fd=True), 5.0)


def test_single_messages_carry_the_time_of_the_bus(host: RrinsBus, attach_to: Attach) -> None:
    sender, listener = attach_to(host, "sender"), attach_to(host, "listener")

    def stamp() -> float:
        sender.send(can.Message(), 5.0)
        assert host.recv(5.0) is not None
        message = listener.recv(5.0)
        assert message is not None
        return message.timestamp

    before = time.time()
    assert before - 1 <= stamp() <= time.time() + 1
    host.send_batch(numbered(1), 1, time_ns=0)
    assert listener.recv(5.0) is not None
    assert stamp() == 0.0
    host.send_batch(numbered(1), 1, time_ns=2_500_000_000)
    assert listener.recv(5.0) is not None
    assert stamp() == 2.5


def test_the_clock_leaves_with_its_keeper(host: RrinsBus, attach_to: Attach) -> None:
    keeper = attach_to(host, "keeper")
    keeper.send_batch(numbered(1), 1, time_ns=77)
    assert host.recv_batch(frame_array(1), 5.0) is not None
    keeper.shutdown()
    listener = attach_to(host, "listener")
    assert [peer.name for peer in host.peers] == ["listener"]
    host.send(can.Message(), 5.0)
    message = listener.recv(5.0)
    assert message is not None
    assert abs(message.timestamp - time.time()) < 60


@pytest.mark.parametrize(
    ("frames", "count"),
    [
        (numbered(2), 3),
        (numbered(2), -1),
        (numbered(5000), 5000),
        (numbered(4)[::2], 2),
        (np.zeros(3, np.uint8), 1),
        (np.full(1, 255, np.uint8).repeat(16).view(Frame.dtype), 1),
    ],
    ids=["too many", "negative", "too long", "not contiguous", "other dtype", "payload of 255"],
)
def test_what_is_no_batch_is_not_sent(host: RrinsBus, frames: Any, count: int) -> None:
    with pytest.raises(ValueError, match=r"batch|Frame\.dtype"):
        host.send_batch(frames, count)
    with pytest.raises(ValueError, match="epoch"):
        host.send_batch(numbered(1), 1, epoch=-1)
    host.send_batch(numbered(1), 1)


@pytest.mark.parametrize("payload", [bytearray(b"\1\2\3"), b"\1\2\3", [1, 2, 3]])
@pytest.mark.parametrize("can_id", [0, 0x7FF, 0x800, 0x1FFF_FFFF])
def test_a_message_arrives_as_it_was_and_is_its_receivers_own(
    host: RrinsBus, attach_to: Attach, payload: Any, can_id: int
) -> None:
    peer = attach_to(host)
    sent = can.Message(arbitration_id=can_id, is_extended_id=can_id > 0x7FF)
    sent.data, sent.dlc = payload, 3
    peer.send(sent)
    host.send(sent)
    for received in (host.recv(5.0), peer.recv(5.0)):
        assert received is not None
        expected = can.Message(
            arbitration_id=can_id,
            is_extended_id=can_id > 0x7FF,
            data=b"\1\2\3",
            channel=host.channel,
        )
        assert received.equals(expected, timestamp_delta=None)
        assert isinstance(received.data, bytearray)
        received.data[0] = 9  # nobody else's
    assert list(payload) == [1, 2, 3]


def test_a_message_of_nine_bytes_is_not_sent(host: RrinsBus) -> None:
    with pytest.raises(ValueError, match="9 bytes"):
        host.send(can.Message(data=bytes(9)), 1.0)


def test_unix_time_counts_from_the_power_on_of_the_host(host: RrinsBus, attach_to: Attach) -> None:
    early = attach_to(host, "early", timestamps="unix")
    firmware = attach_to(host, "firmware")
    before_s = time.time()
    firmware.send_batch(numbered(1), 1, time_ns=3_600_000_000_000)  # its own time: it waits
    host.recv_batch(frame_array(8), 5.0)
    host.send_batch(numbered(1), 1, time_ns=5_000_000)
    late = attach_to(host, "late", timestamps="unix", role="observer")
    host.send_batch(numbered(1), 1, time_ns=100_005_000_000)  # faster than real time
    waiting_s, first_s, early_s = (timestamp_of(early) for _ in range(3))
    late_s = timestamp_of(late)
    after_s = time.time()
    assert [timestamp_of(firmware) for _ in range(2)] == [0.005, 100.005]
    assert before_s <= waiting_s <= first_s <= after_s
    assert early_s - first_s == pytest.approx(100, abs=1e-6)
    assert late_s == pytest.approx(early_s, abs=after_s - before_s)
    assert before_s + 100 <= late_s <= after_s + 100


def test_a_batch_is_in_unix_time_as_its_messages_are(host: RrinsBus, attach_to: Attach) -> None:
    peer = attach_to(host, timestamps="unix")
    host.send_batch(numbered(2), 2, time_ns=5_000_000)
    message_s = timestamp_of(peer)
    batch = peer.recv_batch(frame_array(8), 5.0)
    assert batch is not None
    assert batch.time_ns / 1e9 == message_s


def test_time_that_is_unix_time_already_stays(host: RrinsBus, attach_to: Attach) -> None:
    peer = attach_to(host, timestamps="unix")
    recorded_ns = 1_234_567_890_000_000_000  # replayed from a log of another bus
    host.send_batch(numbered(1), 1, time_ns=recorded_ns)
    assert timestamp_of(peer) == recorded_ns / 1e9


@pytest.mark.parametrize(
    "arguments",
    [
        {"host": "there"},
        {"role": "king"},
        {"host": "here", "role": "observer"},
        {"timestamps": "local"},
    ],
)
def test_impossible_arguments_are_refused(arguments: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"may be|host"):
        RrinsBus("test", **arguments)


def test_never_says_what_to_do_without_a_host() -> None:
    with pytest.raises(can.CanInitializationError, match=r"no bus 'nobody'.*host="):
        RrinsBus("nobody", host="never")


def test_a_channel_has_one_host(host: RrinsBus) -> None:
    with pytest.raises(can.CanInitializationError, match=f"hosted by process {os.getpid()}"):
        RrinsBus("test", host="here")


def test_the_host_sees_who_is_attached(host: RrinsBus, attach_to: Attach) -> None:
    firmware = attach_to(host, "firmware", exclusive=True)
    attach_to(host, "monitor", role="observer")
    seen = [(peer.name, peer.pid, peer.role) for peer in host.peers]
    assert seen == [("firmware", os.getpid(), "node"), ("monitor", os.getpid(), "observer")]
    with pytest.raises(can.CanOperationError, match="only the host"):
        _ = firmware.peers


def test_compiled_code_is_lent_a_side_and_one_listener(host: RrinsBus, attach_to: Attach) -> None:
    lent = Direct.zeros()
    attach_to(host, "recorder")
    host.send_batch(numbered(1), 1)
    assert not host.lend(lent[0])
    attach_to(host, "firmware")
    assert host.lend(lent[0])
    assert -1 != lent[0].listener != lent[0].fd
    attach_to(host, "monitor", role="observer")
    assert not host.lend(lent[0])


def test_a_required_peer_that_leaves_is_named(host: RrinsBus, attach_to: Attach) -> None:
    with pytest.raises(can.CanOperationError, match="'firmware' is not attached"):
        host.require(["firmware"])
    firmware = attach_to(host, "firmware")
    host.require(["firmware"])
    states = [host.state]
    firmware.send_batch(numbered(2), 2, epoch=4)
    firmware.shutdown()
    into = frame_array(4)
    batch = host.recv_batch(into, 120.0)
    assert batch is not None  # what it sent before is not lost
    assert batch.epoch == 4
    for _ in range(2):
        with pytest.raises(can.CanOperationError, match=r"node 'firmware'.*has left"):
            host.recv_batch(into, 120.0)
        with pytest.raises(can.CanOperationError, match=r"node 'firmware'.*has left"):
            host.send_batch(into, 1)
    states.append(host.state)
    host.require([])
    host.send_batch(into, 1)
    states.append(host.state)
    assert states == [can.BusState.ACTIVE, can.BusState.ERROR, can.BusState.ACTIVE]


def test_waiting_for_nobody_ends_in_time(host: RrinsBus) -> None:
    with pytest.raises(can.CanTimeoutError, match="'firmware' has not attached"):
        host.wait_for("firmware", 0.02)


def test_a_host_that_closes_says_so(host: RrinsBus, attach_to: Attach) -> None:
    peer = attach_to(host)
    host.send_batch(numbered(3), 3)
    host.shutdown()
    assert peer.recv_batch(frame_array(3), 5.0) is not None
    for _ in range(2):
        with pytest.raises(can.CanOperationError, match=f"process {os.getpid()} has closed it"):
            peer.recv(5.0)
        with pytest.raises(can.CanOperationError, match="has closed it"):
            peer.send(can.Message(), 1.0)
    assert peer.state is can.BusState.ERROR


def test_a_host_that_only_sends_lets_others_in(
    host: RrinsBus, start_player: Callable[[], Any]
) -> None:
    player = start_player()
    player.tell("open", channel="test", host="never", name="late")
    while not host.peers:
        host.send(can.Message(), 1.0)
    assert player.answer() == os.getpid()


def test_a_node_that_does_not_receive_holds_the_bus_and_loses_nothing(
    host: RrinsBus, attach_to: Attach
) -> None:
    peer = attach_to(host)
    frames, sent = numbered(1), 0

    def send_on() -> None:
        nonlocal sent
        while True:
            frames["data"] = sent
            host.send_batch(frames, 1, timeout=0.01)
            sent += 1

    with pytest.raises(can.CanTimeoutError, match="held up by node 'peer'"):
        send_on()
    for expected in range(sent):
        assert peer.recv_batch(frames, 120.0) is not None
        assert frames["data"][0] == expected
        if expected == sent - 2:
            host.recv_batch(frame_array(1), 0)  # gives the peer what was held
    assert peer.recv_batch(frames, 0) is None


def test_a_receiving_thread_comes_back_when_its_bus_is_shut_down(
    host: RrinsBus, attach_to: Attach
) -> None:
    peer = attach_to(host)
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(bus.recv, None) for bus in (peer, host)]
        peer.shutdown()
        host.shutdown()
        for future in waiting:
            with pytest.raises(can.CanOperationError, match="shut down"):
                future.result(5)
