"""Which navigation computer is meant, and how to get onto its bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import can

from host_tools.bus.interface import RrinsBus
from host_tools.bus.pace import runs_ahead
from host_tools.diag.connection import Connection, KernelConnection, LibraryConnection
from host_tools.diag.medium import EmbeddedMedium, MessageMedium
from host_tools.errors import BusError
from host_tools.port import EMBEDDED, Address, open_bus

DEFAULT_CHANNEL = "rrins0"
DEFAULT_TIMEOUT_S = 2.0

Transport = Literal["library", "kernel"]

_NAME = "diag"
_FIRST_S = 1.0


@dataclass(frozen=True)
class Target:
    """A navigation computer on a bus.

    Attributes
    ----------
    interface : str
        Of python-can.
    channel : str or None
    bitrate : int or None
    transport : {"library", "kernel"}
        Who does ISO-TP: can-isotp, or the kernel's sockets.
    timeout_s : float
        How long a response may take.
    """

    interface: str = EMBEDDED
    channel: str | None = None
    bitrate: int | None = None
    transport: Transport = "library"
    timeout_s: float = DEFAULT_TIMEOUT_S

    @property
    def address(self) -> Address:
        """The bus.

        Raises
        ------
        BusError
            When an interface other than the embedded one is named without a channel.
        """
        if self.channel is None and self.interface != EMBEDDED:
            raise BusError(f"interface {self.interface}: needs a --channel, such as vcan0 or can0")
        return Address(self.interface, self.channel or DEFAULT_CHANNEL, self.bitrate)

    def connect(self) -> Connection:
        """Get onto the bus.

        Raises
        ------
        BusError
        """
        address = self.address
        if self.transport == "kernel":
            if address.interface != "socketcan":
                raise BusError(
                    f"bus {address}: --transport kernel is for --interface socketcan only"
                )
            return KernelConnection(address.channel, str(address))
        if address.is_embedded:
            return LibraryConnection(_embedded(address, self.timeout_s), str(address))
        return LibraryConnection(MessageMedium(open_bus(address)), str(address))


def _embedded(address: Address, timeout_s: float) -> EmbeddedMedium:
    """Attach to the embedded bus: as an observer, or in step with a rehearsal in lockstep.

    A rehearsal that runs faster than real time would have timed out every session before the next
    request. It waits for what is attached in step, and so keeps to the tool's pace.
    """
    bus = _attach(address, role="observer")
    try:
        is_ahead = runs_ahead(bus, timeout_s)
    except can.CanError as error:
        bus.shutdown()
        raise BusError(f"bus {address}: {error}") from error
    if not is_ahead:
        return EmbeddedMedium(bus, keeps_pace=False)
    bus.shutdown()
    medium = EmbeddedMedium(_attach(address, in_step=True), keeps_pace=True)
    try:
        medium.receive(_FIRST_S)  # from then on it knows the time
    except can.CanError as error:
        medium.close()
        raise BusError(f"bus {address}: {error}") from error
    return medium


def _attach(address: Address, **wishes: object) -> RrinsBus:
    bus = open_bus(address, host="never", name=_NAME, **wishes)
    assert isinstance(bus, RrinsBus)
    return bus
