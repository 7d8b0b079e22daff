"""The bus between real processes: lossless, held up, cut off, killed."""

from __future__ import annotations

import itertools
import logging
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import relay
from rrins.host_tools.bus.interface import RrinsBus

StartPlayer = Callable[[], Any]


@pytest.fixture
def host() -> Iterator[RrinsBus]:
    with RrinsBus("test", host="here", name="hardware") as bus:
        yield bus


def attach(host: RrinsBus, player: Any, name: str, **arguments: Any) -> None:
    player.tell("open", channel="test", host="never", name=name, **arguments)
    host.wait_for(name, 120.0)
    assert player.answer() == os.getpid()


def test_a_hundred_thousand_frames_keep_their_order(start_player: StartPlayer) -> None:
    senders, receivers = [start_player(), start_player()], [start_player(), start_player()]
    for player in receivers:
        player.tell("open", channel="test")
    for player in senders:  # they do not receive, and so must not hold up the bus
        player.tell("open", channel="test", role="observer")
    assert len({player.answer() for player in (*receivers, *senders)}) == 1  # one hub for all
    for first, sender, size in ((0, senders[0], 7), (1_000_000, senders[1], 3)):
        sender.tell("send", first=first, count=50_000, size=size)
    for receiver in receivers:
        receiver.tell("senders", count=100_000)
    assert [sender.answer() for sender in senders] == [None, None]
    heard = [np.array(receiver.answer()) for receiver in receivers]
    np.testing.assert_array_equal(heard[0], heard[1])  # all see the same sequence
    for first in (0, 1_000_000):
        ours = heard[0][(heard[0][:, 1] >= first) & (heard[0][:, 1] < first + 50_000)]
        np.testing.assert_array_equal(ours[:, 1], np.arange(first, first + 50_000))
        assert len(set(ours[:, 0])) == 1
    for player in (*senders, *receivers):
        player.ask("close")


def test_two_nodes_that_both_send_first_do_not_block_each_other(
    start_player: StartPlayer,
) -> None:
    players = [start_player(), start_player()]
    for player in players:
        player.tell("open", channel="test", name=f"player-{player.pid}")
    assert len({player.answer() for player in players}) == 1
    for player in players:
        player.tell("send_messages", first=0, count=20_000)
    for player in players:
        player.tell("receive", first=0, count=20_000)
    for player in players:
        assert [player.answer(), player.answer()] == [None, True]
    for player in players:
        player.ask("close")


def test_a_stopped_node_stops_the_world_and_loses_nothing(
    host: RrinsBus, start_player: StartPlayer
) -> None:
    slow, other = start_player(), start_player()
    attach(host, slow, "slow")
    attach(host, other, "other")
    count = 60_000
    for player in (slow, other):
        player.tell("receive", first=0, count=count)
    frames, sent = frame_array(1), 0
    frames["length"] = 8
    os.kill(slow.pid, signal.SIGSTOP)

    def send_on() -> None:
        nonlocal sent
        while sent < count:
            frames["data"] = sent
            host.send_batch(frames, 1, timeout=0.05)
            sent += 1

    with pytest.raises(can.CanTimeoutError, match="held up by node 'slow'"):
        send_on()
    assert sent < count
    os.kill(slow.pid, signal.SIGCONT)
    for number in range(sent, count):
        frames["data"] = number
        host.send_batch(frames, 1, timeout=120.0)
    host.recv_batch(frames, 0)
    assert slow.answer() is True
    assert other.answer() is True


def test_a_node_that_holds_the_bus_is_reported_once(
    host: RrinsBus, start_player: StartPlayer, caplog: pytest.LogCaptureFixture
) -> None:
    slow = start_player()
    attach(host, slow, "slow")
    frames = frame_array(1)

    def send_on() -> None:
        while True:
            host.send_batch(frames, 1, timeout=1.1)

    with pytest.raises(can.CanTimeoutError):
        send_on()
    with pytest.raises(can.CanTimeoutError):
        host.send_batch(frames, 1, timeout=0.05)
    assert [record.message for record in caplog.records] == [
        f"channel test is held up: node 'slow' (process {slow.pid}) does not receive"
    ]
    slow.end()


def test_a_hanging_observer_never_slows_the_bus_and_is_cut_off(
    host: RrinsBus, start_player: StartPlayer, caplog: pytest.LogCaptureFixture
) -> None:
    observer, node = start_player(), start_player()
    attach(host, observer, "monitor", role="observer")
    attach(host, node, "firmware")
    host.require(["firmware"])
    os.kill(observer.pid, signal.SIGSTOP)
    epochs = 6_000
    node.tell("echo", count=epochs)
    frames = frame_array(64)
    with caplog.at_level(logging.WARNING, "rrins.host_tools.bus"):
        for epoch in range(epochs):
            host.send_batch(frames, 64, epoch=epoch, timeout=120.0)
            batch = host.recv_batch(frames, 120.0)
            assert batch is not None
            assert batch.epoch == epoch
    assert [peer.name for peer in host.peers] == ["firmware"]
    assert [record.message.split(":")[0] for record in caplog.records] == ["channel test"]
    assert "cut off" in caplog.records[0].message
    observer.tell("receive_until_error")
    os.kill(observer.pid, signal.SIGCONT)
    host.recv_batch(frames, 0.2)  # the host gives it its last word while it serves the channel
    assert "CanOperationError" in observer.answer()["error"]
    observer.tell("receive_until_error")
    assert "this observer was cut off" in observer.answer()["error"]


def test_an_observer_that_lags_and_catches_up_loses_nothing(
    host: RrinsBus, start_player: StartPlayer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long that takes: by this clock it is ten minutes each time that it takes some."""
    observer = start_player()
    attach(host, observer, "recorder", role="observer")
    os.kill(observer.pid, signal.SIGSTOP)
    observer.tell("receive", first=0, count=30_000)
    frames = frame_array(1)
    frames["length"] = 8
    for number in range(30_000):
        frames["data"] = number
        host.send_batch(frames, 1, timeout=0.0)
    os.kill(observer.pid, signal.SIGCONT)
    monkeypatch.setattr(relay, "_LINGER_NS", 1_000_000_000_000)
    monkeypatch.setattr(relay, "_now", itertools.count(0, 600_000_000_000).__next__)
    host.shutdown()  # lets it take what waits for it
    assert observer.answer() is True
    assert "has closed it" in observer.ask("receive_until_error")["error"]


def test_a_hundred_come_and_go_during_traffic(host: RrinsBus, start_player: StartPlayer) -> None:
    node, visitor = start_player(), start_player()
    attach(host, node, "firmware")
    epochs = 200_000
    node.tell("echo", count=epochs)
    frames, epoch, visits = frame_array(7), 0, 0

    def exchange() -> None:
        nonlocal epoch
        host.send_batch(frames, 7, epoch=epoch, timeout=120.0)
        batch = host.recv_batch(frames, 120.0)
        assert batch is not None
        assert batch.epoch == epoch
        epoch += 1

    before = len(list(Path("/proc/self/fd").iterdir()))
    for visits in range(100):
        role = "observer" if visits % 2 else "node"
        visitor.tell("open", channel="test", host="never", name="visitor", role=role)
        while len(host.peers) < 2:
            exchange()
        assert visitor.answer() == os.getpid()
        visitor.tell("close")
        while len(host.peers) > 1:
            exchange()
        assert visitor.answer() is None
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert epoch < epochs


def test_a_killed_host_is_an_error_in_its_peers(start_player: StartPlayer) -> None:
    host_player = start_player()
    host_player.ask("open", channel="test", host="here")
    host_player.tell("serve")
    with RrinsBus("test", host="never") as bus, RrinsBus("test", host="never") as sender:
        assert bus.host_pid == host_player.pid
        os.kill(host_player.pid, signal.SIGKILL)
        with pytest.raises(
            can.CanOperationError, match=f"process {host_player.pid}, has disappeared"
        ):
            bus.recv(None)  # at once: this waits for ever
        with pytest.raises(can.CanOperationError, match="has disappeared"):
            sender.send(can.Message(), 120.0)
        assert bus.state is can.BusState.ERROR


def test_a_killed_peer_is_cut_off_and_named(
    host: RrinsBus, start_player: StartPlayer, caplog: pytest.LogCaptureFixture
) -> None:
    node, other = start_player(), start_player()
    attach(host, node, "firmware")
    attach(host, other, "other")
    host.require(["firmware"])
    os.kill(node.pid, signal.SIGKILL)
    with pytest.raises(
        can.CanOperationError, match=rf"'firmware' \(process {node.pid}\).*disappeared"
    ):
        host.recv_batch(frame_array(1), None)  # at once: this waits for ever
    assert len(caplog.records) == 1
    host.require(["other"])
    other.tell("receive", first=0, count=1)
    frames = frame_array(1)
    frames["length"] = 8
    host.send_batch(frames, 1)
    assert other.answer() is True


def test_a_second_exclusive_name_is_refused(host: RrinsBus, start_player: StartPlayer) -> None:
    first, second = start_player(), start_player()
    attach(host, first, "firmware", exclusive=True)
    second.tell("open", channel="test", host="never", name="firmware", exclusive=True)
    host.recv_batch(frame_array(1), 0.5)
    answer = second.answer()
    assert answer["error"].startswith("CanInitializationError: the name 'firmware'")
    assert f"process {first.pid}" in answer["error"]
    os.kill(first.pid, signal.SIGKILL)
    first.end()
    attach(host, second, "firmware", exclusive=True)  # the dead do not hold a name
    assert [peer.pid for peer in host.peers if peer.name == "firmware"][-1] == second.pid


def test_many_start_one_hub_which_ends_with_them(start_player: StartPlayer) -> None:
    players = [start_player() for _ in range(4)]
    for player in players:
        player.tell("open", channel="test")
    hubs = {player.answer() for player in players}
    assert len(hubs) == 1
    pid = hubs.pop()
    hub = os.pidfd_open(pid)
    try:
        for player in players:
            player.ask("close")
        assert select.select([hub], [], [], 120.0)[0]
    finally:
        os.close(hub)


def test_a_hub_loads_only_what_it_needs() -> None:
    """Whoever connects first waits for it: the DBC and the compiler are for the two sides."""
    look = "import sys, rrins.host_tools.bus.hub; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert not {"can", "cantools", "numba"} & set(done.stdout.split())
