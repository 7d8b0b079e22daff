"""Data transmission: 0x22, 0x23, 0x2E."""

from __future__ import annotations

import numpy as np

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import MESSAGE_CAPACITY
from rrins.firmware_py.diagnostics.calibration_record import RECORD_ADDRESS
from rrins.firmware_py.diagnostics.codecs import LengthError, ValueRangeError, Values
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.refusal import Later, RefusalError, require
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.server import Handler, Server

MOST_IDENTIFIERS = 16
"""Most data identifiers in one request."""


class Data:
    """The services that read and write data."""

    def __init__(self, computer: Computer) -> None:
        self._computer = computer
        self._memory = computer.ram.view(np.uint8).reshape(-1)

    def read(self, server: Server, data: bytes) -> bytes:
        """Read data identifiers (0x22); of several, those that exist."""
        length = len(data)
        is_whole = length >= 2 and length % 2 == 0 and length <= 2 * MOST_IDENTIFIERS
        require(is_whole, Code.INCORRECT_MESSAGE_LENGTH)
        found = []
        for start in range(0, length, 2):
            did = self._known(int.from_bytes(data[start : start + 2], "big"))
            if did is not None and server.allows(did.read):
                found.append(did)
        require(bool(found), Code.REQUEST_OUT_OF_RANGE)
        for did in found:
            server.require_unlocked(did.read)
        records = b"".join(_bytes(did.number) + self._computer.read(did) for did in found)
        require(1 + len(records) <= MESSAGE_CAPACITY, Code.RESPONSE_TOO_LONG)
        return records

    def _known(self, number: int) -> DataIdentifier | None:
        did = table.IDENTIFIER_BY_NUMBER.get(number)
        return did if did is not None and self._computer.has(did) else None

    def read_memory(self, server: Server, data: bytes) -> bytes:
        """Read the RAM image, or the record of a calibration (0x23)."""
        require(len(data) >= 3, Code.INCORRECT_MESSAGE_LENGTH)
        start, size = address_and_size(data)
        record = self._computer.calibration_record
        is_record = start >= RECORD_ADDRESS
        start -= RECORD_ADDRESS if is_record else 0
        length = len(record) if is_record else len(self._memory)
        require(size > 0 and start + size <= length, Code.REQUEST_OUT_OF_RANGE)
        require(1 + size <= MESSAGE_CAPACITY, Code.RESPONSE_TOO_LONG)
        if is_record:
            return bytes(record[start : start + size])
        return self._memory[start : start + size].tobytes()

    def write(self, server: Server, data: bytes) -> Later:
        """Write a parameter (0x2E)."""
        require(len(data) >= 3, Code.INCORRECT_MESSAGE_LENGTH)
        did = self._known(int.from_bytes(data[:2], "big"))
        if did is None or did.write is None or not server.allows(did.write):
            raise RefusalError(Code.REQUEST_OUT_OF_RANGE)
        server.require_unlocked(did.write)
        values = checked(did, data[2:])
        memory = self._computer.parameters
        require(memory.can_use({did.number: values}), Code.REQUEST_OUT_OF_RANGE)
        job = memory.change({did.number: values})

        def poll() -> bytes | None:
            if not job.done:
                return None
            require(memory.finish(job), Code.GENERAL_PROGRAMMING_FAILURE)
            return data[:2]

        return Later(poll)

    def handlers(self) -> dict[int, Handler]:
        """Return the services of this group."""
        return {0x22: self.read, 0x23: self.read_memory, 0x2E: self.write}


def _bytes(number: int) -> bytes:
    return number.to_bytes(2, "big")


def checked(did: DataIdentifier, record: bytes) -> Values:
    """Return the values of a data record that may be written, or raise `RefusalError`."""
    try:
        values = did.decode(record)
    except LengthError:
        raise RefusalError(Code.INCORRECT_MESSAGE_LENGTH) from None
    try:
        did.layout.check(values)
    except ValueRangeError:
        raise RefusalError(Code.REQUEST_OUT_OF_RANGE) from None
    return values


def address_and_size(data: bytes) -> tuple[int, int]:
    """Return memoryAddress and memorySize after an addressAndLengthFormatIdentifier.

    One to four bytes each.
    """
    size_bytes, address_bytes = data[0] >> 4, data[0] & 0xF
    fits = 1 <= size_bytes <= 4 and 1 <= address_bytes <= 4
    require(fits, Code.REQUEST_OUT_OF_RANGE)
    require(len(data) == 1 + address_bytes + size_bytes, Code.INCORRECT_MESSAGE_LENGTH)
    address = int.from_bytes(data[1 : 1 + address_bytes], "big")
    return address, int.from_bytes(data[1 + address_bytes :], "big")
