"""A client of a few lines, written from docs/bus.md: the page's bytes are the bus's."""

from __future__ import annotations

import re
import socket
import struct
import threading
from pathlib import Path

import pytest

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.interface import RrinsBus

PAGE = Path(__file__).parents[3] / "docs" / "bus.md"
HEADER = struct.Struct("<4sBBHIIQq")


def example() -> list[bytes]:
    """Return the three datagrams of the page's example."""
    text = PAGE.read_text(encoding="utf-8").split("An example: ")[1].split("```")[1]
    rows = [bytes.fromhex(re.sub(r"\s", "", line)) for line in text.strip().splitlines()]
    return [rows[0] + rows[1], rows[2] + rows[3], rows[4] + rows[5]]


class Served:
    """A host that serves in a thread while the test is a client."""

    def __init__(self, channel: Path) -> None:
        self.bus = RrinsBus(channel=str(channel), host="here", name="hardware", exclusive=True)
        self.batches: list[tuple[int, int, bool, int, bytes]] = []
        self._thread = threading.Thread(target=self._serve)
        self._ends = threading.Event()
        self._thread.start()

    def _serve(self) -> None:
        frames = frame_array(64)
        while not self._ends.is_set():
            batch = self.bus.recv_batch(frames, 0.01)
            if batch is not None:
                payload = frames[: batch.count].tobytes()
                self.batches.append(
                    (batch.epoch, batch.time_ns, batch.closes_epoch, batch.sender, payload)
                )

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self.bus.shutdown()


@pytest.fixture
def served(tmp_path: Path):
    host = Served(tmp_path / "bus.sock")
    client = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    client.settimeout(10)
    client.connect(str(tmp_path / "bus.sock"))
    with client:
        yield host, client
    host.close()


def test_the_example_is_what_the_bus_says_and_takes(served) -> None:
    host, client = served
    hello, welcome, batch = example()
    client.send(hello)
    answer = bytearray(client.recv(65537))
    answer[16:32] = bytes(welcome[16:32])  # the host's process, and when its time began
    assert bytes(answer) == welcome
    client.send(batch)
    bye = bytearray(HEADER.pack(b"RRB1", 4, 0, 0, 1, 0, 0, 0))
    client.send(bye)
    while not host.batches:
        pass
    assert host.batches == [(3, 15_000_000, True, 1, batch[32:])]


@pytest.mark.parametrize(
    ("magic", "words"),
    [
        (b"RRB2", "a datagram of version 2 of the protocol; this is 1"),
        (b"XXXX", "a datagram of another program"),
    ],
)
def test_another_version_is_refused_with_the_hosts_own(served, magic: bytes, words: str) -> None:
    _, client = served
    client.send(HEADER.pack(magic, 1, 0, 1, 0, 0, 0, 0) + b"x")
    answer = client.recv(65537)
    assert answer[:5] == b"RRB1\x03"
    assert answer[32:].decode() == words


def test_a_sender_that_is_not_oneself_is_the_end(served) -> None:
    _, client = served
    hello, _, batch = example()
    client.send(hello)
    client.recv(65537)
    client.send(batch[:8] + bytes([9]) + batch[9:])
    answer = client.recv(65537)
    assert answer[4] == 4
    assert b"from node 9" in answer
