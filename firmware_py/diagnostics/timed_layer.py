"""The layer of the library can-isotp, with its timers on our clock, for a classic bus.

The library's timers use the wall clock; they are public attributes of its layer. Every timer
that it sets there becomes one of the same length on the given clock, so timeouts and
separation times are the same at any simulation speed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import isotp
from isotp.tools import Timer

from rrins.firmware_py.diagnostics import network_frame

_NS_PER_S = 1_000_000_000


class LayerClock:
    """The time of a layer, set by its caller."""

    def __init__(self) -> None:
        self.now_ns = 0


class _Timer(Timer):
    """A timer of the library on our clock; never shorter than `floor_ns`."""

    def __init__(self, timeout_s: float, clock: LayerClock, floor_ns: int = 0) -> None:
        self._clock = clock
        self._floor_ns = floor_ns
        super().__init__(timeout_s)

    def set_timeout(self, timeout: float) -> None:
        self.timeout = max(round(timeout * _NS_PER_S), self._floor_ns)

    def start(self, timeout: float | None = None) -> None:
        if timeout is not None:
            self.set_timeout(timeout)
        self.start_time = self._clock.now_ns

    def elapsed_ns(self) -> int:
        return 0 if self.start_time is None else self._clock.now_ns - self.start_time

    def elapsed(self) -> float:
        return self.elapsed_ns() / _NS_PER_S

    def is_timed_out(self) -> bool:
        return self.start_time is not None and self.elapsed_ns() >= self.timeout


class TimedLayer(isotp.TransportLayerLogic):
    """A layer of the library, without a thread.

    Parameters
    ----------
    separation_ns : int
        Minimum time between consecutive frames.
    receive : callable
        Returns the next frame, or None.
    **layer
        Further arguments of the library's layer.
    """

    def __init__(
        self,
        clock: LayerClock,
        separation_ns: int,
        receive: Callable[[], isotp.CanMessage | None],
        **layer: Any,
    ) -> None:
        self._clock = clock
        self._separation_ns = separation_ns
        self._receive = receive
        super().__init__(rxfn=lambda timeout_s: self._next_accepted(), **layer)
        self.rate_limiter.disable()

    def _next_accepted(self) -> isotp.CanMessage | None:
        """Return the next frame that is not ignored in the current state."""
        while (message := self._receive()) is not None:
            missing = self.rx_frame_length - len(self.rx_buffer) if self.is_rx_active() else None
            awaits = self.tx_state == self.TxState.WAIT_FC
            data = network_frame.accepted(bytes(message.data), missing, awaits)
            if data is None:
                continue
            if network_frame.has_unknown_state(data):
                self.stop_sending()
                continue
            message.data = data
            return message
        return None

    @property
    def timer_rx_fc(self) -> Timer:
        """Timeout of the awaited flow control."""
        return self._timer_rx_fc

    @timer_rx_fc.setter
    def timer_rx_fc(self, timer: Timer) -> None:
        self._timer_rx_fc = _Timer(timer.timeout / _NS_PER_S, self._clock)

    @property
    def timer_rx_cf(self) -> Timer:
        """Timeout of the awaited consecutive frame."""
        return self._timer_rx_cf

    @timer_rx_cf.setter
    def timer_rx_cf(self, timer: Timer) -> None:
        self._timer_rx_cf = _Timer(timer.timeout / _NS_PER_S, self._clock)

    @property
    def timer_tx_stmin(self) -> Timer:
        """Time until the next consecutive frame may be sent."""
        return self._timer_tx_stmin

    @timer_tx_stmin.setter
    def timer_tx_stmin(self, timer: Timer) -> None:
        self._timer_tx_stmin = _Timer(timer.timeout / _NS_PER_S, self._clock, self._separation_ns)
