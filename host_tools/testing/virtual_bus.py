"""A python-can bus of a bench in the direct way: receiving advances the bench's time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import can

from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.testing.recording import FrameRing, Sender, messages_of

if TYPE_CHECKING:
    from can.typechecking import CanFilters

_NS_PER_S = 1_000_000_000


class SteppedBench(Protocol):
    """A bench in virtual time, as seen by clients of its bus."""

    scenario: Scenario

    @property
    def time_s(self) -> float:
        """Simulated time since power-on."""

    def advance(self, seconds: float) -> None:
        """Let simulated time pass."""

    def send_frame(self, message: can.Message) -> None:
        """Put a message on the bus, just before the next epoch."""


class VirtualTimeBus(can.BusABC):
    """A python-can bus in front of a bench, for tools.

    Timeouts and timestamps are simulated seconds. `recv` advances the bench epoch by epoch until
    there is a frame, so a tool never times out because the machine is slow. The bus receives all
    frames sent after its creation, except those of the test itself.

    Parameters
    ----------
    bench : SteppedBench
    ring : FrameRing
        The recording of its bus.
    """

    def __init__(self, bench: SteppedBench, ring: FrameRing) -> None:
        self._bench = bench
        self._ring = ring
        self._next = ring.total
        self.channel_info = "bench"
        super().__init__(channel="bench")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame; None if there is none within `timeout` simulated seconds.

        Raises
        ------
        BenchError
            If the scenario is over.
        """
        period_s = self._bench.scenario.period_ns / _NS_PER_S
        epochs = math.inf if timeout is None else math.ceil(timeout / period_s)
        while True:
            message = self._next_message()
            if message is not None:
                return message
            if epochs <= 0:
                return None
            self._bench.advance(period_s)
            epochs -= 1

    def _next_message(self) -> can.Message | None:
        while self._next < self._ring.total:
            frame, time_ns, sender = self._ring.at(self._next)
            self._next += 1
            if sender == Sender.TEST:
                continue
            (message,) = messages_of(frame, "bench")
            message.timestamp = time_ns / _NS_PER_S
            if self._matches_filters(message):
                return message
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a message on the bus, just before the next epoch."""
        self._bench.send_frame(msg)

    def _apply_filters(self, filters: CanFilters | None) -> None: ...
