"""Admission to a hub: accepts connections and identifies callers before they may attach."""

from __future__ import annotations

import errno
import logging
import os
import select
import socket
from collections import Counter
from typing import Final, NamedTuple

from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import Claim
from rrins.host_tools.bus.ownership import credentials, may_attach
from rrins.host_tools.bus.peer import check_name, widen
from rrins.host_tools.errors import BusError

_log: Final = logging.getLogger("rrins.host_tools.bus")

_AT_ONCE: Final = 16  # connections accepted in a turn: the bus goes on between two
_MOST_CALLERS: Final = 64


def notice(deed: str) -> dict[str, str]:
    """Return the attribute of a log record that tells the user of a rehearsal what others do."""
    return {"deed": deed}


class Caller(NamedTuple):
    """A connecting process that has identified itself."""

    end: socket.socket
    name: str
    flags: int


class Admission:
    """The listener of a channel, and the callers that have not introduced themselves yet.

    Parameters
    ----------
    channel : str
        Name or path of the channel to host.
    poll : select.epoll
        Where the hub waits; the door registers its sockets there.
    """

    def __init__(self, channel: str, poll: select.epoll) -> None:
        self._claim = Claim(channel)
        self._listener = self._claim.listener
        self._listener_fd = self._listener.fileno()
        self._poll = poll
        self._callers: dict[int, socket.socket] = {}
        self._processes: dict[int, int] = {}  # of each caller
        self._buffer = datagram.receive_buffer()
        self._is_paused = False
        poll.register(self._listener_fd, select.EPOLLIN)

    @property
    def has_callers(self) -> bool:
        """Whether callers are waiting."""
        return bool(self._callers)

    def owns(self, fd: int) -> bool:
        """Return whether `fd` is the listener or a caller."""
        return fd == self._listener_fd or fd in self._callers

    def serve(self, fd: int) -> Caller | None:
        """Serve an event of the listener or a caller; return a properly identified caller."""
        if fd == self._listener_fd:
            self.accept()
            return None
        end = self._callers[fd]
        try:
            size = end.recv_into(self._buffer)
        except BlockingIOError:
            return None
        except OSError:
            size = 0
        self._forget(fd)
        if not size:  # called and went: somebody only looked whether the channel is hosted
            end.close()
            return None
        try:
            kind, flags, count, *_ = datagram.parse(self._buffer, size)
            if kind != datagram.HELLO:
                raise datagram.ProtocolError(f"a first datagram of kind {kind}")
            name = check_name(datagram.text_of(self._buffer, count))
        except BusError as error:
            pid, _ = credentials(end)
            _log.warning("turned away process %d: it sent %s", pid, error, extra=notice("misfit"))
            refuse(end, str(error))
            return None
        return Caller(end, name, flags)

    def accept(self) -> None:
        """Accept pending connections, some at a time."""
        for _ in range(_AT_ONCE):
            try:
                end, _ = self._listener.accept()
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno not in (errno.EMFILE, errno.ENFILE):
                    raise BusError(f"cannot accept a caller: {error.strerror}") from error
                # Without a free descriptor the listener would be ready for ever.
                self._poll.unregister(self._listener_fd)
                self._is_paused = True
                _log.warning("no descriptor is free for another peer; they wait for one to leave")
                return
            end.setblocking(False)
            widen(end)
            pid, uid = credentials(end)
            if not may_attach(uid):
                _log.warning(
                    "turned away process %d: it belongs to another user (uid %d)",
                    pid,
                    uid,
                    extra=notice("other user"),
                )
                refuse(end, f"the bus belongs to another user (uid {os.geteuid()})")
                continue
            if len(self._callers) >= _MOST_CALLERS:
                self._make_room()
            self._callers[end.fileno()] = end
            self._processes[end.fileno()] = pid
            self._poll.register(end.fileno(), select.EPOLLIN)

    def reopen(self) -> None:
        """Listen again, now that a descriptor is free."""
        if self._is_paused:
            self._poll.register(self._listener_fd, select.EPOLLIN)
            self._is_paused = False

    def abandon(self) -> None:
        """Close the sockets of the door, which belongs to the parent of this process."""
        self._listener.close()
        self._close_callers()

    def close(self) -> None:
        """Release the channel; waiting callers are disconnected."""
        self._claim.release()
        self._close_callers()

    def _close_callers(self) -> None:
        for end in self._callers.values():
            end.close()
        self._callers.clear()
        self._processes.clear()

    def _make_room(self) -> None:
        """Disconnect a caller that has said nothing yet.

        The one that has waited longest, of the process that calls most often: a process that only
        calls takes nobody's place but its own.
        """
        said = select.poll()
        for fd in self._callers:
            said.register(fd, select.POLLIN)
        speaking = {fd for fd, _ in said.poll(0)}
        silent = [fd for fd in self._callers if fd not in speaking]
        if not silent:
            return
        calls = Counter(self._processes[fd] for fd in silent)
        first = max(silent, key=lambda fd: calls[self._processes[fd]])
        end = self._callers[first]
        self._forget(first)
        refuse(end, f"{_MOST_CALLERS} others call, and this one said nothing")

    def _forget(self, fd: int) -> None:
        del self._callers[fd], self._processes[fd]
        self._poll.unregister(fd)


def refuse(end: socket.socket, reason: str) -> None:
    """Tell a caller the reason of the refusal, and close."""
    with end:
        try:
            end.send(datagram.control(datagram.REFUSED, reason))
            # Closed with words unread, it would be reset before the caller hears the reason.
            end.shutdown(socket.SHUT_RD)
            while end.recv(1):
                pass
        except OSError:  # gone already, so nobody is left to be told
            _log.debug("a refused caller went before the reason: %s", reason)
