"""Behaviour of every python-can bus, on any transport."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import queue
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from rrins.host_tools.bus.interface import RrinsBus

Opener = Callable[..., can.BusABC]
_names = (f"channel{number}" for number in itertools.count())


def _vcan_is_missing() -> bool:
    return "vcan0" not in [name for _, name in socket.if_nameindex()]


@pytest.fixture(
    params=[
        "embedded",
        "hosted",
        "virtual",
        pytest.param(
            "socketcan",
            marks=pytest.mark.skipif(_vcan_is_missing(), reason="the kernel has no vcan0"),
        ),
    ]
)
def transport(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def open_pair(
    transport: str, attach_to: Callable[..., RrinsBus]
) -> Iterator[Callable[..., tuple[can.BusABC, can.BusABC]]]:
    """Open two ends of one channel."""
    with contextlib.ExitStack() as stack:
        channel = next(_names)

        def open_pair(fd: bool = False, **arguments: Any) -> tuple[can.BusABC, can.BusABC]:
            if transport == "hosted":
                host = stack.enter_context(RrinsBus(channel, host="here", fd=fd, **arguments))
                return host, attach_to(host, fd=fd, **arguments)
            one: can.BusABC
            other: can.BusABC
            if transport == "embedded":
                one, other = (RrinsBus(channel, fd=fd, **arguments) for _ in range(2))
            elif transport == "virtual":
                protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
                one, other = (
                    can.Bus(channel, interface="virtual", protocol=protocol, **arguments)
                    for _ in range(2)
                )
            else:
                one, other = (
                    can.Bus("vcan0", interface="socketcan", fd=fd, **arguments) for _ in range(2)
                )
            return stack.enter_context(one), stack.enter_context(other)

        yield open_pair


@pytest.fixture
def pair(open_pair: Callable[..., tuple[can.BusABC, can.BusABC]]) -> tuple[can.BusABC, can.BusABC]:
    return open_pair()


def classic(number: int, **arguments: Any) -> can.Message:
    return can.Message(arbitration_id=number, is_extended_id=False, **arguments)


def assert_same(received: can.Message, message: can.Message, transport: str) -> None:
    # SocketCAN calls what another socket of the same machine sent "not received".
    assert received.is_rx or transport == "socketcan"
    assert received.equals(
        message, timestamp_delta=None, check_channel=False, check_direction=received.is_rx
    )


@pytest.mark.parametrize(
    "message",
    [
        classic(0x7FF, data=bytes(range(8))),
        classic(0),
        can.Message(arbitration_id=0x1FFF_FFFF, data=b"\xff" * 8),
        can.Message(arbitration_id=0x123, is_extended_id=True, data=b"\x01"),
        classic(0x42, is_remote_frame=True, dlc=5),
    ],
    ids=["standard", "empty", "extended", "low extended", "remote"],
)
def test_a_message_arrives_as_it_was_sent(
    pair: tuple[can.BusABC, can.BusABC], message: can.Message, transport: str
) -> None:
    for sender, receiver in (pair, pair[::-1]):
        sender.send(message, 5.0)
        received = receiver.recv(5.0)
        assert received is not None
        assert_same(received, message, transport)


def test_an_error_frame_arrives(pair: tuple[can.BusABC, can.BusABC]) -> None:
    message = can.Message(
        arbitration_id=4, is_error_frame=True, is_extended_id=False, data=b"\0" * 8
    )
    pair[0].send(message, 5.0)
    received = pair[1].recv(5.0)
    assert received is not None
    assert received.is_error_frame
    assert received.arbitration_id == 4


@pytest.mark.parametrize("length", [0, 8, 12, 64])
def test_an_fd_message_arrives_as_it_was_sent(
    open_pair: Callable[..., tuple[can.BusABC, can.BusABC]], length: int, transport: str
) -> None:
    sender, receiver = open_pair(fd=True)
    message = can.Message(
        arbitration_id=0x18DA_00F1,
        is_fd=True,
        bitrate_switch=True,
        data=bytes(range(length)),
    )
    sender.send(message, 5.0)
    sender.send(classic(1, data=b"classic"), 5.0)
    received = receiver.recv(5.0)
    assert received is not None
    assert_same(received, message, transport)
    received = receiver.recv(5.0)
    assert received is not None
    assert not received.is_fd
    assert received.data == b"classic"


def test_messages_keep_their_order(pair: tuple[can.BusABC, can.BusABC]) -> None:
    for number in range(200):
        pair[0].send(classic(number), 5.0)
    received = [pair[1].recv(5.0) for _ in range(200)]
    assert [message and message.arbitration_id for message in received] == list(range(200))
    stamps = [message.timestamp for message in received if message]
    assert stamps == sorted(stamps)


def test_nothing_to_receive_is_none_in_time(pair: tuple[can.BusABC, can.BusABC]) -> None:
    assert pair[0].recv(0) is None
    assert pair[0].recv(0.01) is None


def test_own_messages_only_on_demand(
    open_pair: Callable[..., tuple[can.BusABC, can.BusABC]],
) -> None:
    sender, receiver = open_pair(receive_own_messages=True)
    sender.send(classic(5), 5.0)
    for bus in (sender, receiver):
        message = bus.recv(5.0)
        assert message is not None
        assert message.arbitration_id == 5


def test_a_sender_does_not_hear_itself(pair: tuple[can.BusABC, can.BusABC]) -> None:
    pair[0].send(classic(1), 5.0)
    assert pair[1].recv(5.0) is not None
    pair[1].send(classic(2), 5.0)
    message = pair[0].recv(5.0)
    assert message is not None
    assert message.arbitration_id == 2


def test_filters_let_only_their_messages_pass(pair: tuple[can.BusABC, can.BusABC]) -> None:
    sender, receiver = pair
    receiver.set_filters([{"can_id": 0x100, "can_mask": 0x700, "extended": False}])
    for number in (0x200, 0x101, 0x7FF, 0x1FF):
        sender.send(classic(number), 5.0)
    received = [receiver.recv(5.0) for _ in range(2)]
    assert [message and message.arbitration_id for message in received] == [0x101, 0x1FF]
    receiver.set_filters(None)
    sender.send(classic(0x200), 5.0)
    assert receiver.recv(5.0) is not None


def test_a_bus_is_an_iterator(pair: tuple[can.BusABC, can.BusABC]) -> None:
    for number in range(3):
        pair[0].send(classic(number), 5.0)
    assert [message.arbitration_id for message in itertools.islice(pair[1], 3)] == [0, 1, 2]


def test_a_notifier_delivers(pair: tuple[can.BusABC, can.BusABC]) -> None:
    heard: queue.Queue[can.Message] = queue.Queue()
    notifier = can.Notifier(pair[1], [heard.put], timeout=0.05)
    try:
        for number in range(20):
            pair[0].send(classic(number), 5.0)
        assert [heard.get(timeout=120.0).arbitration_id for _ in range(20)] == list(range(20))
    finally:
        notifier.stop()


def test_a_notifier_delivers_with_asyncio(pair: tuple[can.BusABC, can.BusABC]) -> None:
    async def listen() -> list[int]:
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(pair[1], [reader], 0.05, loop=asyncio.get_running_loop())
        try:
            for number in range(20):
                pair[0].send(classic(number), 5.0)
            return [
                (await asyncio.wait_for(reader.get_message(), 5)).arbitration_id for _ in range(20)
            ]
        finally:
            notifier.stop()

    assert asyncio.run(listen()) == list(range(20))


def test_messages_are_sent_periodically(pair: tuple[can.BusABC, can.BusABC]) -> None:
    task = pair[0].send_periodic(classic(0x55, data=b"\x07"), 0.002)
    try:
        for _ in range(5):
            message = pair[1].recv(5.0)
            assert message is not None
            assert message.arbitration_id == 0x55
    finally:
        task.stop()
        if isinstance(task, can.broadcastmanager.ThreadBasedCyclicSendTask) and task.thread:
            task.thread.join(5)


def test_shutdown_twice_is_once(pair: tuple[can.BusABC, can.BusABC], transport: str) -> None:
    pair[1].shutdown()
    pair[1].shutdown()
    # python-can's SocketCAN lets the error of the closed socket through.
    errors = (can.CanError, ValueError) if transport == "socketcan" else can.CanError
    with pytest.raises(errors):
        pair[1].send(classic(1), 1.0)
    with pytest.raises(errors):
        pair[1].recv(1.0)


def test_python_can_finds_the_interface(runtime_directory: Path) -> None:
    if "rrins" not in can.VALID_INTERFACES:
        pytest.skip("the project is not installed, so python-can has no entry point of it")
    with can.Bus("by-name", interface="rrins") as bus:
        assert isinstance(bus, RrinsBus)
        assert {"interface": "rrins", "channel": "by-name"} in can.detect_available_configs("rrins")
