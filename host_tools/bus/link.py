"""One attached end of the bus."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
from typing import Final

from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import NoHostError, connect
from rrins.host_tools.bus.end import (
    Backlog,
    BusTimeoutError,
    deadline_of,
    now,
    wait_readable,
)
from rrins.host_tools.bus.peer import check_name, widen
from rrins.host_tools.errors import BusError

_BACKLOG_LIMIT: Final = 4 * 1024 * 1024
_ASIDE_MS: Final = 20


class Link:
    """A connection to the host of a channel. A `BusEnd`.

    Parameters
    ----------
    channel, name, exclusive, receive_own, in_step
        As of `RrinsBus`.
    is_observer : bool
        Whether this end may be cut off rather than slow the bus.
    timeout : float
        Seconds that the host has to answer.

    Attributes
    ----------
    number : int
        Node number of this end.
    host_pid : int
        Process of the host.
    origin_ns : int
        Unix time of time 0 of the host's batches; 0 if it had sent none when this end attached.

    Raises
    ------
    NoHostError
        If nobody hosts the channel.
    BusError
        If the host does not answer, or refuses.
    """

    def __init__(
        self,
        channel: str,
        *,
        name: str,
        is_observer: bool = False,
        exclusive: bool = False,
        receive_own: bool = False,
        in_step: bool = False,
        timeout: float = 10.0,
    ) -> None:
        self._channel = channel
        self._pid = os.getpid()
        self._end_reason = ""
        self._is_closed = False
        self._receive_lock = threading.Lock()
        self._backlog = Backlog()  # received while waiting for room to send
        flags = (
            (datagram.OBSERVER if is_observer else 0)
            | (datagram.EXCLUSIVE if exclusive else 0)
            | (datagram.RECEIVE_OWN if receive_own else 0)
            | (datagram.IN_STEP if in_step else 0)
        )
        hello = datagram.control(datagram.HELLO, check_name(name), flags=flags)
        self._end = connect(channel, timeout)
        try:
            widen(self._end)
            self.number, self.host_pid, self.origin_ns = self._introduce(hello, timeout)
            # Blocking for Python, so a receive is one system call; the kernel keeps the time.
            self._end.settimeout(None)
        except BaseException:
            self._end.close()
            raise

    def _introduce(self, hello: bytes, timeout: float) -> tuple[int, int, int]:
        buffer = datagram.receive_buffer()
        try:
            with contextlib.suppress(BrokenPipeError):  # refused already: the reason is waiting
                self._end.send(hello)
            size = self._end.recv_into(buffer)
        except TimeoutError as error:
            raise BusError(
                f"the host of channel {self._channel!r} has not answered for {timeout:g} s; "
                "a host answers while it sends or receives"
            ) from error
        except ConnectionResetError:
            size = 0
        if not size:
            raise NoHostError(f"no bus {self._channel!r}: its host has just left")
        kind, _, count, number, pid, origin_ns = datagram.parse(buffer, size)
        if kind == datagram.REFUSED:
            raise BusError(datagram.text_of(buffer, count))
        if kind != datagram.WELCOME:
            raise datagram.ProtocolError(f"the host answered with a datagram of kind {kind}")
        return number, pid, origin_ns

    def fileno(self) -> int:
        """Return the descriptor; what a send took in meanwhile does not show on it."""
        return self._end.fileno()

    @property
    def is_lost(self) -> bool:
        """Whether the bus has come to its end for this link."""
        return bool(self._end_reason)

    def send(self, view: memoryview, timeout: float | None) -> None:
        """Send a datagram, waiting while a node holds up the bus."""
        try:
            self._end.send(view, socket.MSG_DONTWAIT)
        except BlockingIOError:
            self._send_slowly(view, timeout)
        except OSError as error:
            raise self._why_lost() from error

    def direct_ends(self) -> tuple[int, int, int, int] | None:
        """Return the socket for compiled code, no door, the host's number, and no listener.

        None while something waits to be received.
        """
        if self._backlog or self._end_reason or self._is_closed:
            return None
        return self._end.fileno(), -1, datagram.HOST, -1

    def go_on(self, left_over: memoryview, time_ns: int, batches: int) -> None:
        """Keep a datagram that compiled code has received and not used."""
        data = bytes(left_over)
        if data and not self._is_end(bytearray(data), len(data)):
            self._backlog.keep(data)

    def _send_slowly(self, view: memoryview, timeout: float | None) -> None:
        """Wait for room, and receive meanwhile: two nodes that both send would never get any."""
        deadline = deadline_of(timeout)
        poll = select.poll()
        poll.register(self._end, select.POLLOUT)
        while True:
            wait = None if deadline is None else max(0, deadline - now()) / 1e6
            if self._backlog.size < _BACKLOG_LIMIT:
                is_drained = self._drain()
                poll.modify(self._end, select.POLLOUT | (select.POLLIN if is_drained else 0))
                # Another thread receives: leave it to that one, and look again a little later.
                step = wait if is_drained else _ASIDE_MS if wait is None else min(wait, _ASIDE_MS)
            else:
                poll.modify(self._end, select.POLLOUT)
                step = _ASIDE_MS if wait is None else min(wait, _ASIDE_MS)
            poll.poll(step)
            try:
                self._end.send(view, socket.MSG_DONTWAIT)
            except BlockingIOError:
                if wait == 0:
                    raise BusTimeoutError(
                        f"channel {self._channel!r} is held up: a node does not receive"
                    ) from None
            except OSError as error:
                raise self._why_lost() from error
            else:
                return

    def _drain(self) -> bool:
        """Take in what has arrived while there is room; return False if another thread does."""
        if not self._receive_lock.acquire(blocking=False):
            return False
        try:
            while self._backlog.size < _BACKLOG_LIMIT and not self._end_reason:
                data = self._receive_now(socket.MSG_DONTWAIT)
                if data is None:
                    break
                self._backlog.keep(data)
        finally:
            self._receive_lock.release()
        return True

    def _receive_now(self, flags: int) -> bytes | None:
        try:
            data = self._end.recv(datagram.MAX_DATAGRAM + 1, flags)
        except BlockingIOError:
            return None
        except ConnectionResetError:
            return self._receive_now(flags)  # told once; what arrived before can still be read
        except OSError:
            data = b""
        if not self._is_end(bytearray(data), len(data)):
            return data
        return None

    def receive(self, buffer: bytearray, timeout: float | None) -> int:
        """Receive the next datagram."""
        with self._receive_lock:
            if self._backlog:
                return self._backlog.pop(buffer)
            if self._end_reason:
                raise BusError(self._end_reason)
            flags = 0 if timeout is None else socket.MSG_DONTWAIT
            deadline = deadline_of(timeout)
            while True:
                try:
                    size = self._end.recv_into(buffer, 0, flags)
                except BlockingIOError:
                    left = (deadline or 0) - now()
                    if left <= 0 or not wait_readable(self._end.fileno(), left * 1e-9):
                        return 0
                    continue
                except ConnectionResetError:
                    continue  # told once; what arrived before can still be read
                except OSError:
                    size = 0
                if size < datagram.HEADER_SIZE or buffer[datagram.KIND_OFFSET] == datagram.BYE:
                    self._is_end(buffer, size)
                    raise BusError(self._end_reason)
                return size

    def _is_end(self, buffer: bytearray, size: int) -> bool:
        """Return whether a datagram is the last one; if it is, keep the reason."""
        if size >= datagram.HEADER_SIZE and buffer[datagram.KIND_OFFSET] != datagram.BYE:
            return False
        reason = f"its host, process {self.host_pid}, has disappeared"
        if self._is_closed:
            reason = "this end is shut down"
        elif size:
            _, _, count, *_ = datagram.parse(buffer, size)
            reason = datagram.text_of(buffer, count)
        self._end_reason = f"channel {self._channel!r}: {reason}"
        return True

    def _why_lost(self) -> BusError:
        """Return the error of a send that failed; the host's last word may tell more."""
        self._drain()
        return BusError(
            self._end_reason
            or f"channel {self._channel!r}: its host, process {self.host_pid}, "
            "no longer accepts data from this end"
        )

    def close(self) -> None:
        """Leave the bus; what was sent still arrives. A second call does nothing."""
        if self._is_closed:
            return
        self._is_closed = True
        if os.getpid() == self._pid:  # not in a child, which has only inherited the socket
            try:
                self._end.send(
                    datagram.control(datagram.BYE, sender=self.number), socket.MSG_DONTWAIT
                )
                self._end.shutdown(socket.SHUT_RDWR)  # wakes a thread that receives
            except OSError as error:
                self._end_reason = self._end_reason or f"the host has gone: {error.strerror}"
        with self._receive_lock:
            self._end_reason = f"channel {self._channel!r}: this end is shut down"
            self._end.close()
