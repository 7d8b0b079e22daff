"""A python-can bus of a bench in the direct way: while it receives, the bench's time passes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import can

from host_tools.testing.recording import FrameRing, Sender, messages_of

if TYPE_CHECKING:
    from host_tools.testing.bench import Bench

_NS_PER_S = 1_000_000_000


class VirtualTimeBus(can.BusABC):
    """What a tool takes for a bus.

    Timeouts and timestamps are simulated seconds. `recv` moves the bench on, epoch by epoch, until
    there is a frame; so a tool that waits for an answer gets it at once, on a machine however slow.
    It gets all frames but the test's own, from the moment on in which it was made.

    Parameters
    ----------
    bench : Bench
    ring : FrameRing
        What was on its bus.
    """

    def __init__(self, bench: Bench, ring: FrameRing) -> None:
        self._bench = bench
        self._ring = ring
        self._next = ring.total
        self.channel_info = "bench"
        super().__init__(channel="bench")

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame; None when there is none for `timeout` simulated seconds.

        Raises
        ------
        BenchError
            When the scenario is over.
        """
        period_s = self._bench.scenario.period_ns / _NS_PER_S
        epochs = math.inf if timeout is None else math.ceil(timeout / period_s)
        while True:
            message = self._take()
            if message is not None:
                return message
            if epochs <= 0:
                return None
            self._bench.advance(period_s)
            epochs -= 1

    def _take(self) -> can.Message | None:
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

    def _apply_filters(self, filters: Any) -> None: ...
