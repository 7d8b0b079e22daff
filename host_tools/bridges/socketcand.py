"""The embedded bus by the socketcand protocol, for programs that know neither us nor python-can.

https://github.com/linux-can/socketcand/blob/master/doc/protocol.md. A client is greeted with
``< hi >``, opens the channel and is in BCM mode; what it may say there and in raw mode:

=============================  ==================================================================
command                        what it does
=============================  ==================================================================
``open NAME``                  attaches the client to the bus, as an observer of its own
``rawmode``, ``bcmmode``       all frames, or those asked for; subscriptions end with a mode
``send ID DLC B0 …``           sends one frame; eight digits make an extended identifier
``echo``                       comes back
``subscribe 0 0 ID``           BCM: all frames of an identifier
``unsubscribe ID``             BCM: ends that
=============================  ==================================================================

Anything else well-formed is answered with ``< error … >``. A client that sends an invalid command
or does not receive its data is cut off; neither slows the bus. Frames carry its time, which
is simulated in a rehearsal, or on request Unix time. Remote and CAN FD frames have no words and
are passed over.

The protocol knows no users: while the server runs, everybody on this machine may attach. It
therefore runs on request only, and listens on loopback addresses only; a beacon
(`rrins.host_tools.bridges.beacon`) tells programs on this machine where.
"""

from __future__ import annotations

import asyncio
import errno
import functools
import ipaddress
import logging
import re
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal, cast

from rrins.host_tools.bridges.beacon import send_beacons
from rrins.host_tools.bridges.socketcand_words import CommandError, frame_of, identifier_of, text_of
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import SUFFIX, NoHostError
from rrins.host_tools.bus.end import BusTimeoutError
from rrins.host_tools.bus.link import Link
from rrins.host_tools.bus.unix_time import UnixTime
from rrins.host_tools.errors import BusError

PORT: Final = 29536
"""The port that socketcand clients expect."""

QUEUE_LIMIT: Final = 4 * 1024 * 1024
"""Bytes that may wait for a client before it is cut off."""

MOST_CLIENTS: Final = 64
"""Clients that may be connected at a time."""

# Between commands C programs send spaces, ends of lines and the zeros that end their strings.
_COMMAND: Final = re.compile(rb"[\s\0]*<([\s -;=?-~]{0,512})>")
_BEGINNING: Final = re.compile(rb"[\s\0]{0,512}(<[\s -;=?-~]{0,512})?")
_MOST_SUBSCRIPTIONS: Final = 2048
_ATTACH_S: Final = 5.0
# Clients expect the answer to `rawmode` in a packet of its own (python-can among them), so the
# first frames wait until the client has certainly read it.
_QUIET_S: Final = 0.25
_LINGER_S: Final = 1.0
_COMMANDS_A_TURN: Final = 256
_DATAGRAMS_A_TURN: Final = 32

_log: Final = logging.getLogger("rrins.host_tools.bus")


_whole_text = functools.lru_cache(2 * _DATAGRAMS_A_TURN)(text_of)  # all clients receive the same


def _leave(loop: asyncio.AbstractEventLoop, link: Link) -> None:
    loop.remove_reader(link)
    loop.remove_writer(link)
    link.close()


class _Client(asyncio.Protocol):
    """One client: a TCP connection and, once it has opened the channel, a peer of the bus."""

    def __init__(self, server: _Server) -> None:
        self._server = server
        self._loop = asyncio.get_running_loop()
        self._transport: asyncio.Transport
        self._address = ""
        self._text = bytearray()  # received and not obeyed yet
        self.link: Link | None = None
        self._buffer = datagram.receive_buffer()
        self._is_over = False
        self._is_opening = False
        self._is_raw = False
        self._kept: bytearray | None = None  # until the client has read the answer to rawmode
        self._unsent: memoryview | None = None  # what the bus had no room for
        self._is_due = False  # what else has arrived is looked at in the next turn
        self._wanted: set[int] = set()  # identifiers, in BCM mode

    # The connection

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._address = "{}:{}".format(*transport.get_extra_info("peername"))
        if len(self._server.clients) >= MOST_CLIENTS:
            self.cut_off(f"there are {MOST_CLIENTS} already")
            return
        self._server.clients.add(self)
        self._transport.write(b"< hi >")

    def data_received(self, data: bytes) -> None:
        self._text += data
        self._end_quiet()  # it has read the answer
        self._obey_all()

    def connection_lost(self, exc: Exception | None) -> None:
        self.end()

    def cut_off(self, why: str) -> None:
        """Disconnect the client and log the reason."""
        if not self._is_over:
            _log.warning("socketcand client %s is cut off: %s", self._address, why)
            self.end()

    def end(self) -> None:
        """Disconnect the client. Idempotent."""
        if self._is_over:
            return
        self._is_over = True
        self._server.clients.discard(self)
        self._transport.abort()
        if self.link is not None:
            _leave(self._loop, self.link)

    def _tell(self, text: str) -> None:
        self._give(f"< {text} >".encode())

    def _give(self, data: bytes) -> None:
        if self._is_over or self._transport.is_closing():
            return
        if self._kept is None:
            self._transport.write(data)
            waiting = self._transport.get_write_buffer_size()
        else:
            self._kept += data
            waiting = len(self._kept)
        if waiting > QUEUE_LIMIT:
            self.cut_off(f"{waiting} bytes waited for it to receive")

    def _end_quiet(self) -> None:
        kept, self._kept = self._kept, None
        if kept:
            self._give(bytes(kept))

    # Commands

    def _obey_all(self) -> None:
        """Obey what has arrived, a good deal at a time; what is left waits for the next turn."""
        for _ in range(_COMMANDS_A_TURN):
            if self._is_over:
                return
            if self._is_opening or self._unsent is not None:
                self._transport.pause_reading()
                return
            words = self._next_command()
            if words is None:
                if not self._is_over:
                    self._transport.resume_reading()
                return
            try:
                self._obey(words)
            except CommandError as error:
                self._tell(f"error {error}")
        self._transport.pause_reading()
        self._loop.call_soon(self._obey_all)

    def _next_command(self) -> list[str] | None:
        """Return the words of the next command, None if it is not all here."""
        found = _COMMAND.match(self._text)
        if found is not None:
            words = found[1].decode("ascii").split()
            size = found.end()
            del found  # it holds the text
            del self._text[:size]
            return words
        if not _BEGINNING.fullmatch(self._text):
            self.cut_off(f"it sent an invalid command: {bytes(self._text[:20])!r}")
        return None

    def _obey(self, words: list[str]) -> None:
        name, arguments = (words[0], words[1:]) if words else ("", [])
        if name == "echo" and not arguments:
            self._tell("echo")
        elif self.link is None:
            if name != "open" or len(arguments) != 1:
                raise CommandError("unknown command")
            self._open(arguments[0])
        elif name == "send":
            self._send(frame_of(arguments, self.link.number))
        elif name in ("rawmode", "bcmmode") and not arguments:
            self._change_mode(is_raw=name == "rawmode")
        elif name == "subscribe" and not self._is_raw:
            self._subscribe(arguments)
        elif name == "unsubscribe" and not self._is_raw:
            self._wanted.discard(identifier_of(*arguments))
        else:
            raise CommandError("unknown command")

    def _open(self, name: str) -> None:
        self._is_opening = True
        if name != self._server.name:
            self._tell("error could not open bus")
            self._transport.close()  # and nothing that follows is obeyed
            return
        attach = functools.partial(self._server.attach, f"socketcand-{self._address}")
        self._loop.run_in_executor(None, attach).add_done_callback(self._opened)

    def _opened(self, attaching: asyncio.Future[Link]) -> None:
        if attaching.cancelled():
            return
        error = attaching.exception()
        if error is not None:
            self.cut_off(str(error))
            return
        link = attaching.result()
        if self._is_over:
            link.close()
            return
        self.link = link
        self._loop.add_reader(link, self._hear_all)
        self._is_opening = False
        self._tell("ok")
        self._obey_all()

    def _change_mode(self, is_raw: bool) -> None:
        self._is_raw = is_raw
        self._wanted.clear()
        self._tell("ok")
        if is_raw:
            self._kept = bytearray()
            self._loop.call_later(_QUIET_S, self._end_quiet)

    # To the bus

    def _send(self, frame: memoryview) -> None:
        """Send a frame; while the bus is held up no more is read from this client."""
        assert self.link is not None
        try:
            self.link.send(frame, 0)
        except BusTimeoutError:
            self._unsent = frame
            self._loop.add_writer(self.link, self._send_again, frame)
            self._hear_soon()  # the link has received while it waited
        except BusError as error:
            self._lose(error)
        else:
            self._unsent = None

    def _send_again(self, frame: memoryview) -> None:
        assert self.link is not None
        self._send(frame)
        if self._unsent is None and not self._is_over:
            self._loop.remove_writer(self.link)
            self._obey_all()

    # From the bus

    def _hear_soon(self) -> None:
        if not self._is_due:
            self._is_due = True
            self._loop.call_soon(self._hear_all, True)

    def _hear_all(self, was_due: bool = False) -> None:
        """Take what has arrived, a good deal at a time."""
        self._is_due = self._is_due and not was_due
        for _ in range(_DATAGRAMS_A_TURN):
            if self._is_over or self.link is None:
                return
            try:
                size = self.link.receive(self._buffer, 0)
            except BusError as error:
                self._lose(error)
                return
            if not size:
                return
            is_classic = self._buffer[datagram.KIND_OFFSET] == datagram.FRAMES
            if is_classic and (self._is_raw or self._wanted):
                batch = bytes(memoryview(self._buffer)[:size])
                time_ns = self._server.time_of(self._buffer)
                if self._is_raw:
                    text = _whole_text(batch, time_ns)
                else:
                    text = text_of(batch, time_ns, self._wanted)
                if text:
                    self._give(text)
        self._hear_soon()

    def _subscribe(self, words: list[str]) -> None:
        if words[:2] != ["0", "0"]:
            raise CommandError("frames are not held back: the interval must be 0 0")
        if len(self._wanted) >= _MOST_SUBSCRIPTIONS:
            raise CommandError(f"more than {_MOST_SUBSCRIPTIONS} subscriptions")
        self._wanted.add(identifier_of(*words[2:]))

    def _lose(self, error: BusError, is_sure: bool = False) -> None:
        """Part with a client whose place on the bus is lost, unless all of the bus has ended."""
        if self._is_over or self.link is None:
            return
        self._loop.remove_reader(self.link)
        if not self._server.look():
            self._transport.close()  # once the client has received all
        elif is_sure:
            self.cut_off(str(error))
        else:  # a host that dies loses its peers one by one
            self._loop.call_later(_QUIET_S, self._lose, error, True)


class _Server:
    """The clients, and a link of its own by which the server learns of the end of the bus."""

    def __init__(self, channel: str, in_unix_time: bool) -> None:
        self.name = Path(channel).name.removesuffix(SUFFIX)
        self.clients: set[_Client] = set()
        self._channel = channel
        self._buffer = datagram.receive_buffer()
        self._link = self.attach("socketcand")
        self._unix = UnixTime(self._link) if in_unix_time else None
        self._loop = asyncio.get_running_loop()
        self._end: asyncio.Future[str] = self._loop.create_future()
        self._loop.add_reader(self._link, self.look)

    def attach(self, name: str) -> Link:
        """Return a new link to the bus."""
        return Link(self._channel, name=name[:64], is_observer=True, timeout=_ATTACH_S)

    def time_of(self, batch: bytearray) -> int:
        """Return the time that clients are told for a batch, in nanoseconds."""
        time_ns = datagram.time_of(batch)
        if self._unix is not None:
            time_ns = self._unix.of(time_ns, datagram.sender_of(batch), time.time_ns())
        return time_ns

    def look(self) -> bool:
        """Pass over what is on the bus; return whether it goes on."""
        try:
            while not self._end.done() and self._link.receive(self._buffer, 0):
                pass
        except BusError as error:
            self._loop.remove_reader(self._link)
            self._end.set_result(str(error))
        return not self._end.done()

    async def run(self, address: str, port: int, on_ready: Callable[[int], None]) -> str:
        """Serve until the bus ends; return why it has ended."""
        beacons: asyncio.Task[None] | None = None
        try:
            listener = await self._listen(address, port)
            async with listener:
                taken = listener.sockets[0].getsockname()[1]
                if ":" not in address:  # clients read only IPv4 from a beacon
                    beacons = self._loop.create_task(send_beacons(self.name, address, taken))
                on_ready(taken)
                reason = await self._end
                await self._linger()
                return reason
        finally:
            if beacons is not None:
                beacons.cancel()
            for client in tuple(self.clients):
                client.end()
            _leave(self._loop, self._link)

    async def _linger(self) -> None:
        """Give the clients a moment to receive what was on the bus."""
        end = self._loop.time() + _LINGER_S
        while any(client.link for client in self.clients) and self._loop.time() < end:
            await asyncio.sleep(_LINGER_S / 100)

    async def _listen(self, address: str, port: int) -> asyncio.Server:
        try:
            return await self._loop.create_server(lambda: _Client(self), address, port)
        except OSError as error:
            why = f"cannot listen on {address}: {error.strerror}"
            if error.errno == errno.EADDRINUSE:
                why = f"port {port} of {address} is taken: name another with --port"
            raise BusError(why) from error


def _loopback(host: str) -> str:
    """Return the address of a host name, if it cannot be reached from another machine."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
        address = str(found[0][4][0])
        is_loopback = ipaddress.ip_address(address.partition("%")[0]).is_loopback
    except (OSError, ValueError) as error:
        raise BusError(f"{host!r} is not an address to listen on: {error}") from error
    if not is_loopback:
        why = "the socketcand protocol lets in everybody: use a loopback address such as 127.0.0.1"
        raise BusError(f"{host!r} can be reached from other machines, and {why}")
    return address


def serve(
    channel: str,
    host: str = "127.0.0.1",
    port: int = PORT,
    *,
    timestamps: Literal["bus", "unix"] = "bus",
    on_ready: Callable[[int], None],
) -> str:
    """Offer a channel to socketcand clients until the bus ends.

    Parameters
    ----------
    channel : str
        Name or path of the channel.
    host : str
        Loopback address, or a name for one.
    port : int
        TCP port; 0 takes a free one.
    timestamps : {"bus", "unix"}
        Time that frames carry, as of `RrinsBus`.
    on_ready : callable
        Called with the port once clients can connect.

    Returns
    -------
    str
        Why the bus has ended.

    Raises
    ------
    BusError
        If nobody hosts the channel, the address is not a loopback one, or the port is taken.
    """
    address = _loopback(host)

    async def run() -> str:
        try:
            server = _Server(channel, timestamps == "unix")
        except NoHostError as error:
            hint = f"start one first, such as `rrins rehearse --channel {channel}`"
            raise BusError(f"nobody hosts channel {channel!r}: {hint}") from error
        return await server.run(address, port, on_ready)

    return asyncio.run(run())
