"""Transports of diagnostic frames to and from a bus, with the time of that bus."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import can
import numpy as np

from rrins.dbc.frame import frame_array
from rrins.firmware_py.diagnostics import table
from rrins.host_tools.bus.interface import RrinsBus

_NS_PER_S = 1_000_000_000
_BATCH = 4096


@dataclass(frozen=True, slots=True)
class DiagnosticFrame:
    """A frame of a response, or of a request: another tool's, or an echo of our own."""

    data: bytes
    is_response: bool


class DiagTransport(Protocol):
    """A client on a bus.

    Attributes
    ----------
    keeps_pace : bool
        Whether the bus waits for this end: time advances only while it receives.
    """

    keeps_pace: bool

    @property
    def now_ns(self) -> int:
        """Time used for timeouts."""

    def send(self, data: bytes) -> None:
        """Send a frame of a request."""

    def receive(self, wait_s: float) -> list[DiagnosticFrame]:
        """Return diagnostic frames, waiting up to `wait_s` seconds of wall clock time."""

    def hears_others(self, wait_s: float) -> bool:
        """Return whether there is any traffic on the bus."""

    def close(self) -> None:
        """Leave the bus."""


def request_message(data: bytes) -> can.Message:
    """Return a frame of a request to the navigation computer."""
    return can.Message(arbitration_id=table.request_id(), is_extended_id=False, data=data)


class EmbeddedTransport:
    """A client on the embedded bus, which delivers whole epochs.

    Parameters
    ----------
    bus : RrinsBus
    keeps_pace : bool
        Whether the bus was opened with `in_step`. Time is then the simulated time of the bus,
        otherwise that of the wall clock.
    """

    def __init__(self, bus: RrinsBus, keeps_pace: bool) -> None:
        self.keeps_pace = keeps_pace
        self._bus = bus
        self._frames = frame_array(_BATCH)
        self._ids = self._frames["can_id"]
        self._request_id, self._response_id = table.request_id(), table.response_id()
        self._bus_ns = 0

    @property
    def now_ns(self) -> int:
        """Nanoseconds of the bus or of the wall clock."""
        return self._bus_ns if self.keeps_pace else time.monotonic_ns()

    def send(self, data: bytes) -> None:
        """Send a frame of a request."""
        self._bus.send(request_message(data))

    def receive(self, wait_s: float) -> list[DiagnosticFrame]:
        """Return the diagnostic frames of the next datagram; none after a timeout."""
        batch = self._bus.recv_batch(self._frames, wait_s)
        if batch is None:
            return []
        self._bus_ns = batch.time_ns
        ids = self._ids[: batch.count]
        found = np.flatnonzero((ids == self._response_id) | (ids == self._request_id))
        return [self._frame(k) for k in found.tolist()]

    def _frame(self, index: int) -> DiagnosticFrame:
        frame = self._frames[index]
        data = int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]
        return DiagnosticFrame(data, bool(frame["can_id"] == self._response_id))

    def hears_others(self, wait_s: float) -> bool:
        """Return whether there is any traffic on the bus."""
        return self._bus.recv_batch(self._frames, wait_s) is not None

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


class MessageTransport:
    """A client on any other python-can bus, timed by the wall clock."""

    keeps_pace = False

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._ids = (table.request_id(), table.response_id())
        self._bus.set_filters([{"can_id": can_id, "can_mask": 0x7FF} for can_id in self._ids])

    @property
    def now_ns(self) -> int:
        """Nanoseconds of the wall clock."""
        return time.monotonic_ns()

    def send(self, data: bytes) -> None:
        """Send a frame of a request."""
        self._bus.send(request_message(data))

    def receive(self, wait_s: float) -> list[DiagnosticFrame]:
        """Return the diagnostic frames received in time."""
        found = []
        message = self._bus.recv(wait_s)
        while message is not None:
            if message.arbitration_id in self._ids and not message.is_error_frame:
                is_response = message.arbitration_id == self._ids[1]
                found.append(DiagnosticFrame(bytes(message.data), is_response))
            message = self._bus.recv(0)
        return found

    def hears_others(self, wait_s: float) -> bool:
        """Return whether there is any traffic on the bus."""
        self._bus.set_filters(None)
        return self._bus.recv(wait_s) is not None

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
