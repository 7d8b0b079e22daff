"""The hosting end of a channel; as a program, a hub that runs until its last peer has left.

The hub has no thread: the bus moves while its owner sends, receives or serves. ::

    python -m rrins.host_tools.bus.hub CHANNEL

hosts a channel and prints one line, ``ready`` or why not; then it goes on in the background.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Iterable, Sequence
from typing import Final

from rrins.host_tools.bus.channel import HostedError
from rrins.host_tools.bus.datagram import receive_buffer
from rrins.host_tools.bus.end import Backlog, BusTimeoutError, deadline_of, now, seconds_left
from rrins.host_tools.bus.guard import SIDES, BusSummary
from rrins.host_tools.bus.peer import PeerInfo, check_name
from rrins.host_tools.bus.relay import TIMED_OUT, Relay
from rrins.host_tools.errors import BusError

QUEUE_LIMIT: Final = 4 * 1024 * 1024
"""Bytes that may wait for an observer, or for a host that sends and does not receive."""

READY: Final = "ready"
"""Printed by the program when its channel is ready for peers."""

_UNSERVED_NS: Final = 10_000_000
_BRIEF_STEPS: Final = 64
_PATIENCE_S: Final = 10.0


class Hub:
    """The host of a channel, and a participant of it: node 0. A `BusEnd`.

    Parameters
    ----------
    channel, name, exclusive, receive_own, queue_limit, foreign_senders
        As of `RrinsBus`.

    Raises
    ------
    BusError
        If another process hosts the channel, or its place is not safe.
    """

    def __init__(
        self,
        channel: str,
        *,
        name: str = "host",
        exclusive: bool = False,
        receive_own: bool = False,
        queue_limit: int = QUEUE_LIMIT,
        foreign_senders: bool = False,
    ) -> None:
        self.number = 0
        self._channel = channel
        self._receive_own = receive_own
        self._queue_limit = queue_limit
        self._relay = Relay(
            channel,
            PeerInfo(check_name(name), os.getpid(), "node", 0),
            exclusive,
            queue_limit,
            foreign_senders,
        )
        self._step = self._relay.step
        self._lock = self._relay.lock
        self._receive_lock = threading.Lock()
        self._buffer = bytearray()  # made when it is first needed
        self._backlog = Backlog()
        self._served_ns = now()

    @property
    def peers(self) -> tuple[PeerInfo, ...]:
        """The attached peers in order of attachment; the host is not among them."""
        return tuple(peer.info for peer in self._relay.receivers)

    @property
    def origin_ns(self) -> int:
        """Unix time of time 0 of the host's batches in nanoseconds; 0 until it has sent one."""
        return self._relay.origin_ns

    def limit_others(self) -> None:
        """Hold third parties to their share of frames before the first epoch, too."""
        with self._lock:
            self._relay.open_epoch()

    def statistics(self) -> BusSummary:
        """Return what was not let through so far."""
        return self._relay.guard.statistics()

    def require(self, names: Iterable[str]) -> None:
        """Make sending and receiving fail once one of these peers has left; see `RrinsBus`."""
        with self._lock:
            required: dict[int, str] = {}
            for name in names:
                numbers = [info.number for info in self.peers if info.name == name]
                if not numbers:
                    raise BusError(f"{name!r} is not attached to channel {self._channel!r}")
                required.update(dict.fromkeys(numbers, name))
            self._relay.required = required
            self._relay.lost = ""

    def wait_for(self, name: str, timeout: float | None) -> PeerInfo:
        """Serve the channel until a peer of that name is attached; see `RrinsBus`."""
        deadline = deadline_of(timeout)
        self._serve_briefly()  # who has gone is not to be found
        while True:
            for info in self.peers:
                if info.name == name:
                    return info
            left = seconds_left(deadline)
            with self._receive_lock:
                self._relay.check()
                if self._drive(left) == TIMED_OUT and left == 0.0:
                    raise BusTimeoutError(
                        f"{name!r} has not attached to channel {self._channel!r} in {timeout:g} s"
                    )

    def send(self, datagram: memoryview, timeout: float | None) -> None:
        """Send a datagram to all peers, waiting while a node holds up the bus."""
        relay = self._relay
        if now() - self._served_ns > _UNSERVED_NS:
            self._serve_briefly()
        deadline: int | None = None
        is_waiting = False
        while True:
            with self._lock:
                if relay.lost or relay.is_closed:
                    relay.check()
                if not relay.stuck:
                    relay.send(datagram)
                    if self._receive_own:
                        self._backlog.keep(datagram)
                        relay.wake()
                    return
            if not is_waiting:
                is_waiting = True
                deadline = deadline_of(timeout)
            left = seconds_left(deadline)
            if relay.step_aside(left) == TIMED_OUT and left == 0.0:
                raise BusTimeoutError(
                    f"channel {self._channel!r} is held up by "
                    + ", ".join(str(peer) for peer in relay.stuck)
                )

    def receive(self, buffer: bytearray, timeout: float | None) -> int:
        """Receive the next datagram of a peer, relayed to the others already."""
        with self._receive_lock:
            relay = self._relay
            self._served_ns = now()
            deadline = deadline_of(timeout)
            wait = -1.0 if timeout is None else max(timeout, 0.0)
            while True:
                if self._backlog:
                    return self._backlog.pop(buffer)
                if relay.lost or relay.is_closed:
                    relay.check()
                size = self._step(buffer, wait)
                if size > 0:
                    return size
                if size == TIMED_OUT and wait == 0.0:
                    return 0
                wait = seconds_left(deadline)

    def direct_ends(self) -> tuple[int, int, int, int] | None:
        """Return socket, door and number of the other side, and a listener's socket, or -1.

        For compiled code. None while there are more peers, or something waits. What the side sends
        is not looked at; once the listener sends something, Python is to take it.
        """
        relay = self._relay
        if self._backlog or self._receive_own or relay.lost or relay.stuck or not relay.origin_ns:
            return None
        peers = relay.receivers
        sides = [peer for peer in peers if peer.info.name in SIDES]
        if len(sides) != 1 or len(peers) > 2 or any(one.queue or one.receive_own for one in peers):
            return None
        listener = next((peer.fd for peer in peers if peer is not sides[0]), -1)
        return sides[0].fd, relay.door, sides[0].number, listener

    def go_on(self, left_over: memoryview, time_ns: int, batches: int) -> None:
        """Take what compiled code has received and not used as if it had just come."""
        self._served_ns = now()
        if batches:
            self._relay.note_batches(time_ns, batches)
        if not left_over:
            return
        with self._receive_lock:
            buffer = self._room()
            buffer[: len(left_over)] = left_over
            size = self._relay.take_left_over(buffer, len(left_over))
            if size:
                self._backlog.keep(memoryview(buffer)[:size])

    def rest(self, seconds: float) -> None:
        """Serve the channel for some time; what arrives is kept for `receive`."""
        deadline = deadline_of(seconds)
        with self._receive_lock:
            while left := seconds_left(deadline):
                self._relay.check()
                self._drive(left)

    def serve(self, patience: float) -> None:
        """Relay until the last peer has left; `patience`: seconds to wait for the first."""
        buffer = self._room()
        deadline = deadline_of(patience)
        relay = self._relay
        while not relay.has_had_company and seconds_left(deadline):
            self._step(buffer, seconds_left(deadline))
        while relay.has_company or self._step(buffer, 0.0) != TIMED_OUT:
            self._step(buffer, -1.0 if relay.has_company else 0.0)

    def close(self) -> None:
        """Let the peers receive what is queued for them, and release the channel; idempotent."""
        relay = self._relay
        with self._lock:
            if relay.is_closed:
                return
            relay.linger()
            relay.is_closed = True
            relay.wake()  # a thread that waits comes back, and finds it closed
        with self._receive_lock, self._lock:
            relay.close()

    def _drive(self, wait: float) -> int:
        """Serve one event and keep the datagram that comes with it."""
        if self._backlog.size > self._queue_limit:
            # The host does not receive. It is a node as well, so the bus waits for it.
            return self._relay.step_aside(wait)
        buffer = self._room()
        size = self._step(buffer, wait)
        if size > 0:
            self._backlog.keep(memoryview(buffer)[:size])
        return size

    def _serve_briefly(self) -> None:
        """Serve a host that only sends, unless another thread receives and so serves already."""
        self._served_ns = now()
        if self._receive_lock.acquire(blocking=False):
            try:
                for _ in range(_BRIEF_STEPS):
                    if self._relay.is_closed or self._drive(0.0) == TIMED_OUT:
                        break
            finally:
                self._receive_lock.release()

    def _room(self) -> bytearray:
        if not self._buffer:
            self._buffer = receive_buffer()
        return self._buffer


def main(arguments: Sequence[str] | None = None) -> int:
    """Host a channel in the background until its last peer has left."""
    parser = argparse.ArgumentParser(
        prog="python -m rrins.host_tools.bus.hub", description=main.__doc__, allow_abbrev=False
    )
    parser.add_argument("channel", help="name or path of the channel")
    channel = parser.parse_args(arguments).channel
    sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # python-can would import it
    # The process that was started ends at once, so whoever started it is not left with a child.
    if os.fork():
        return 0
    os.setsid()
    os.chdir("/")
    try:
        hub = Hub(channel)
    except HostedError:
        print(READY, flush=True)  # another process was faster, and that serves as well
        return 0
    except BusError as error:
        print(error, flush=True)
        return 1
    print(READY, flush=True)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (sys.stdin.fileno(), sys.stdout.fileno(), sys.stderr.fileno()):
        os.dup2(nowhere, descriptor)
    os.close(nowhere)
    try:
        hub.serve(_PATIENCE_S)
    finally:
        hub.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
