"""Rights of third parties on a bus: the host knows who sends."""

from __future__ import annotations

import contextlib
import logging
import select
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from rrins.dbc.codec import load
from rrins.dbc.frame import ERR_FLAG, frame_array
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import connect
from rrins.host_tools.bus.guard import BURST, FRAMES_PER_EPOCH, LARGEST_BATCH
from rrins.host_tools.bus.interface import RrinsBus

Attach = Callable[..., RrinsBus]

SYNC, SENSOR, COMMAND = (load().frame_id(n) for n in ("SYNC", "SENSOR_1", "AXIS_OUTER_COMMAND"))
REQUEST, UNKNOWN = load().frame_id("DIAG_REQUEST"), 0x321


@pytest.fixture
def host() -> Iterator[RrinsBus]:
    with RrinsBus("test", host="here", name="hardware", exclusive=True) as bus:
        yield bus


@pytest.fixture
def firmware(host: RrinsBus, attach_to: Attach) -> RrinsBus:
    return attach_to(host, "firmware", exclusive=True)


@pytest.fixture
def other(host: RrinsBus, firmware: RrinsBus, attach_to: Attach) -> RrinsBus:
    return attach_to(host, "other")


def send(bus: RrinsBus, *identifiers: int, **batch: object) -> None:
    """Send a batch of frames with these identifiers."""
    frames = frame_array(len(identifiers))
    frames["can_id"], frames["length"] = identifiers, 8
    bus.send_batch(frames, len(identifiers), **batch)  # type: ignore[arg-type]  # of several types


def heard(bus: RrinsBus, host: RrinsBus | None = None) -> list[int]:
    """Return the identifiers of all frames that are there; `host` serves before."""
    if host is not None:
        while host.recv(0.02) is not None:
            pass
    return [message.arbitration_id for message in iter(lambda: bus.recv(0), None)]


def test_what_is_a_sides_is_taken_from_that_side_only(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus
) -> None:
    send(other, SYNC, UNKNOWN, SENSOR, REQUEST, COMMAND)
    assert heard(host) == [UNKNOWN, REQUEST]
    assert heard(firmware) == [UNKNOWN, REQUEST]
    send(firmware, COMMAND)
    assert heard(host) == [COMMAND]
    assert heard(other) == [COMMAND]
    send(host, SYNC, SENSOR)
    assert heard(other) == [SYNC, SENSOR]
    (name,) = (str(n) for n in host.statistics()["senders"])
    assert name.startswith("node 'other' (process ")
    assert host.statistics() == {
        "refused_frames": 3,
        "senders": {name: 3},
        "cut_off": 0,
        "held_back": [],
    }


def test_single_messages_and_fd_messages_are_held_to_the_same(
    host: RrinsBus, firmware: RrinsBus, attach_to: Attach
) -> None:
    other = attach_to(host, "other", fd=True)
    listener = attach_to(host, "listener", fd=True)
    for is_fd in (False, True):
        for identifier in (SENSOR, UNKNOWN):
            message = can.Message(
                arbitration_id=identifier, is_extended_id=False, is_fd=is_fd, data=bytes(8)
            )
            other.send(message)
    assert heard(listener, host) == [UNKNOWN, UNKNOWN]
    assert host.statistics()["refused_frames"] == 2


def test_an_extended_identifier_is_another_one(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus
) -> None:
    other.send(can.Message(arbitration_id=SENSOR, is_extended_id=True, data=bytes(8)))
    assert heard(firmware, host) == [SENSOR]


def test_error_frames_are_a_controllers(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus
) -> None:
    send(other, ERR_FLAG | 0x40)  # bus-off, in the words of SocketCAN
    assert heard(firmware, host) == []
    assert host.statistics()["refused_frames"] == 1
    send(host, ERR_FLAG | 0x40)
    assert heard(firmware) == [0x40]


def test_without_a_side_everybody_may_play_it(attach_to: Attach) -> None:
    with RrinsBus("test", host="here", name="somebody") as host:
        replay = attach_to(host, "replay")
        send(replay, SYNC, SENSOR, COMMAND, closes_epoch=True)
        assert heard(host) == [SYNC, SENSOR, COMMAND]
        firmware = attach_to(host, "firmware")
        send(replay, SYNC, SENSOR, COMMAND)  # now its commands are its own
        assert heard(firmware, host) == [SYNC, SENSOR]
        firmware.shutdown()
        heard(host)
        send(replay, COMMAND)
        assert heard(host) == [COMMAND]


def test_a_test_may_ask_for_foreign_senders(attach_to: Attach) -> None:
    with RrinsBus("test", host="here", name="hardware", foreign_senders=True) as host:
        firmware, other = attach_to(host, "firmware"), attach_to(host, "other")
        send(other, SYNC, SENSOR, COMMAND)
        assert heard(firmware, host) == [SYNC, SENSOR, COMMAND]
        assert host.statistics()["refused_frames"] == 0
    with pytest.raises(ValueError, match="foreign_senders is for the host"):
        RrinsBus("test", host="auto", foreign_senders=True)


def test_sender_and_user_are_told_in_one_line(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "rrins.host_tools.bus"):
        for _ in range(30):
            send(other, SENSOR)
        assert heard(host) == []
        assert heard(other) == []
    line = "node 'other' (process {pid}) sends SENSOR_1, which is the hardware's: not delivered"
    line = (
        line.format(pid=host.peers[1].pid)
        + " (1 frames so far; --foreign-senders of the hardware allows it)"
    )
    assert [record.message for record in caplog.records] == [
        f"channel test: {line}",  # of the host, for the user of the rehearsal
        f"channel test: {line}",  # of the sender, which the host has told
    ]


def test_anybody_can_ask_how_many_were_refused(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus, attach_to: Attach
) -> None:
    monitor = attach_to(host, "monitor", role="observer")
    assert monitor.refused == (0, "")
    send(other, SENSOR)
    send(other, SYNC, SYNC)
    heard(host)
    monitor.ask_refused()
    assert heard(monitor, host) == []
    assert monitor.refused.frames == 3
    assert "sends SYNC, which is the hardware's: not delivered (3 frames" in monitor.refused.line
    assert heard(firmware) == []  # nobody else hears of it


def test_only_the_sides_close_epochs(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus, caplog: pytest.LogCaptureFixture
) -> None:
    frames = frame_array(8)
    send(other, UNKNOWN, closes_epoch=True)
    with caplog.at_level(logging.WARNING, "rrins.host_tools.bus"):
        assert host.recv_batch(frames, 0.05) is None
    assert [peer.name for peer in host.peers] == ["firmware"]
    (record,) = caplog.records
    assert record.message.endswith(
        "is cut off: it sent a batch that closes an epoch, as only firmware and hardware do"
    )
    with pytest.raises(can.CanOperationError, match="cut off, because it sent a batch that closes"):
        other.recv(1.0)
    send(firmware, COMMAND, closes_epoch=True)
    batch = host.recv_batch(frames, 1.0)
    assert batch is not None
    assert batch.closes_epoch
    assert host.statistics()["cut_off"] == 1


def test_the_hardwares_time_is_everybodys(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus, attach_to: Attach
) -> None:
    send(host, SYNC, epoch=7, time_ns=35_000_000, closes_epoch=True)
    send(other, UNKNOWN, time_ns=999_000_000_000)
    other.send(can.Message(arbitration_id=UNKNOWN, is_extended_id=False))
    frames, times = frame_array(8), []
    while (batch := host.recv_batch(frames, 0.05)) is not None:
        times.append(batch.time_ns)
    assert times == [35_000_000, 35_000_000]


def test_who_sends_too_much_waits_and_the_sides_lose_nothing(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus, caplog: pytest.LogCaptureFixture
) -> None:
    send(host, SYNC, closes_epoch=True)
    for _ in range(BURST + 5 * FRAMES_PER_EPOCH):
        send(other, UNKNOWN)
    came = []
    with caplog.at_level(logging.WARNING, "rrins.host_tools.bus"):
        for _ in range(8):
            send(firmware, COMMAND, closes_epoch=True)
            came.append(heard(host))
            send(host, SYNC, closes_epoch=True)
    assert [frames.count(COMMAND) for frames in came] == [1] * 8
    flood = [frames.count(UNKNOWN) for frames in came]
    assert flood[0] == FRAMES_PER_EPOCH  # of the first epoch; it had not rested before
    assert flood[1:] == [FRAMES_PER_EPOCH] * 7
    (record,) = caplog.records
    assert "'other'" in record.message
    assert "sends more than 16 frames an epoch: what is too much waits" in record.message
    assert len(heard(firmware)) == 9 + sum(flood)
    assert host.statistics()["held_back"] == [str(record.args[1])]  # type: ignore[index]  # a tuple here


def test_a_rest_gives_room_for_a_burst(host: RrinsBus, firmware: RrinsBus, other: RrinsBus) -> None:
    for _ in range(BURST):
        send(host, SYNC, closes_epoch=True)
    for _ in range(2 * BURST):
        send(other, UNKNOWN)
    assert len(heard(host)) == BURST


def test_a_large_batch_uses_up_the_epochs_that_follow(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus
) -> None:
    send(host, SYNC, closes_epoch=True)
    for _ in range(2):
        send(other, *[UNKNOWN] * LARGEST_BATCH)
    came = []
    for _ in range(1 + LARGEST_BATCH // FRAMES_PER_EPOCH):
        came.append(len(heard(host)))
        send(host, SYNC, closes_epoch=True)
    assert came == [LARGEST_BATCH, *[0] * (LARGEST_BATCH // FRAMES_PER_EPOCH - 1), LARGEST_BATCH]


def test_a_batch_larger_than_any_costs_the_connection(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus
) -> None:
    send(other, *[UNKNOWN] * (LARGEST_BATCH + 1))
    assert len(heard(host)) == LARGEST_BATCH + 1  # no epochs run yet: nobody is disturbed
    send(host, SYNC, closes_epoch=True)
    send(other, *[UNKNOWN] * (LARGEST_BATCH + 1))
    assert heard(host) == []
    assert [peer.name for peer in host.peers] == ["firmware"]


def test_a_hundred_floods_together_leave_room_for_the_sides(
    host: RrinsBus, firmware: RrinsBus, attach_to: Attach
) -> None:
    send(host, SYNC, closes_epoch=True)
    for number in range(8):
        send(attach_to(host, f"flood-{number}"), *[UNKNOWN] * LARGEST_BATCH)
    send(firmware, COMMAND, closes_epoch=True)
    came = heard(host)
    assert came.count(COMMAND) == 1
    assert len(came) <= 1024 + LARGEST_BATCH


def test_a_host_can_limit_others_before_it_begins(
    host: RrinsBus, firmware: RrinsBus, other: RrinsBus
) -> None:
    host.limit_others()
    for _ in range(2 * BURST):
        send(other, UNKNOWN)
    assert len(heard(host)) == FRAMES_PER_EPOCH
    assert len(heard(firmware)) == FRAMES_PER_EPOCH
    send(host, SYNC, closes_epoch=True)
    assert len(heard(host)) == FRAMES_PER_EPOCH


def test_a_peer_that_waits_may_leave(host: RrinsBus, firmware: RrinsBus, other: RrinsBus) -> None:
    send(host, SYNC, closes_epoch=True)
    for _ in range(2 * BURST):
        send(other, UNKNOWN)
    heard(host)
    other.shutdown()
    for _ in range(10):
        send(host, SYNC, closes_epoch=True)
        heard(host)
    assert [peer.name for peer in host.peers] == ["firmware"]


def test_callers_that_say_nothing_do_not_keep_others_out(host: RrinsBus, attach_to: Attach) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(connect("test", 1.0))
            heard(host)
        attach_to(host, "late")


def test_a_process_that_calls_and_calls_takes_nobodys_place(host: RrinsBus, player: Any) -> None:
    with connect("test", 5.0) as slow:  # a side that a busy machine stops before it says who it is
        heard(host)
        player.tell("call", channel="test", count=200)
        while not select.select([player.process.stdout], [], [], 0.0)[0]:
            heard(host)
        for _ in range(200):
            heard(host)
        slow.send(datagram.control(datagram.HELLO, "slow"))
        heard(host)
        assert [peer.name for peer in host.peers] == ["slow"]
    while host.peers:
        heard(host)
