"""The heart of a hub: it admits peers and relays each datagram of one to all others.

It has no thread and no loop, only single steps, and never blocks on a single peer:

- A *node* that takes no more stops the bus. The datagram it has not taken is held, nothing more is
  read from anybody, so the queues of the senders fill and the senders wait.
- An *observer* that takes no more gets a queue of its own; when that is full it is cut off.
- A peer that dies, or sends what is not a datagram of ours, is cut off. The others go on.
- A third party beside the two sides of a rehearsal is held to its own frames (`guard`).

Two polls make that cheap. ``_always`` watches what may be served at any time: the door, and whoever
has something waiting. ``_all`` watches the peers' datagrams and, nested in it, ``_always``. A bus
that is held waits on the former, else on the latter, so new peers cost a running bus no system
call.
"""

from __future__ import annotations

import errno
import logging
import os
import select
import sys
import threading
import time
from typing import Final

from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.admission import Admission, Caller, notice, refuse
from rrins.host_tools.bus.end import wait_readable
from rrins.host_tools.bus.guard import HARDWARE, SIDES, Guard
from rrins.host_tools.bus.peer import Peer, PeerInfo
from rrins.host_tools.errors import BusError

TIMED_OUT: Final = -1
"""Result of a step when nothing has happened in its time."""

_STALL_NS: Final = 1_000_000_000
_STALL_S: Final = 1.0
_LINGER_NS: Final = 1_000_000_000
_GONE: Final = (errno.EPIPE, errno.ECONNRESET)

_log: Final = logging.getLogger("rrins.host_tools.bus")
_now: Final = time.monotonic_ns


class Relay:
    """The peers of a channel, and what goes from each to the others.

    Parameters
    ----------
    host : PeerInfo
        Who hosts it.
    channel, exclusive, queue_limit, foreign_senders
        As of `RrinsBus`.

    Attributes
    ----------
    lock : threading.RLock
        Held while the relay changes, never while it waits.
    receivers : tuple of Peer
        The attached peers in order of attachment.
    stuck : set of Peer
        The nodes that hold up the bus.
    required : dict
        Names, by node number, of the peers without which the host cannot go on.
    lost : str
        Which of them has left, and how; empty while all are there.
    origin_ns : int
        Unix time of time 0 of the host's batches; 0 until it has sent one.
    guard : Guard
        What third parties may do, and what they were refused.
    """

    def __init__(
        self,
        channel: str,
        host: PeerInfo,
        exclusive: bool,
        queue_limit: int,
        foreign_senders: bool = False,
    ) -> None:
        self._channel = channel
        self._host = host
        self._exclusive = exclusive
        self._queue_limit = queue_limit
        self._always = select.epoll()
        self._all = select.epoll()
        self._wake = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        try:
            self._admission = Admission(channel, self._always)
        except BaseException:
            self._close_descriptors()
            raise
        self._always.register(self._wake, select.EPOLLIN)
        self._all.register(self._always.fileno(), select.EPOLLIN)

        self.lock = threading.RLock()
        self.receivers: tuple[Peer, ...] = ()
        self.stuck: set[Peer] = set()
        self.required: dict[int, str] = {}
        self.lost = ""
        self.is_closed = False
        self._peers: dict[int, Peer] = {}  # the receivers by descriptor
        self._leaving: dict[int, Peer] = {}  # cut off, and their last word not yet taken
        self._last_number = 0
        self._held = b""  # the datagram that the stuck nodes have not taken
        self._stuck_ns = 0
        self._stall_told = False
        self.guard = Guard(foreign_senders)
        self._aside: set[Peer] = set()  # not read until the next epoch
        self._bus_time: int | None = None
        self._timekeeper: Peer | None = None
        self.origin_ns = 0
        self._meet()

    @property
    def has_company(self) -> bool:
        """Whether anybody is attached or about to attach."""
        return bool(self._peers) or self._admission.has_callers

    @property
    def has_had_company(self) -> bool:
        """Whether anybody has ever attached."""
        return self._last_number > 0

    def check(self) -> None:
        """Raise if the relay is of no more use to its host.

        Raises
        ------
        BusError
            If it is closed, or a required peer has left.
        """
        if self.is_closed:
            raise BusError(f"channel {self._channel!r} is shut down")
        if self.lost:
            raise BusError(self.lost)

    def step(self, buffer: bytearray, wait: float) -> int:
        """Wait for one event and serve it.

        Parameters
        ----------
        buffer : bytearray
            Takes the datagram that comes with the event.
        wait : float
            Seconds to wait; negative to wait for ever.

        Returns
        -------
        int
            Size of the datagram, relayed already; 0 for an event without one; `TIMED_OUT`.
        """
        if self.stuck:
            return self.step_aside(wait)
        events = self._all.poll(0 if wait > 0 else wait, 1)
        if not events and wait > 0 and wait_readable(self._all.fileno(), wait):
            events = self._all.poll(0, 1)
        if not events:
            return TIMED_OUT
        with self.lock:
            peer = self._peers.get(events[0][0])
            if peer is None or self.stuck:
                self._keep_house()
                return 0
            return self._receive_from(peer, buffer)

    def step_aside(self, wait: float) -> int:
        """Wait for one event that may be served while the bus is held, and serve it.

        Returns
        -------
        int
            0, or `TIMED_OUT`.
        """
        is_told = self._stall_told or not self.stuck
        limit = wait if is_told else _STALL_S if wait < 0 else min(wait, _STALL_S)
        try:
            events = self._always.poll(limit, 1)
        except ValueError:
            self.check()  # closed by another thread a moment ago
            raise
        with self.lock:
            if events:
                self._keep_house()
                return 0
            if self.stuck and not self._stall_told and _now() - self._stuck_ns >= _STALL_NS:
                self._stall_told = True
                names = ", ".join(str(peer) for peer in self.stuck)
                _log.warning("channel %s is held up: %s does not receive", self._channel, names)
        return TIMED_OUT

    def _receive_from(self, peer: Peer, buffer: bytearray) -> int:
        """Read one datagram of a peer and relay it."""
        is_third = self.guard.is_on and peer.info.name not in SIDES
        if is_third and self.guard.must_wait(peer):
            self._set_aside(peer)
            return 0
        try:
            size = peer.end.recv_into(buffer)
        except (BlockingIOError, ConnectionResetError):
            return 0  # after a reset the peer's last datagrams can still be read
        if not size:
            self._drop(peer, "has disappeared")
            return 0
        return self._pass_on(peer, buffer, size, is_third)

    @property
    def door(self) -> int:
        """Descriptor that is readable while something may be served besides a peer's datagram."""
        return self._always.fileno()

    def note_batches(self, time_ns: int, batches: int) -> None:
        """Take note of the host's batches that compiled code has sent, and the last one's time."""
        with self.lock:
            self._bus_time = time_ns
            self._timekeeper = None
            self.open_epoch(batches)

    def take_left_over(self, buffer: bytearray, size: int) -> int:
        """Relay a datagram of the other side that compiled code has received; return its size."""
        with self.lock:
            side = next(peer for peer in self.receivers if peer.info.name in SIDES)
            return self._pass_on(side, buffer, size, is_third=False)

    def _pass_on(self, peer: Peer, buffer: bytearray, size: int, is_third: bool) -> int:
        """Relay a datagram of a peer, if it may; return the size of what is left of it."""
        try:
            kind, flags, count, sender, _, time_ns = datagram.parse(buffer, size)
            if kind == datagram.BYE:
                self._drop(peer)
                return 0
            if kind == datagram.COUNTS and sender == peer.number:
                self._tell(peer, datagram.COUNTS, self.guard.last_line, self.guard.refused)
                peer.allowance -= 1
                return 0
            if kind not in (datagram.FRAMES, datagram.FRAMES_FD) or sender != peer.number:
                raise datagram.ProtocolError(f"a datagram of kind {kind} from node {sender}")
            if is_third:
                size = self._checked(peer, buffer, size, kind, flags, count)
                if not size:
                    return 0
                if self.guard.has_hardware:  # its time is everybody's
                    flags |= datagram.UNSTAMPED
        except datagram.ProtocolError as error:
            self.guard.cut_off += 1
            self._tell(peer, datagram.BYE, f"this peer was cut off, because it sent {error}")
            self._drop(peer, f"is cut off: it sent {error}", notice("misfit"))
            return 0
        if flags & datagram.UNSTAMPED:
            datagram.put_time(buffer, flags, self._time())
        else:
            self._bus_time = time_ns
            self._timekeeper = peer
        if len(self.receivers) > 1 or peer.receive_own:
            self._spread(memoryview(buffer)[:size], peer)
        return size

    def _checked(
        self, peer: Peer, buffer: bytearray, size: int, kind: int, flags: int, count: int
    ) -> int:
        """Return the size of what is left of a third party's datagram; name who sends the rest."""
        left = self.guard.check(peer, buffer, size, kind, flags, count)
        if left < size and (line := self.guard.due_line()):
            _log.warning("channel %s: %s", self._channel, line, extra=notice("foreign frames"))
            self._tell(peer, datagram.NOTE, line, self.guard.refused)
        return left

    def _set_aside(self, peer: Peer) -> None:
        """Read nothing more from a peer until the next epoch."""
        self._aside.add(peer)
        self._all.unregister(peer.fd)
        if line := self.guard.hold_back(peer):
            _log.warning("channel %s: %s %s", self._channel, peer, line, extra=notice("flood"))

    def open_epoch(self, epochs: int = 1) -> None:
        """Begin an epoch, or some: those who had to wait may send again."""
        self.guard.open_epoch(epochs)
        if self._aside:
            for peer in self._aside:
                self._all.register(peer.fd, select.EPOLLIN)
            self._aside.clear()

    def send(self, view: memoryview) -> None:
        """Spread a datagram of the host; only while nobody is `stuck`."""
        flags = view[datagram.FLAGS_OFFSET]
        if flags & datagram.CLOSES_EPOCH and self._host.name == HARDWARE:
            self.open_epoch()
        if flags & datagram.UNSTAMPED:
            datagram.put_time(view, flags, self._time())
        else:
            self._bus_time = datagram.time_of(view)
            self._timekeeper = None
            if not self.origin_ns:
                self.origin_ns = time.time_ns() - self._bus_time
        self._spread(view, None)

    def _spread(self, view: memoryview, source: Peer | None) -> None:
        for peer in self.receivers:
            if peer is source and not peer.receive_own:
                continue
            if peer.queue:
                self._enqueue(peer, view)
                continue
            try:
                peer.send(view)
            except OSError as error:
                if error.errno in _GONE:
                    continue  # noticed in its turn, after its last datagrams were read
                if peer.is_observer:
                    self._enqueue(peer, view)
                else:
                    self._hold(peer, view)

    def _hold(self, peer: Peer, view: memoryview) -> None:
        if not self.stuck:
            self._held = bytes(view)
            self._stuck_ns = _now()
            self._stall_told = False
        self.stuck.add(peer)
        self._always.register(peer.fd, select.EPOLLOUT)

    def _enqueue(self, peer: Peer, view: memoryview) -> None:
        if peer.queued + len(view) <= self._queue_limit:
            if not peer.queue:
                self._always.register(peer.fd, select.EPOLLOUT)
            peer.queue.append(bytes(view))
            peer.queued += len(view)
            return
        self._forget(peer, f"is cut off: {peer.queued} bytes waited for it to receive")
        peer.queue.clear()
        peer.queued = 0
        reason = f"this observer was cut off: {self._queue_limit} bytes waited for it to receive"
        peer.queue.append(datagram.control(datagram.BYE, reason))
        self._leaving[peer.fd] = peer

    def _flush(self, peer: Peer) -> None:
        """Send a peer its queued data, as far as it accepts it."""
        try:
            if peer in self.stuck:
                peer.send(self._held)
                self.stuck.discard(peer)
            while peer.queue:
                peer.send(peer.queue[0])
                peer.queued -= len(peer.queue.popleft())
        except BlockingIOError:
            return
        except OSError as error:
            if error.errno not in _GONE:
                return
            self.stuck.discard(peer)
            peer.queue.clear()
            peer.queued = 0
        self._always.unregister(peer.fd)
        if self._leaving.pop(peer.fd, None) is not None:
            peer.end.close()
            self._admission.reopen()

    def _time(self) -> int:
        return time.time_ns() if self._bus_time is None else self._bus_time

    # Coming and going

    def _keep_house(self) -> None:
        """Serve everything that may be served while the bus is held."""
        if self.is_closed:
            return
        for fd, _ in self._always.poll(0):
            if fd == self._wake:
                os.eventfd_read(self._wake)
            elif self._admission.owns(fd):
                caller = self._admission.serve(fd)
                if caller is not None:
                    self._admit(caller)
            else:
                peer = self._peers.get(fd) or self._leaving.get(fd)
                if peer is not None:
                    self._flush(peer)

    def _admit(self, caller: Caller) -> None:
        wants_alone = bool(caller.flags & datagram.EXCLUSIVE)
        holder = None
        if caller.name == self._host.name and (wants_alone or self._exclusive):
            holder = self._host.pid
        for peer in self.receivers:
            is_rival = peer.info.name == caller.name and (wants_alone or peer.exclusive)
            if is_rival and not peer.has_hung_up():
                holder = peer.info.pid
        if holder is not None:
            refuse(
                caller.end,
                f"the name {caller.name!r} on channel {self._channel!r} belongs to "
                f"process {holder}; end it, or take another name",
            )
            return
        self._last_number += 1
        peer = Peer(caller.end, self._last_number, caller.name, caller.flags)
        welcome = datagram.control(
            datagram.WELCOME,
            self._host.name,
            sender=peer.number,
            epoch=self._host.pid,
            time_ns=self.origin_ns,
        )
        try:
            peer.send(welcome)
        except OSError as error:
            _log.warning("%s went before it was welcome: %s", peer, error.strerror)
            peer.end.close()
            return
        self._peers[peer.fd] = peer
        self.receivers += (peer,)
        self._all.register(peer.fd, select.EPOLLIN)
        self._meet()

    def _meet(self) -> None:
        self.guard.meet({self._host.name, *(peer.info.name for peer in self.receivers)})

    def _drop(self, peer: Peer, why: str = "", extra: dict[str, str] | None = None) -> None:
        """Disconnect a peer; log the reason unless it left properly."""
        self._forget(peer, why, extra)
        if peer in self.stuck or peer.queue:
            self._always.unregister(peer.fd)
            self.stuck.discard(peer)
        peer.end.close()
        self._admission.reopen()

    def _forget(self, peer: Peer, why: str, extra: dict[str, str] | None = None) -> None:
        del self._peers[peer.fd]
        self.receivers = tuple(self._peers.values())
        self._meet()
        if peer in self._aside:
            self._aside.discard(peer)
        else:
            self._all.unregister(peer.fd)
        if self._timekeeper is peer:
            self._timekeeper = None
            self._bus_time = None
        if why:
            _log.warning("channel %s: %s %s", self._channel, peer, why, extra=extra)
        if peer.number in self.required:
            self.lost = f"channel {self._channel!r}: {peer} {why or 'has left'}"

    def _tell(self, peer: Peer, kind: int, text: str, frames: int = 0) -> None:
        """Send a peer a word, if it takes it; of a last word it gets the bare end instead."""
        if peer.queue or peer in self.stuck:
            return
        try:
            peer.send(datagram.control(kind, text, epoch=frames))
        except OSError as error:
            _log.debug("%s does not take a word: %s", peer, error.strerror)

    # The end

    def wake(self) -> None:
        """Let threads that wait come back for a moment."""
        os.eventfd_write(self._wake, 1)

    def linger(self) -> None:
        """Let the peers take what waits for them, until they have taken nothing for a moment."""
        if os.getpid() != self._host.pid:
            return
        least, end = sys.maxsize, 0
        while waits := len(self.stuck) + sum(len(peer.queue) for peer in self.receivers):
            if waits < least:
                least, end = waits, _now() + _LINGER_NS
            left = end - _now()
            if left <= 0:
                _log.warning("channel %s closes before all was received", self._channel)
                return
            self.step_aside(left / 1e9)

    def close(self) -> None:
        """Tell the peers that the channel closes, and release it."""
        if os.getpid() == self._host.pid:
            for peer in self.receivers:
                self._tell(peer, datagram.BYE, f"process {self._host.pid} has closed it")
            self._admission.close()
        else:  # a child of the host, which has inherited the sockets and none of the rights
            self._admission.abandon()
        for peer in (*self.receivers, *self._leaving.values()):
            peer.end.close()
        self._peers.clear()
        self._leaving.clear()
        self._aside.clear()
        self.stuck.clear()
        self.receivers = ()
        self._close_descriptors()

    def _close_descriptors(self) -> None:
        self._all.close()
        self._always.close()
        os.close(self._wake)
