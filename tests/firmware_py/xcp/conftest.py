"""A master at the computer on the bench: command packets in virtual time, epoch by epoch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.firmware_py.core.settings import XcpSettings
from rrins.firmware_py.diagnostics.access import key_of
from rrins.firmware_py.xcp.layout import by_path
from tests.firmware_py.conftest import Bench

COMMAND, RESPONSE = load().frame_id("XCP_COMMAND"), load().frame_id("XCP_RESPONSE")
UNLOCK_ALL = 0x09


def xcp_frame(data: bytes) -> Any:
    frame = frame_array(1)
    frame["can_id"], frame["length"] = COMMAND, len(data)
    frame["data"] = int.from_bytes(data.ljust(8, b"\0"), "little")
    return frame[0]


class Master:
    """Somebody with a measurement and calibration tool at a bench."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        assert bench.firmware.xcp is not None
        self.xcp = bench.firmware.xcp
        self.lengths: list[int] = []
        """Of the packets of the last step, bytes."""

    def step(self, packets: Sequence[bytes] = ()) -> list[bytes]:
        """Run an epoch with packets before its own frames; return the slave's, filled up."""
        frames = [*map(xcp_frame, packets), *self.bench.frames()]
        sent = [frame for frame in self.bench.step(frames) if frame["can_id"] == RESPONSE]
        self.lengths = [int(frame["length"]) for frame in sent]
        return [int(frame["data"]).to_bytes(8, "little") for frame in sent]

    def ask(self, *packets: str) -> str:
        """Return the packets that answer some packets, in hexadecimal, one a word."""
        answers = self.step([bytes.fromhex(packet) for packet in packets])
        while self.xcp.is_awake and not self.xcp.daq.is_running:
            answers += self.step()
        return " ".join(answer.hex() for answer in answers)

    def connect(self) -> None:
        assert self.ask("ff00").startswith("ff")

    def unlock(self, resource: int) -> str:
        first = bytes.fromhex(self.ask(f"f800{resource:02x}"))
        second = bytes.fromhex(self.ask("f80100"))
        assert (first[1], second[1]) == (8, 2)
        key = key_of(first[2:8] + second[2:4])
        assert self.ask("f708" + key[:6].hex()).startswith("ff")
        return self.ask("f702" + key[6:].hex())

    def point_to(self, path: str, offset: int = 0) -> None:
        address = by_path()[path].address + offset
        assert self.ask("f6000000" + address.to_bytes(4, "little").hex()).startswith("ff")

    def read(self, path: str, size: int = 8) -> bytes:
        self.point_to(path)
        packets = self.ask(f"f5{size:02x}").split()
        return b"".join(bytes.fromhex(packet)[1:] for packet in packets)[:size]

    def measure(
        self,
        *ranges: tuple[int, int],
        mode: int = 0x10,
        event: int = 0,
        prescaler: int = 1,
        priority: int = 0,
    ) -> None:
        """Set up and start one list: an ODT for each range (address, size), the first empty."""
        assert self.ask("d6") == "ff" + "00" * 7
        self.ask("d5000100")
        self.ask(f"d4000000{len(ranges) + 1:02x}")
        for odt, _ in enumerate(ranges, 1):
            self.ask(f"d3000000{odt:02x}01")
        for odt, (address, size) in enumerate(ranges, 1):
            self.ask(f"e2000000{odt:02x}00")
            self.ask(f"e1ff{size:02x}00" + address.to_bytes(4, "little").hex())
        self.ask(f"e0{mode:02x}0000{event:02x}00{prescaler:02x}{priority:02x}")


@pytest.fixture
def master() -> Master:
    master = Master(Bench(xcp=XcpSettings()))
    master.step()
    return master


@pytest.fixture
def connected(master: Master) -> Master:
    master.connect()
    return master


@pytest.fixture
def unlocked(connected: Master) -> Master:
    connected.unlock(0x01)
    connected.unlock(0x08)
    return connected
