"""The embedded bus behind an emulated slcan adapter, for programs with a fixed list of interfaces.

The adapter is a pseudo-terminal. A program that opens it finds a closed channel, as after power-on.
What it does not read in time is lost, as in a real adapter, and never slows the bus.
"""

from __future__ import annotations

import functools
import logging
import select
from collections.abc import Callable
from pathlib import Path
from typing import Final

from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG
from rrins.firmware_py.serial.port import PortName, SerialPort, SerialPortError, open_port
from rrins.host_tools.bridges.adapter import Adapter
from rrins.host_tools.bus import datagram
from rrins.host_tools.bus.channel import NoHostError
from rrins.host_tools.bus.end import BusTimeoutError
from rrins.host_tools.bus.link import Link
from rrins.host_tools.errors import BusError

NAME: Final = "slcan"
"""Name of the adapter on the bus."""

BUFFER_BYTES: Final = 65_536
"""Most frames that wait for the program; those beyond are lost."""

_log: Final = logging.getLogger(__name__)
_IDLE_S: Final = 0.05  # between looks whether a program has opened the port
_SEND_S: Final = 0.1
_READ_BYTES: Final = 4096
_NS_PER_MS: Final = 1_000_000


def command_of(can_id: int, length: int, data: bytes) -> bytes:
    """Return a frame as an adapter tells it; empty for an error frame, which has no form."""
    if can_id & ERR_FLAG:
        return b""
    is_remote = bool(can_id & RTR_FLAG)
    payload = b"" if is_remote else data[:length].hex().upper().encode()
    if can_id & EFF_FLAG:
        letter = b"R" if is_remote else b"T"
        return b"%s%08X%d%s" % (letter, can_id & 0x1FFF_FFFF, length, payload)
    return b"%s%03X%d%s" % (b"r" if is_remote else b"t", can_id & 0x7FF, length, payload)


def datagram_of(command: bytes, sender: int) -> memoryview:
    """Return a datagram with the frame of a well-formed command, to be stamped by the host."""
    is_extended, is_remote = command[:1] in b"TR", command[:1] in b"rR"
    end = 9 if is_extended else 4
    can_id = int(command[1:end], 16) & (0x1FFF_FFFF if is_extended else 0x7FF)
    can_id |= (EFF_FLAG if is_extended else 0) | (RTR_FLAG if is_remote else 0)
    payload = bytes.fromhex(command[end + 1 :].decode())
    return datagram.of_one_frame(sender, can_id, int(command[end : end + 1]), payload)


@functools.lru_cache(4096)
def _command(raw: bytes) -> bytes:
    return command_of(*datagram.CLASSIC.unpack(raw))


class _Bridge:
    """A link to the bus and a pseudo-terminal, with an adapter between them."""

    def __init__(self, link: Link, port: SerialPort) -> None:
        self._link = link
        self._port = port
        self._adapter = Adapter(self._send)
        self._buffer = datagram.receive_buffer()
        self.lost = 0
        """Frames that the program did not read in time."""

    def _send(self, command: bytes) -> bool:
        try:
            self._link.send(datagram_of(command, self._link.number), _SEND_S)
        except BusTimeoutError:
            return False
        return True

    def turn(self) -> None:
        """Move what there is, or wait a moment.

        Raises
        ------
        BusError
            If the bus has come to its end.
        """
        is_attached = self._port.is_attached()
        if not is_attached:
            self._adapter.power_on()
        own, port = self._link.fileno(), self._port.fileno()
        writers = [port] if is_attached and self._adapter.out else []
        readable, _, _ = select.select([own, port] if is_attached else [own], writers, [], _IDLE_S)
        if port in readable:
            self._adapter.feed(self._port.read(_READ_BYTES))
        self._hear_all()
        if self._adapter.out:
            del self._adapter.out[: self._port.write(bytes(self._adapter.out))]

    def _hear_all(self) -> None:
        while size := self._link.receive(self._buffer, 0):
            if self._buffer[datagram.KIND_OFFSET] != datagram.FRAMES or not self._adapter.is_open:
                continue
            time_ms = datagram.time_of(self._buffer) // _NS_PER_MS
            for first in range(datagram.HEADER_SIZE, size, datagram.FRAME_SIZE):
                command = _command(bytes(self._buffer[first : first + datagram.FRAME_SIZE]))
                if len(self._adapter.out) > BUFFER_BYTES:
                    self.lost += 1
                elif command:
                    self._adapter.hear(command, time_ms)


def serve(
    channel: str,
    link_path: Path | None = None,
    *,
    on_ready: Callable[[str], None],
    on_end: Callable[[int], None],
) -> str:
    """Offer a channel behind an emulated slcan adapter until the bus ends.

    Parameters
    ----------
    channel : str
        Name or path of the channel.
    link_path : Path, optional
        Symbolic link to the pseudo-terminal, removed at the end.
    on_ready : callable
        Called with the name of the pseudo-terminal once a program can open it.
    on_end : callable
        Called at the end, however it comes, with the number of frames that were lost.

    Returns
    -------
    str
        Why the bus has ended.

    Raises
    ------
    BusError
        If nobody hosts the channel, or the pseudo-terminal cannot be made.
    """
    try:
        link = Link(channel, name=NAME, is_observer=True)
    except NoHostError as error:
        hint = f"start one first, such as `rrins rehearse --channel {channel}`"
        raise BusError(f"nobody hosts channel {channel!r}: {hint}") from error
    try:
        port = open_port(PortName(f"pty:{link_path or ''}", "pty", link_path, 0), _log.warning)
    except SerialPortError as error:
        link.close()
        raise BusError(str(error)) from error
    bridge = _Bridge(link, port)
    try:
        on_ready(port.name)
        while True:
            bridge.turn()
    except BusError as error:
        return str(error)
    finally:
        on_end(bridge.lost)
        port.close()
        link.close()
