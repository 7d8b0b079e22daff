"""Interface of an end of the bus, whether it hosts the channel or is attached to it."""

from __future__ import annotations

import select
import time
from collections import deque
from typing import Final, Protocol

from rrins.host_tools.errors import BusError

now: Final = time.monotonic_ns

_SELECT_LIMIT = 1024  # FD_SETSIZE


class BusTimeoutError(BusError):
    """The bus had no room for a datagram in the time given; nothing of it was sent."""


class BusEnd(Protocol):
    """One end of the bus: datagrams in, datagrams out.

    One thread may send while another receives; what is sent from several threads needs a lock.
    """

    number: int
    """Node number of this end, which its datagrams carry as their sender."""

    @property
    def origin_ns(self) -> int:
        """Unix time of the bus's time 0 in nanoseconds; 0 if this end has not been told."""

    def send(self, datagram: memoryview, timeout: float | None) -> None:
        """Put one datagram on the bus, waiting while a node holds it up.

        Raises
        ------
        BusTimeoutError
            If the bus was held up all the time; nothing was sent.
        BusError
            If the bus has come to its end for this end.
        """

    def receive(self, buffer: bytearray, timeout: float | None) -> int:
        """Receive one datagram into `buffer` and return its size, 0 when the time is over.

        Raises
        ------
        BusError
            If the bus has come to its end for this end, and all that came before is received.
        """

    def direct_ends(self) -> tuple[int, int, int, int] | None:
        """Return socket, door and number of the other side, and a listener's socket.

        For compiled code. The door is a descriptor that can be read while this end has something
        else to do; -1 if it never has. A listener gets from this end what both sides send; -1 if
        there is none. None while compiled code is not to exchange datagrams by itself.
        """

    def go_on(self, left_over: memoryview, time_ns: int, batches: int) -> None:
        """Go on after compiled code.

        With a datagram that it left, and the number of batches that it sent, the last at a time.
        """

    def close(self) -> None:
        """Leave the bus; what was sent still arrives."""


class Backlog:
    """Datagrams that an end has taken in and not received yet.

    Attributes
    ----------
    size : int
        Bytes.
    """

    def __init__(self) -> None:
        self._kept: deque[bytes] = deque()
        self.size = 0

    def __bool__(self) -> bool:
        return bool(self._kept)

    def keep(self, datagram: bytes | memoryview) -> None:
        """Append a datagram."""
        self._kept.append(bytes(datagram))
        self.size += len(datagram)

    def pop(self, buffer: bytearray) -> int:
        """Move the oldest datagram into `buffer`; return its size."""
        kept = self._kept.popleft()
        self.size -= len(kept)
        buffer[: len(kept)] = kept
        return len(kept)


def deadline_of(timeout: float | None) -> int | None:
    """Return the monotonic time in ns at which a time in seconds is over; None for never."""
    return None if timeout is None else now() + int(timeout * 1e9)


def seconds_left(deadline: int | None) -> float:
    """Return the seconds to a deadline, -1 if there is none."""
    return -1.0 if deadline is None else max(0.0, (deadline - now()) / 1e9)


def wait_readable(fd: int, timeout: float) -> bool:
    """Wait until a descriptor can be read, `timeout` seconds at most; return whether it can.

    `select` keeps a time to some 50 µs; `poll` and `epoll` round up to a millisecond, a socket's
    own timeout to a tick of the kernel.
    """
    if fd < _SELECT_LIMIT:
        return bool(select.select([fd], [], [], timeout)[0])
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    return bool(poll.poll(timeout * 1000))
