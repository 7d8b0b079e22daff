"""Unix time from the time of a bus, for programs that take time stamps for seconds since 1970."""

from __future__ import annotations

from typing import Final

from rrins.host_tools.bus.datagram import HOST
from rrins.host_tools.bus.end import BusEnd

EARLIEST_NS: Final = 1_000_000_000_000_000_000
"""Time from which on a bus keeps Unix time itself: 9 September 2001. Simulated time is smaller."""


class UnixTime:
    """The Unix time of what one end receives: that of the bus's time 0, plus the time of the bus.

    In a rehearsal time 0 is the hardware's power-on, so all ends agree whatever the speed, and
    faster than real time their Unix time runs ahead of the clock. An end that attached before the
    host's first batch takes the moment at which it receives that batch.

    Parameters
    ----------
    end : BusEnd
        Knows the Unix time of time 0 if the host has sent a batch already.
    """

    def __init__(self, end: BusEnd) -> None:
        self._end = end
        self._origin_ns = 0
        self._is_sure = False

    def of(self, time_ns: int, sender: int, now_ns: int) -> int:
        """Return the Unix time of a batch in nanoseconds.

        Parameters
        ----------
        time_ns : int
            Time of the batch.
        sender : int
            Node number.
        now_ns : int
            Unix time now.
        """
        if time_ns >= EARLIEST_NS:
            return time_ns
        if not self._is_sure:
            self._is_sure = sender == HOST or bool(self._end.origin_ns)
            if self._is_sure or not self._origin_ns:
                self._origin_ns = self._end.origin_ns or now_ns - time_ns
        return self._origin_ns + time_ns
