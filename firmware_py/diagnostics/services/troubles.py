"""Stored data transmission: 0x14, 0x19."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from rrins.firmware_py.core.records.trouble_table import PARITY_KIND
from rrins.firmware_py.core.records.troubles import (
    ALL_RECORDS,
    FIRST_SNAPSHOT,
    FORMAT_IDENTIFIER,
    LATEST_SNAPSHOT,
    STATUS_AVAILABILITY,
)
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.fault_memory import FaultMemory
from rrins.firmware_py.diagnostics.reader import FieldReader
from rrins.firmware_py.diagnostics.redundancy_identifiers import PARITY_BEFORE
from rrins.firmware_py.diagnostics.refusal import require
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.server import Handler, Server
from rrins.firmware_py.diagnostics.table import EXTENDED_DATA, SNAPSHOT

_NUMBER_SIZE = 3
_SNAPSHOTS = (FIRST_SNAPSHOT, LATEST_SNAPSHOT)


def _number(data: bytes) -> int:
    return int.from_bytes(data[:_NUMBER_SIZE], "big")


def _bytes(number: int) -> bytes:
    return number.to_bytes(_NUMBER_SIZE, "big")


class Troubles:
    """The services that read and clear trouble codes.

    Parameters
    ----------
    on_clear : callable
        Called when trouble codes have been cleared.
    """

    def __init__(self, computer: Computer, on_clear: Callable[[], None]) -> None:
        self._faults: FaultMemory = computer.faults
        self._on_clear = on_clear
        self._reports: dict[int, tuple[int, Callable[[bytes], Iterator[bytes]]]] = {
            0x01: (1, self._count),
            0x02: (1, self._by_mask),
            0x03: (0, self._snapshot_identification),
            0x04: (4, self._snapshots),
            0x06: (4, self._extended_data),
            0x0A: (0, self._supported),
            0x14: (0, self._detection_counters),
        }

    def clear(self, server: Server, data: bytes) -> bytes:
        """Clear trouble codes (0x14)."""
        require(len(data) == _NUMBER_SIZE, Code.INCORRECT_MESSAGE_LENGTH)
        require(self._faults.is_group(_number(data)), Code.REQUEST_OUT_OF_RANGE)
        self._faults.clear(_number(data))
        self._on_clear()
        return b""

    def read(self, server: Server, data: bytes) -> bytes:
        """Read trouble codes (0x19)."""
        length, report = self._reports[data[0]]
        require(len(data) == 1 + length, Code.INCORRECT_MESSAGE_LENGTH)
        return data[:1] + b"".join(report(data[1:]))

    def _count(self, data: bytes) -> Iterator[bytes]:
        count = sum(1 for _ in self._faults.by_mask(data[0] & STATUS_AVAILABILITY))
        yield bytes([STATUS_AVAILABILITY, FORMAT_IDENTIFIER]) + count.to_bytes(2, "big")

    def _by_mask(self, data: bytes) -> Iterator[bytes]:
        yield bytes([STATUS_AVAILABILITY])
        for trouble, status in self._faults.by_mask(data[0] & STATUS_AVAILABILITY):
            yield _bytes(trouble.number) + bytes([status])

    def _supported(self, data: bytes) -> Iterator[bytes]:
        yield bytes([STATUS_AVAILABILITY])
        for number, index in self._faults.numbers():
            yield _bytes(number) + bytes([self._faults.status(index)])

    def _snapshot_identification(self, data: bytes) -> Iterator[bytes]:
        for trouble in self._faults.with_snapshots():
            for record in _SNAPSHOTS:
                yield _bytes(trouble.number) + bytes([record])

    def _detection_counters(self, data: bytes) -> Iterator[bytes]:
        """Yield the trouble codes in prefailed state: counters from 1 to 126."""
        for number, index in self._faults.numbers():
            counter = self._faults.detection_counter(index)
            if 0 < counter < 127:
                yield _bytes(number) + bytes([counter])

    def _known(self, data: bytes) -> int:
        """Return the index of a trouble code that a request names."""
        index = self._faults.index_of(_number(data))
        require(index is not None, Code.REQUEST_OUT_OF_RANGE)
        assert index is not None
        return index

    def _snapshots(self, data: bytes) -> Iterator[bytes]:
        index, wanted = self._known(data), data[_NUMBER_SIZE]
        require(wanted in (*_SNAPSHOTS, ALL_RECORDS), Code.REQUEST_OUT_OF_RANGE)
        yield data[:_NUMBER_SIZE] + bytes([self._faults.status(index)])
        for record in _SNAPSHOTS if wanted == ALL_RECORDS else (wanted,):
            frozen = self._faults.snapshot(index, record)
            if frozen is None:
                continue
            parity = self._faults.parity(index, record)
            yield bytes([record, len(SNAPSHOT) + (parity is not None)])
            for did in SNAPSHOT:
                yield did.number.to_bytes(2, "big")
                yield did.encode(FieldReader(frozen, did.fields).read())
            if parity is not None:
                did = PARITY_BEFORE[PARITY_KIND[index]]
                yield did.number.to_bytes(2, "big")
                fields = [
                    replace(field, source=field.source.split(".")[-1]) for field in did.fields
                ]
                yield did.encode(FieldReader(parity, fields).read())

    def _extended_data(self, data: bytes) -> Iterator[bytes]:
        index, wanted = self._known(data), data[_NUMBER_SIZE]
        require(wanted in EXTENDED_DATA or wanted == ALL_RECORDS, Code.REQUEST_OUT_OF_RANGE)
        yield data[:_NUMBER_SIZE] + bytes([self._faults.status(index)])
        for record, values in self._faults.extended(index).items():
            if wanted in (record, ALL_RECORDS):
                yield bytes([record]) + EXTENDED_DATA[record].encode(values)

    def handlers(self) -> dict[int, Handler]:
        """Return the services of this group."""
        return {0x14: self.clear, 0x19: self.read}
