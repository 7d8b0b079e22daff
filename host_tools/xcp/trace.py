"""Measured data in a trace: the lists that a tool sets up, and the values of their signals."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from rrins.dbc.codec import load
from rrins.firmware_py.xcp.daq import STIM_MODE, TIMESTAMP_MODE
from rrins.firmware_py.xcp.protocol import (
    FIRST_COMMAND,
    MAX_CTO,
    TIMESTAMP_BYTES,
    Command,
    Packet,
)
from rrins.host_tools.monitor.dialogue import MeasuredRow
from rrins.host_tools.xcp.samples import Samples
from rrins.host_tools.xcp.signals import Signal, elements

_Entry = tuple[int, int]  # address and size
_Entries = tuple[_Entry, ...]


@functools.cache
def _by_address() -> dict[int, Signal]:
    return {signal.address: signal for signal in elements()}


@functools.lru_cache(maxsize=64)
def _layout(entries: _Entries) -> tuple[tuple[Signal, tuple[int, ...]], ...]:
    """Return the signals of a list, each with the places of its bytes in a sample."""
    addresses = [address + k for address, size in entries for k in range(size)]
    places = {address: place for place, address in enumerate(addresses)}
    found = []
    for address in addresses:
        signal = _by_address().get(address)
        if signal is not None:
            bytes_of = [places.get(address + k, -1) for k in range(signal.size)]
            if min(bytes_of) >= 0:
                found.append((signal, tuple(bytes_of)))
    return tuple(found)


class _List:
    """A list as far as its set-up was seen."""

    def __init__(self) -> None:
        self.odts = 0
        self.mode = 0
        self.entries: dict[tuple[int, int], _Entry] = {}  # by ODT and number
        self._samples = Samples(0)
        self._last = b""

    @property
    def _head(self) -> int:
        return TIMESTAMP_BYTES if self.mode & TIMESTAMP_MODE else 0

    def begin(self, first: int) -> list[int]:
        """Number the ODTs from `first` on; return the bytes of their packets."""
        self._samples = Samples(self.odts, first)
        sizes = [1] * self.odts
        sizes[:1] = [1 + self._head] * bool(self.odts)
        for (odt, _), (_, size) in self.entries.items():
            if odt < self.odts:
                sizes[odt] += size
        return sizes

    def put(self, packet: bytes) -> None:
        """Take a packet."""
        self._samples.put(packet)
        if self._samples.rows:
            self._last = self._samples.rows.pop()

    def rows(self) -> list[MeasuredRow]:
        """Return the values of the last whole sample."""
        if not self._last:
            return []
        found = []
        for signal, places in _layout(tuple(self.entries[key] for key in sorted(self.entries))):
            octets = bytes(self._last[self._head + place] for place in places)
            value = np.frombuffer(octets, dtype=signal.field.dtype)[0].item()
            words, field = signal.words(value), signal.field
            found.append(MeasuredRow(signal.name, value, words, field.unit, field.text))
        return found


class MeasuredData:
    """Follows the measured data on a bus: the latest value of each signal, by name.

    A list is known if the commands that set it up were seen.
    """

    def __init__(self) -> None:
        self._command, self._response = map(load().frame_id, ("XCP_COMMAND", "XCP_RESPONSE"))
        self._lists: dict[int, _List] = {}
        self._by_packet: dict[int, tuple[_List, int]] = {}  # with the packet's bytes
        self._pointer = (0, 0, 0)  # list, ODT, entry
        self._asked = b""
        self._setters: dict[int, Callable[[bytes], None]] = {
            Command.FREE_DAQ: self._free,
            Command.ALLOC_ODT: self._allocate,
            Command.SET_DAQ_PTR: self._point,
            Command.WRITE_DAQ: self._write,
            Command.SET_DAQ_LIST_MODE: self._set_mode,
        }

    def add(self, can_id: int, data: bytes) -> None:
        """Take the next frame."""
        if not data:
            return
        if can_id == self._command and data[0] >= FIRST_COMMAND:
            self._asked = data
        elif can_id == self._response:
            self._hear(data)

    def _hear(self, data: bytes) -> None:
        if data[0] in self._by_packet:
            one, size = self._by_packet[data[0]]
            one.put(data[:size])
        elif data[0] in (Packet.RESPONSE, Packet.ERROR):
            asked, self._asked = self._asked, b""
            setter = self._setters.get(asked[0]) if asked else None
            if setter is not None and data[0] == Packet.RESPONSE:
                setter(asked.ljust(MAX_CTO, b"\0"))
                self._number()

    def forget(self) -> None:
        """Forget what has begun: frames are missing."""
        self._asked = b""

    @property
    def rows(self) -> list[MeasuredRow]:
        """The latest value of each signal."""
        return [row for _, one in sorted(self._lists.items()) for row in one.rows()]

    def _number(self) -> None:
        """Give the ODTs of all lists their numbers."""
        self._by_packet.clear()
        first = 0
        for _, one in sorted(self._lists.items()):
            for odt, size in enumerate(one.begin(first)):
                if not one.mode & STIM_MODE:
                    self._by_packet[first + odt] = one, size
            first += one.odts

    def _list(self, data: bytes) -> _List:
        return self._lists.setdefault(int.from_bytes(data[2:4], "little"), _List())

    def _free(self, data: bytes) -> None:
        self._lists.clear()

    def _allocate(self, data: bytes) -> None:
        self._list(data).odts += data[4]

    def _point(self, data: bytes) -> None:
        self._pointer = int.from_bytes(data[2:4], "little"), data[4], data[5]

    def _write(self, data: bytes) -> None:
        number, odt, entry = self._pointer
        self._lists.setdefault(number, _List()).entries[odt, entry] = (
            int.from_bytes(data[4:8], "little"),
            data[2],
        )
        self._pointer = number, odt, entry + 1

    def _set_mode(self, data: bytes) -> None:
        self._list(data).mode = data[1]
