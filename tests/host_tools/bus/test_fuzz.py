"""The bus survives any input; and endurance: not one frame is lost.

Two environment variables scale these tests:

``RRINS_FUZZ``
    Datagrams thrown at the host, 4000 by default. ``RRINS_FUZZ=1000000`` takes some minutes.
``RRINS_SOAK``
    Frames between two processes, 50000 by default. ``RRINS_SOAK=10000000`` takes a minute or two.

Both print their figures: run them with ``pytest -s``. As a program, with the name of a role and of
a channel, this file is one of the two good nodes.
"""

from __future__ import annotations

import itertools
import logging
import os
import random
import select
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import connect
from rrins.host_tools.bus.datagram import ProtocolError
from rrins.host_tools.bus.interface import RrinsBus
from tests.processes import Fork

CASES = int(os.environ.get("RRINS_FUZZ", "4000"))
SOAK = int(os.environ.get("RRINS_SOAK", "50000"))
GROWTH_BYTES = 8 * 1024 * 1024
BATCH = 7  # frames of an epoch

PING, PONG = 0x600D_0001, 0x600D_0002  # epochs by which the good nodes know each other's batches

pytestmark = pytest.mark.timeout(120 + CASES // 500 + SOAK // 10_000)


# The good nodes


def ping(channel: str) -> int:
    """Send batches, each after the echo of the one before, until standard input ends."""
    frames, heard = frame_array(BATCH), frame_array(64)
    frames["length"] = 8
    with RrinsBus(channel, host="never", name="ping") as bus:
        print("attached", flush=True)
        for number in itertools.count():
            if select.select([sys.stdin], [], [], 0)[0]:
                print(number, flush=True)
                return 0
            frames["data"] = range(number, number + BATCH)
            bus.send_batch(frames, BATCH, epoch=PING, time_ns=number, timeout=120.0)
            while True:
                batch = bus.recv_batch(heard, 120.0)
                assert batch is not None, f"batch {number} was lost"
                if batch.epoch == PONG:
                    break
            assert batch.count == BATCH
            assert (heard["data"][:BATCH] == frames["data"]).all(), f"batch {number} was harmed"
    return 1


def pong(channel: str) -> int:
    """Echo the other's batches until standard input ends."""
    heard = frame_array(64)
    with RrinsBus(channel, host="never", name="pong") as bus:
        print("attached", flush=True)
        while not select.select([sys.stdin], [], [], 0)[0]:
            batch = bus.recv_batch(heard, 0.05)
            if batch is not None and batch.epoch == PING:
                bus.send_batch(heard, batch.count, epoch=PONG, timeout=120.0)
    return 0


class GoodNode:
    """A process that runs one of the functions above."""

    def __init__(self, role: str, host: RrinsBus) -> None:
        self.process = Fork(
            [__file__, role, host.channel],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        host.wait_for(role, 120.0)
        assert self._line() == "attached\n"

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def stop(self, host: RrinsBus) -> str:
        """Let it come to its end while the host serves; return its last word."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        frames = frame_array(64)
        while self.process.poll() is None:
            host.recv_batch(frames, 0.01)
        return self._line()


# The bad ones

INTERESTING = (0, 1, 2, 7, 8, 9, 64, 65, 127, 128, 255)


def templates(rng: random.Random, number: int) -> bytes:
    """Return a well-formed datagram of some kind; `number` is the node that sends it."""
    kind = rng.choice((1, 2, 3, 4, 5, 5, 5, 5, 6, 6, 7, 8))
    if kind not in (datagram.FRAMES, datagram.FRAMES_FD):
        return datagram.control(kind, "x" * rng.randrange(64), sender=number)
    size = {5: datagram.FRAME_SIZE, 6: datagram.FD_FRAME_SIZE}[kind]
    count = rng.choice((0, 1, 2, 7, 64))
    body = bytearray(rng.randbytes(count * size))
    body[4::size] = bytes(rng.randrange(9) for _ in range(count))
    epoch = rng.getrandbits(32)
    time_ns = rng.getrandbits(63) - rng.getrandbits(63)
    return datagram.HEADER.pack(
        datagram.MAGIC, kind, rng.randrange(4), count, number, 0, epoch, time_ns
    ) + bytes(body)


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Return a datagram with a few things about it changed."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        way = rng.randrange(6)
        at = rng.randrange(len(out) + 1)
        if way == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif way == 1 and at < len(out):
            out[at] = rng.choice(INTERESTING)
        elif way == 2:
            del out[at:]
        elif way == 3:
            out[at:at] = rng.randbytes(rng.choice((1, 4, 16, 72)))
        elif way == 4:
            out[at:at] = out[: rng.randrange(len(out) + 1)]
        elif len(out) >= datagram.HEADER_SIZE:
            field = rng.choice((0, 4, 5, 6, 8, 12, 16, 24))
            out[field : field + 2] = rng.randbytes(2)
    return bytes(out)


def anything(rng: random.Random, number: int) -> bytes:
    """Return a datagram: mostly one of ours that was harmed, at times noise or a whole one."""
    way = rng.randrange(20)
    if way == 0:
        return rng.randbytes(rng.randrange(200))
    if way == 1:
        return rng.randbytes(rng.choice((31, 32, 33, 65_535, 65_536, 65_537, 100_000)))
    if way < 6:
        return templates(rng, number)
    return mutated(rng, templates(rng, number))


class Attacker:
    """Somebody who attaches properly, and then sends anything."""

    def __init__(self, host: RrinsBus, rng: random.Random) -> None:
        self._host = host
        self._rng = rng
        self._end: socket.socket | None = None
        self._number = 0
        self.outcomes: Counter[str] = Counter()
        self.cut_offs = 0  # of which each is to be a line in the log

    def _serve(self) -> None:
        while self._host.recv_batch(self._into, 0) is not None:
            pass

    _into = frame_array(64)

    def _attach(self) -> socket.socket:
        end = connect(self._host.channel, 5.0)
        flags = self._rng.choice((0, datagram.OBSERVER, datagram.RECEIVE_OWN))
        end.send(datagram.control(datagram.HELLO, "attacker", flags=flags))
        while not any(peer.name == "attacker" for peer in self._host.peers):
            self._serve()
        welcome = end.recv(1000)
        assert welcome[4] == datagram.WELCOME
        self._number = datagram.HEADER.unpack_from(welcome)[4]
        end.setblocking(False)
        return end

    def _is_cut_off(self) -> bool:
        """Receive what there is; return whether it ends."""
        assert self._end is not None
        while True:
            try:
                if not self._end.recv(65_536):
                    return True
            except BlockingIOError:
                return False
            except ConnectionResetError:
                continue  # told once, before what is still to be received

    def _is_harmless(self, data: bytes) -> bool:
        try:
            kind, flags, _, sender, _, _ = datagram.parse(bytearray(data), len(data))
        except ProtocolError:
            return False
        if kind in (datagram.FRAMES, datagram.FRAMES_FD) and flags & datagram.CLOSES_EPOCH:
            return False  # only the sides do
        return kind >= datagram.FRAMES and kind != datagram.NOTE and sender == self._number

    def send_as_peer(self) -> None:
        """Send anything, once attached."""
        if self._end is None:
            self._end = self._attach()
        data = anything(self._rng, self._number)
        try:
            if self._rng.randrange(8):
                self._end.send(data)
            else:  # the host does not want the descriptors that come with it
                socket.send_fds(self._end, [data], [self._end.fileno()])
        except BlockingIOError:
            self.outcomes["did not fit"] += 1
            return
        self._serve()
        is_goodbye = len(data) >= 5 and data[4] == datagram.BYE
        if self._is_cut_off():
            assert not self._is_harmless(data)
            is_goodbye = is_goodbye and not self._is_malformed(data)
            self.outcomes["left" if is_goodbye else "cut off"] += 1
            self.cut_offs += not is_goodbye
            self._hang_up()
        else:
            assert self._is_harmless(data)
            self.outcomes["relayed"] += 1

    @staticmethod
    def _is_malformed(data: bytes) -> bool:
        try:
            datagram.parse(bytearray(data), len(data))
        except ProtocolError:
            return True
        return False

    def go(self) -> None:
        """Leave without a word."""
        if self._end is not None:
            self._hang_up()
            self._serve()
            self.outcomes["gone"] += 1
            self.cut_offs += 1

    def send_as_caller(self) -> None:
        """Send anything instead of an introduction."""
        with connect(self._host.channel, 5.0) as end:
            number = self._rng.randrange(3)
            data = anything(self._rng, number)
            if self._rng.randrange(2):
                data = mutated(self._rng, datagram.control(datagram.HELLO, "caller"))
            end.send(data)
            before = len(self._host.peers)
            self._serve()
            is_in = len(self._host.peers) > before
            self.outcomes["let in" if is_in else "turned away"] += 1
            # Who says nothing only wanted to know whether there is a host.
            self.cut_offs += 1 if is_in else bool(data)
        self._serve()

    def _hang_up(self) -> None:
        assert self._end is not None
        self._end.close()
        self._end = None


class Lines(logging.Filter):
    """Counts the lines of a log; keeps none, and lets none through to pytest, which would."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0
        self.strange: list[str] = []

    def filter(self, record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if "not delivered" in text:  # a frame that only a side may send, by chance
            return False
        self.count += 1
        known = ("is cut off: it sent", "turned away process", "has disappeared")
        if "\n" in text or not any(words in text for words in known):
            self.strange.append(text)
        return False


@pytest.fixture
def lines() -> Iterator[Lines]:
    log, lines = logging.getLogger("rrins.host_tools.bus"), Lines()
    log.addFilter(lines)
    yield lines
    log.removeFilter(lines)


@pytest.fixture
def good_node() -> Iterator[Callable[[str, RrinsBus], GoodNode]]:
    nodes: list[GoodNode] = []

    def start(role: str, host: RrinsBus) -> GoodNode:
        nodes.append(GoodNode(role, host))
        return nodes[-1]

    yield start
    for node in nodes:
        node.process.kill()
        for pipe in (node.process.stdin, node.process.stdout):
            assert pipe is not None
            pipe.close()
        node.process.wait()


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_datagram_of_noise_is_read_or_rejected() -> None:
    rng = random.Random(1)
    read = 0
    for _ in range(CASES):
        data = anything(rng, 1)
        try:
            datagram.parse(bytearray(data), len(data))
            read += 1
        except ProtocolError as error:
            assert "\n" not in str(error)  # noqa: PT017 - of any error
    assert 0 < read < CASES


def test_the_host_and_the_good_nodes_go_on(
    lines: Lines, good_node: Callable[[str, RrinsBus], GoodNode]
) -> None:
    rng = random.Random(2)
    with RrinsBus("test", host="here", name="hardware") as host:
        nodes = [good_node("pong", host), good_node("ping", host)]
        host.require(["ping", "pong"])
        attacker = Attacker(host, rng)
        start = time.monotonic()
        slowest_s = 0.0
        early = (0, 0)
        for case in range(CASES):
            begun = time.monotonic()
            way = rng.randrange(100)
            if way < 80:
                attacker.send_as_peer()
            elif way < 99:
                attacker.send_as_caller()
            else:
                attacker.go()
            slowest_s = max(slowest_s, time.monotonic() - begun)
            if case == CASES // 10:
                attacker.go()
                early = (resident_bytes(), descriptors())
        attacker.go()
        seconds = time.monotonic() - start
        growth = resident_bytes() - early[0]
        assert descriptors() == early[1]
        assert {peer.name for peer in host.peers} == {"ping", "pong"}
        host.require([])
        rounds = int(nodes[1].stop(host))
        nodes[0].stop(host)
        assert [node.process.returncode for node in nodes] == [0, 0]
    print(
        f"\n{CASES} datagrams in {seconds:.0f} s, the slowest {slowest_s * 1e3:.1f} ms; "
        f"{dict(attacker.outcomes)}; {lines.count} lines; resident memory {growth / 1024:+.0f} KiB "
        f"since a tenth of it; {rounds} rounds of the good nodes"
    )
    assert not lines.strange
    assert lines.count == attacker.cut_offs
    assert growth < GROWTH_BYTES
    assert slowest_s < 5.0
    assert rounds > CASES / 100


def test_not_one_frame_is_lost(start_player: Callable[[], Any]) -> None:
    """Two processes, of which one hosts, as in a rehearsal; the other checks the sequence."""
    sender, receiver = start_player(), start_player()
    sender.ask("open", channel="test", host="here", name="hardware")
    sender.tell("serve")
    receiver.ask("open", channel="test", host="never", name="last")
    assert sender.answer() is None
    start = time.monotonic()
    receiver.tell("receive", first=0, count=SOAK)
    sender.tell("send", first=0, count=SOAK, size=BATCH)
    assert sender.answer() is None
    assert receiver.answer() is True
    seconds = time.monotonic() - start
    back = SOAK // 4
    receiver.tell("send", first=SOAK, count=back, size=BATCH)
    sender.tell("receive", first=SOAK, count=back)
    assert receiver.answer() is None
    assert sender.answer() is True
    for player in (sender, receiver):
        player.ask("close")
    print(f"\n{SOAK} frames in {seconds:.1f} s, {back} back, in sequence and without a gap")


if __name__ == "__main__":
    try:
        sys.exit({"ping": ping, "pong": pong}[sys.argv[1]](sys.argv[2]))
    except can.CanError as failure:
        sys.exit(f"{sys.argv[1]}: {failure}")
