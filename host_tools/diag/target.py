"""The navigation computer to diagnose, and how to connect to its bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import can

from rrins.host_tools.bus.address import EMBEDDED, Address
from rrins.host_tools.bus.pace import attach_in_pace
from rrins.host_tools.bus.port import open_bus
from rrins.host_tools.diag.connection import Connection, KernelConnection, LibraryConnection
from rrins.host_tools.diag.transport import EmbeddedTransport, MessageTransport
from rrins.host_tools.errors import BusError

DEFAULT_CHANNEL = "rrins0"
DEFAULT_TIMEOUT_S = 2.0

Transport = Literal["library", "kernel"]

_NAME = "diag"
_FIRST_S = 1.0


@dataclass(frozen=True)
class Target:
    """A navigation computer on a bus."""

    interface: str = EMBEDDED  #: of python-can
    channel: str | None = None
    bitrate: int | None = None
    transport: Transport = "library"  #: ISO-TP implementation: can-isotp or kernel sockets
    timeout_s: float = DEFAULT_TIMEOUT_S  #: response timeout

    @property
    def address(self) -> Address:
        """The bus.

        Raises
        ------
        BusError
            If an interface other than the embedded one has no channel.
        """
        if self.channel is None and self.interface != EMBEDDED:
            raise BusError(f"interface {self.interface}: needs a --channel, such as vcan0 or can0")
        return Address(self.interface, self.channel or DEFAULT_CHANNEL, self.bitrate)

    def connect(self) -> Connection:
        """Connect to the bus.

        Raises
        ------
        BusError
            If the bus cannot be opened.
        """
        address = self.address
        if self.transport == "kernel":
            if address.interface != "socketcan":
                raise BusError(f"bus {address}: --transport kernel needs --interface socketcan")
            return KernelConnection(address.channel, str(address))
        if address.is_embedded:
            return LibraryConnection(_embedded(address, self.timeout_s), str(address))
        return LibraryConnection(MessageTransport(open_bus(address)), str(address))


def _embedded(address: Address, timeout_s: float) -> EmbeddedTransport:
    """Attach to the embedded bus at the pace of the tool."""
    bus, keeps_pace = attach_in_pace(address, _NAME, timeout_s)
    medium = EmbeddedTransport(bus, keeps_pace=keeps_pace)
    if not keeps_pace:
        return medium
    try:
        medium.receive(_FIRST_S)  # the first batch sets the time
    except can.CanError as error:
        medium.close()
        raise BusError(f"bus {address}: {error}") from error
    return medium
