"""Dynamic lists of measured data (DAQ) and of data for stimulation (STIM).

A list is a number of object descriptor tables (ODT), one packet each; a table is some ranges of
the memory. A list is sampled whole at its event, between two steps, so its values are of one epoch
and none is torn. Its packets leave as the bus share allows, those of a list of higher priority
first. When its next event comes before they have left, that sample is left out, which is told.
"""

from __future__ import annotations

import operator
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rrins.firmware_py.xcp.protocol import (
    FIRST_COMMAND,
    LISTS_CAPACITY,
    ODT_BYTES,
    ODTS_CAPACITY,
    TIMESTAMP_BYTES,
    Fault,
    require,
)

STIM_MODE, TIMESTAMP_MODE = 0x02, 0x10
"""Bits of a list's mode that can be chosen."""


class EventChannel(IntEnum):
    """When lists are sampled."""

    EPOCH = 0
    SECOND = 1


@dataclass(frozen=True)
class Entry:
    """A range of the memory; of size 0 until it is written."""

    size: int = 0
    address: int = 0


@dataclass
class DaqList:
    """A list.

    Attributes
    ----------
    odts : list of list of Entry
    waiting : deque of int
        Packets of the last sample that are still to be sent, as 64-bit words.
    """

    odts: list[list[Entry]] = field(default_factory=list)
    mode: int = 0
    event: int = EventChannel.EPOCH
    prescaler: int = 1
    priority: int = 0
    is_selected: bool = False
    is_running: bool = False
    first_pid: int = 0
    waiting: deque[int] = field(default_factory=deque)
    _events: int = 0

    @property
    def is_stimulation(self) -> bool:
        """Whether its data go to the computer."""
        return bool(self.mode & STIM_MODE)

    @property
    def has_timestamp(self) -> bool:
        """Whether the first packet begins with the time."""
        return bool(self.mode & TIMESTAMP_MODE)

    def start(self, first_pid: int, size: int) -> None:
        """Begin.

        Parameters
        ----------
        first_pid : int
            Number of the first ODT.
        size : int
            Bytes of the memory.
        """
        self.first_pid = first_pid
        packets = np.zeros((len(self.odts), 1 + ODT_BYTES), dtype=np.uint8)
        packets[:, 0] = first_pid + np.arange(len(self.odts))
        self._packets = packets
        places: list[int] = []
        addresses: list[int] = []
        for k, entries in enumerate(self.odts):
            at = k * (1 + ODT_BYTES) + 1 + (TIMESTAMP_BYTES if self._is_stamped(k) else 0)
            for entry in entries:
                assert entry.address + entry.size <= size
                places += range(at, at + entry.size)
                addresses += range(entry.address, entry.address + entry.size)
                at += entry.size
        self._places = np.array(places, dtype=np.intp)
        self._addresses = np.array(addresses, dtype=np.intp)
        self._events = 0
        self._arrived = 0
        self.waiting.clear()
        self.is_running, self.is_selected = True, False

    def stop(self) -> None:
        """End, with the last sample incomplete."""
        self.is_running = self.is_selected = False
        self.waiting.clear()

    def _is_stamped(self, odt: int) -> bool:
        return odt == 0 and self.has_timestamp

    def fits(self) -> bool:
        """Return whether every entry is written, and every ODT fits into a packet."""
        for k, entries in enumerate(self.odts):
            room = ODT_BYTES - (TIMESTAMP_BYTES if self._is_stamped(k) else 0)
            if sum(entry.size for entry in entries) > room or any(not e.size for e in entries):
                return False
        return bool(self.odts)

    def is_due(self) -> bool:
        """Note an event of its channel; return whether it is sampled then."""
        self._events += 1
        if self._events < self.prescaler:
            return False
        self._events = 0
        return True

    def sample(self, image: NDArray[np.uint8], time: bytes) -> None:
        """Take all values of this moment."""
        packets = self._packets
        packets.reshape(-1)[self._places] = image[self._addresses]
        if self.has_timestamp:
            packets[0, 1 : 1 + TIMESTAMP_BYTES] = np.frombuffer(time, dtype=np.uint8)
        self.waiting.extend(packets.view("<u8")[:, 0].tolist())

    def receive(self, packet: bytes) -> dict[int, int] | None:
        """Take a packet of the master; return the bytes by address once all have come, or None."""
        k = packet[0] - self.first_pid
        self._packets[k, : len(packet)] = np.frombuffer(packet, dtype=np.uint8)
        self._arrived |= 1 << k
        if self._arrived != (1 << len(self.odts)) - 1:
            return None
        self._arrived = 0
        values = self._packets.reshape(-1)[self._places].tolist()
        return dict(zip(self._addresses.tolist(), values, strict=True))


class DaqLists:
    """All lists, and the pointer to the entry that is written next.

    Parameters
    ----------
    image : array of bytes
        The RAM image.

    Attributes
    ----------
    overloads : int
        Samples that were left out.
    samples : int
        Samples that were taken.
    """

    def __init__(self, image: NDArray[np.uint8]) -> None:
        self._image = image
        self.overloads = 0
        self.samples = 0
        self.free()

    def free(self) -> None:
        """Stop and forget all lists."""
        self.lists: list[DaqList] = []
        self._pointer: tuple[DaqList, int, int] | None = None
        self._running: list[DaqList] = []

    @property
    def is_running(self) -> bool:
        """Whether any list runs."""
        return bool(self._running)

    @property
    def stimulates(self) -> bool:
        """Whether any list of data for stimulation runs."""
        return any(one.is_stimulation for one in self._running)

    @property
    def odt_count(self) -> int:
        """ODTs of all lists."""
        return sum(len(one.odts) for one in self.lists)

    def allocate(self, count: int) -> None:
        """Make empty lists."""
        require(not self.lists, Fault.SEQUENCE)
        require(count <= LISTS_CAPACITY, Fault.MEMORY_OVERFLOW)
        self.lists = [DaqList() for _ in range(count)]

    def allocate_odts(self, number: int, count: int) -> None:
        """Make empty tables of a list."""
        one = self.get(number)
        is_first = not one.odts and not any(odt for other in self.lists for odt in other.odts)
        require(is_first, Fault.SEQUENCE)
        require(self.odt_count + count <= ODTS_CAPACITY, Fault.MEMORY_OVERFLOW)
        one.odts = [[] for _ in range(count)]

    def allocate_entries(self, number: int, odt: int, count: int) -> None:
        """Make empty entries of a table."""
        one = self.get(number)
        require(odt < len(one.odts), Fault.OUT_OF_RANGE)
        require(not one.odts[odt], Fault.SEQUENCE)
        require(count <= ODT_BYTES, Fault.MEMORY_OVERFLOW)
        one.odts[odt] = [Entry()] * count

    def get(self, number: int) -> DaqList:
        """Return a list; `XcpError` is raised without one."""
        require(number < len(self.lists), Fault.OUT_OF_RANGE)
        return self.lists[number]

    def idle(self, number: int) -> DaqList:
        """Return a list that does not run; `XcpError` is raised if it does."""
        one = self.get(number)
        require(not one.is_running, Fault.DAQ_ACTIVE)
        return one

    def clear(self, number: int) -> None:
        """Stop a list and empty its entries."""
        one = self.get(number)
        self.stop(one)
        one.odts = [[Entry()] * len(entries) for entries in one.odts]

    def point(self, number: int, odt: int, entry: int) -> None:
        """Choose the entry that is written next."""
        one = self.idle(number)
        require(odt < len(one.odts) and entry < len(one.odts[odt]), Fault.OUT_OF_RANGE)
        self._pointer = one, odt, entry

    def _entry(self) -> tuple[list[Entry], int]:
        """Return the place pointed to, and point to the next one."""
        require(self._pointer is not None, Fault.SEQUENCE)
        assert self._pointer is not None
        one, odt, entry = self._pointer
        entries = one.odts[odt]
        self._pointer = (one, odt, entry + 1) if entry + 1 < len(entries) else None
        return entries, entry

    def write(self, size: int, address: int) -> None:
        """Write an entry."""
        require(0 < size <= ODT_BYTES, Fault.OUT_OF_RANGE)
        require(address + size <= len(self._image), Fault.ACCESS_DENIED)
        entries, k = self._entry()
        entries[k] = Entry(size, address)

    def read(self) -> Entry:
        """Read an entry."""
        entries, k = self._entry()
        return entries[k]

    def first_pid(self, one: DaqList) -> int:
        """Return the number of a list's first ODT."""
        before = self.lists[: next(k for k, other in enumerate(self.lists) if other is one)]
        return sum(len(other.odts) for other in before)

    def check(self, one: DaqList) -> None:
        """Raise `XcpError` unless a list can start."""
        require(one.fits(), Fault.DAQ_CONFIG)
        require(self.first_pid(one) + len(one.odts) <= FIRST_COMMAND, Fault.DAQ_CONFIG)

    def start(self, one: DaqList) -> None:
        """Start a list that can."""
        if not one.is_running:
            one.start(self.first_pid(one), len(self._image))
            self._running.append(one)
            self._running.sort(key=operator.attrgetter("priority"), reverse=True)

    def stop(self, one: DaqList) -> None:
        """Stop a list."""
        one.stop()
        self._running = [other for other in self._running if other is not one]

    def stop_all(self) -> None:
        """Stop all lists."""
        for one in self.lists:
            self.stop(one)

    def sample(self, channels: tuple[EventChannel, ...], time: bytes) -> bool:
        """Sample the lists that are due at events of these channels; return whether all could be.

        Parameters
        ----------
        channels : tuple of EventChannel
        time : bytes
            Timestamp.
        """
        is_complete = True
        for one in self._running:
            if one.is_stimulation or one.event not in channels or not one.is_due():
                continue
            if one.waiting:
                self.overloads += 1
                is_complete = False
                continue
            one.sample(self._image, time)
            self.samples += 1
        return is_complete

    def take(self, room: int) -> list[int]:
        """Return the packets that are sent next, `room` of them at most."""
        packets: list[int] = []
        for one in self._running:
            while one.waiting and len(packets) < room:
                packets.append(one.waiting.popleft())
        return packets

    def stimulation(self, packets: list[bytes]) -> Iterator[dict[int, int]]:
        """Yield the data of every list whose packets are complete: bytes by address."""
        lists = [one for one in self._running if one.is_stimulation]
        for packet in packets:
            for one in lists:
                if 0 <= packet[0] - one.first_pid < len(one.odts):
                    values = one.receive(packet)
                    if values is not None:
                        yield values
