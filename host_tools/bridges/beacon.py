"""The discovery beacon of socketcand: tells programs on this machine where a channel is served."""

from __future__ import annotations

import asyncio
import logging
import socket
from typing import Final
from xml.sax.saxutils import quoteattr

PORT: Final = 42000
"""UDP port on which clients listen for beacons."""

LOOPBACK_BROADCAST: Final = "127.255.255.255"
"""Reaches every listener on this machine, and no other machine."""

_PERIOD_S: Final = 2.0  # the protocol allows three seconds

_log: Final = logging.getLogger("rrins.host_tools.bus")


def text_of(channel: str, address: str, port: int) -> str:
    """Return the beacon of a channel that is served on a TCP port.

    SavvyCAN shows ``CHANNEL@rrins (can://ADDRESS:PORT)``.
    """
    return (
        '<CANBeacon name="rrins" type="embedded" description="RRINS rehearsal">\n'
        f"<URL>can://{address}:{port}</URL><Bus name={quoteattr(channel)}/></CANBeacon>"
    )


async def send_beacons(channel: str, address: str, port: int, beacon_port: int = PORT) -> None:
    """Send the beacon until cancelled. Where the system refuses, log it once and send no more.

    Parameters
    ----------
    channel : str
        Name of the channel.
    address : str
        IPv4 address on which it is served.
    port : int
        TCP port on which it is served.
    beacon_port : int
        UDP port to send to.
    """
    beacon = text_of(channel, address, port).encode()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        try:
            sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            while True:
                sender.sendto(beacon, (LOOPBACK_BROADCAST, beacon_port))
                await asyncio.sleep(_PERIOD_S)
        except OSError as error:
            _log.warning("no discovery beacon: %s", error.strerror)
