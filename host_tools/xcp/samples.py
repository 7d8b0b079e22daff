"""Samples of a list of measured data, put together from their packets."""

from __future__ import annotations


class Samples:
    """Puts packets together: samples that are whole, and how many were not.

    Parameters
    ----------
    odts : int
        Packets of a sample.
    first : int
        Number of the first one.

    Attributes
    ----------
    rows : list of bytes
        Timestamp and values of each whole sample.
    torn : int
        Samples of which packets are missing.
    """

    def __init__(self, odts: int, first: int = 0) -> None:
        self._odts = odts
        self._first = first
        self._parts: list[bytes] = []
        self.rows: list[bytes] = []
        self.torn = 0

    def put(self, packet: bytes) -> None:
        """Take a packet."""
        number = packet[0] - self._first
        if number != len(self._parts):
            self.torn += bool(self._parts)
            self._parts.clear()
            if number:
                return
        self._parts.append(packet[1:])
        if len(self._parts) == self._odts:
            self.rows.append(b"".join(self._parts))
            self._parts.clear()
