"""A process at the other end of a bus, which does what the test tells it line by line.

A line of input is ``["method", {arguments}]``, a line of output the answer, both JSON. An error of
python-can is the answer ``{"error": "class: text"}``.
"""

from __future__ import annotations

import json
import socket
import sys
from typing import Any

import can
import numpy as np

from rrins.dbc.frame import frame_array
from rrins.host_tools.bus.channel import connect
from rrins.host_tools.bus.interface import RrinsBus


class Player:
    """The methods a test can call."""

    bus: RrinsBus
    calls: list[socket.socket]

    def open(self, **arguments: Any) -> int:
        self.bus = RrinsBus(**arguments)
        return self.bus.host_pid

    def call(self, channel: str, count: int) -> None:
        """Connect, and say nothing."""
        self.calls = [connect(channel, 20.0) for _ in range(count)]

    def close(self) -> None:
        self.bus.shutdown()

    def send(self, first: int, count: int, size: int, timeout: float | None = 20.0) -> None:
        """Send frames numbered from `first` in batches of `size`."""
        frames = frame_array(size)
        frames["length"] = 8
        for start in range(first, first + count, size):
            number = min(size, first + count - start)
            frames["data"][:number] = np.arange(start, start + number)
            self.bus.send_batch(frames, number, epoch=start, time_ns=start, timeout=timeout)

    def send_messages(self, first: int, count: int) -> None:
        for number in range(first, first + count):
            self.bus.send(can.Message(data=number.to_bytes(8, "little")), 20.0)

    def receive(self, first: int, count: int) -> bool:
        """Receive frames and return whether they are numbered from `first` without a gap."""
        frames = frame_array(64)
        expected = first
        while expected < first + count:
            batch = self.bus.recv_batch(frames, 120.0)
            if batch is None:
                return False
            wanted = np.arange(expected, expected + batch.count, dtype=np.uint64)
            if not np.array_equal(frames["data"][: batch.count], wanted):
                return False
            expected += batch.count
        return expected == first + count

    def senders(self, count: int) -> list[list[int]]:
        """Receive `count` frames and return sender and number of each."""
        frames = frame_array(64)
        seen: list[list[int]] = []
        while len(seen) < count:
            batch = self.bus.recv_batch(frames, 120.0)
            if batch is None:
                break
            seen += [[batch.sender, int(number)] for number in frames["data"][: batch.count]]
        return seen

    def echo(self, count: int) -> None:
        """Send back `count` batches."""
        frames = frame_array(64)
        for _ in range(count):
            batch = self.bus.recv_batch(frames, 120.0)
            if batch is None:
                return
            self.bus.send_batch(frames, batch.count, epoch=batch.epoch, timeout=120.0)

    def receive_until_error(self) -> int:
        """Receive until the bus fails; the answer is its error."""
        frames = frame_array(64)
        while self.bus.recv_batch(frames, 120.0) is not None:
            pass
        return 0

    def serve(self) -> None:
        """Receive as the host of the channel until the peer 'last' comes."""
        self.bus.wait_for("last", 20.0)


def main() -> None:
    player = Player()
    for line in sys.stdin:
        method, arguments = json.loads(line)
        try:
            answer = getattr(player, method)(**arguments)
        except can.CanError as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
