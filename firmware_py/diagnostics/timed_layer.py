"""The library can-isotp's layer, its timers on a clock of ours.

The library keeps its timers by the wall clock; they are public attributes of its layer. Whatever
timer it sets there is taken as one of the same length on the given clock: so timeouts and
separation times are the same at any speed of a rehearsal.
"""

from __future__ import annotations

from typing import Any

import isotp
from isotp.tools import Timer

_NS_PER_S = 1_000_000_000


class LayerClock:
    """The time of a layer, set by whoever runs it.

    Attributes
    ----------
    now_ns : int
    """

    def __init__(self) -> None:
        self.now_ns = 0


class _Timer(Timer):
    """A timer of the library on a clock of ours; never shorter than `floor_ns`."""

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
    clock : LayerClock
    separation_ns : int
        The least time from one consecutive frame to the next.
    **layer
        What the library's layer takes.
    """

    def __init__(self, clock: LayerClock, separation_ns: int, **layer: Any) -> None:
        self._clock = clock
        self._separation_ns = separation_ns
        super().__init__(**layer)
        self.rate_limiter.disable()

    @property
    def timer_rx_fc(self) -> Timer:
        """Timeout of the flow control that is waited for."""
        return self._timer_rx_fc

    @timer_rx_fc.setter
    def timer_rx_fc(self, timer: Timer) -> None:
        self._timer_rx_fc = _Timer(timer.timeout / _NS_PER_S, self._clock)

    @property
    def timer_rx_cf(self) -> Timer:
        """Timeout of the consecutive frame that is waited for."""
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
