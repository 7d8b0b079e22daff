"""The memory that a tool sees: the RAM image, and texts that identify the computer."""

from __future__ import annotations

import zlib

import numpy as np

from rrins.compiled.record import Records
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.xcp.layout import epk
from rrins.firmware_py.xcp.pages import Pages
from rrins.firmware_py.xcp.protocol import Fault, require

EPK_ADDRESS = 0x2000_0000
"""Address of the text that identifies this version's memory layout."""

TEXT_ADDRESS = 0x3000_0000
"""Address of the text that was asked for last, such as the A2L file."""


class Memory:
    """Reads and writes by address; addresses of the RAM image begin at 0.

    Parameters
    ----------
    ram : Records[Ram]
        One record, changed in place.
    """

    def __init__(self, ram: Records[Ram]) -> None:
        self.image = ram.view(np.uint8)
        self.pages = Pages(ram)
        self.text = b""
        self._epk = epk().encode()

    def read(self, address: int, size: int) -> bytes:
        """Return bytes as the tool's pages show them; all are of the same moment.

        Raises
        ------
        XcpError
            When they are not in the memory.
        """
        for begin, text in ((EPK_ADDRESS, self._epk), (TEXT_ADDRESS, self.text)):
            first = address - begin
            if 0 <= first < len(text):
                require(first + size <= len(text), Fault.ACCESS_DENIED)
                return text[first : first + size]
        require(address + size <= len(self.image), Fault.ACCESS_DENIED)
        data = self.image[address : address + size].copy()
        self.pages.overlay(address, data)
        return data.tobytes()

    def write(self, address: int, data: bytes) -> None:
        """Change parameters, as `Segment.write` does."""
        self.pages.write(address, data)

    def modify_bits(self, address: int, keep: int, toggle: int) -> None:
        """Keep only some bits of a 32-bit word, then toggle some.

        Raises
        ------
        XcpError
            As `read` and `write` do.
        """
        before = int.from_bytes(self.read(address, 4), "little")
        after = ((before & keep) ^ toggle).to_bytes(4, "little")
        changed = [k for k, byte in enumerate(before.to_bytes(4, "little")) if byte != after[k]]
        if changed:
            first, end = changed[0], changed[-1] + 1
            self.pages.write(address + first, after[first:end], is_whole=True)

    def checksum(self, address: int, size: int) -> int:
        """Return the CRC-32 of a range, as the tool reads it."""
        return zlib.crc32(self.read(address, size))
