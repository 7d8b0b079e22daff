"""Diagnostic frames to and from a bench in virtual time."""

from __future__ import annotations

from dataclasses import dataclass

from rrins.firmware_py.diagnostics import table
from rrins.host_tools.diag.connection import LibraryConnection
from rrins.host_tools.diag.target import Target
from rrins.host_tools.diag.transport import DiagnosticFrame, request_message
from rrins.host_tools.testing.recording import FrameRing
from rrins.host_tools.testing.virtual_bus import SteppedBench


class BenchTransport:
    """A client on the bus of a bench; each receive advances the bench by one epoch.

    Parameters
    ----------
    bench : SteppedBench
        In the direct way or in lockstep.
    ring : FrameRing
        The recording of its bus.
    """

    keeps_pace = True

    def __init__(self, bench: SteppedBench, ring: FrameRing) -> None:
        self._bench = bench
        self._ring = ring

    @property
    def now_ns(self) -> int:
        """Simulated time of the bench, ns."""
        return round(self._bench.time_s * 1e9)

    def send(self, data: bytes) -> None:
        """Send a frame of a request."""
        self._bench.send_frame(request_message(data))

    def receive(self, wait_s: float) -> list[DiagnosticFrame]:
        """Let an epoch pass; return the diagnostic frames in it, requests first."""
        first = self._ring.total
        self._bench.advance(self._bench.scenario.period_ns / 1e9)
        heard = []
        for can_id in (table.request_id(), table.response_id()):
            for frame in self._ring.find(can_id, first)[0]:
                data = int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]
                heard.append(DiagnosticFrame(data, can_id == table.response_id()))
        return heard

    def hears_others(self, wait_s: float) -> bool:
        """Return True: a bench is never silent."""
        return True

    def close(self) -> None:
        """Leave the bus."""


@dataclass(frozen=True, kw_only=True)
class BenchTarget(Target):
    """The navigation computer of a bench."""

    medium: BenchTransport

    def connect(self) -> LibraryConnection:
        """Connect to the bus."""
        return LibraryConnection(self.medium, "bench")
