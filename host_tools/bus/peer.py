"""One attached process, as the hub sees it."""

from __future__ import annotations

import re
import select
import socket
from collections import deque
from dataclasses import dataclass
from typing import Final

from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.ownership import credentials
from rrins.host_tools.errors import BusError

_NAME: Final = re.compile(r"[\x21-\x7e]{1,64}")
_SEND_BUFFER: Final = 4 * 1024 * 1024
_SHALLOW_BUFFER: Final = 33 * 1024  # the kernel doubles it: just above the longest datagram


@dataclass(frozen=True)
class PeerInfo:
    """Who is attached."""

    name: str  #: what the peer calls itself
    pid: int  #: its process, as reported by the kernel
    role: str  #: ``"node"`` or ``"observer"``
    number: int  #: its node number, unique for the life of the hub


class Peer:
    """An attached process: its socket, its wishes by its `datagram.HELLO`, what waits for it."""

    __slots__ = (
        "allowance",
        "end",
        "epoch",
        "exclusive",
        "fd",
        "info",
        "is_observer",
        "number",
        "queue",
        "queued",
        "receive_own",
        "send",
    )

    def __init__(self, end: socket.socket, number: int, name: str, flags: int) -> None:
        self.end = end
        self.fd = end.fileno()
        self.send = end.send  # bound once: a lookup less for each datagram
        self.number = number
        self.is_observer = bool(flags & datagram.OBSERVER)
        self.exclusive = bool(flags & datagram.EXCLUSIVE)
        self.receive_own = bool(flags & datagram.RECEIVE_OWN)
        if flags & datagram.IN_STEP:
            end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SHALLOW_BUFFER)
        self.info = PeerInfo(
            name, credentials(end)[0], "observer" if self.is_observer else "node", number
        )
        self.queue: deque[bytes] = deque()  # of an observer that lags, or of a peer's last word
        self.queued = 0  # bytes in the queue
        self.allowance = 0  # frames that a third party may send now, and
        self.epoch = 0  # the epoch for which that was reckoned; see `guard`

    def has_hung_up(self) -> bool:
        """Return whether the peer has ended, even if its last datagrams are still to be read."""
        poll = select.poll()
        poll.register(self.fd, 0)
        return bool(poll.poll(0))

    def __str__(self) -> str:
        return f"{self.info.role} {self.info.name!r} (process {self.info.pid})"


def widen(end: socket.socket) -> None:
    """Ask the kernel for a deep send queue; it grants what net.core.wmem_max allows."""
    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)


def check_name(name: str) -> str:
    """Return `name` if a peer may carry it; else raise `BusError`."""
    if not _NAME.fullmatch(name):
        raise BusError(f"{name!r} is not a valid node name: use 1 to 64 visible ASCII characters")
    return name
