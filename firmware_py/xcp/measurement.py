"""Commands that set up, start and stop lists of measured data and of data for stimulation."""

from __future__ import annotations

import struct

from rrins.firmware_py.xcp.daq import STIM_MODE, TIMESTAMP_MODE, DaqList, EventChannel
from rrins.firmware_py.xcp.protocol import (
    ODT_BYTES,
    TICK_NS,
    TIMESTAMP_BYTES,
    TIMESTAMP_UNIT,
    Command,
    Fault,
    Resource,
    require,
)
from rrins.firmware_py.xcp.session import Row, Session, address_of
from rrins.firmware_py.xcp.stimulation import Stimulation

# Of DAQ_PROPERTIES: dynamic lists, prescaler, time stamps, overload told by an event.
_PROPERTIES = 0x01 | 0x02 | 0x10 | 0x80
_ENTRY_NOT_BITS = 0xFF  # bit offset of an entry that is no single bit
_DAQ_ALLOWED, _STIM_ALLOWED = 0x04, 0x08
_CONSISTENT_EVENT = 0x80  # all lists of an event are of the same moment
_ANY_NUMBER = 0xFF
_SELECTED, _RUNNING = 0x01, 0x40
_NS_EXPONENTS = 10  # codes 0 to 9 of a time unit: 1 ns, 10 ns, … 1 s


def cycle_of(period_ns: int) -> tuple[int, int]:
    """Return a period as time cycle and unit of an event channel; (0, 0) if it has none."""
    for unit in range(_NS_EXPONENTS):
        cycle, rest = divmod(period_ns, 10**unit)
        if not rest and cycle <= 0xFF:
            return cycle, unit
    return 0, 0


class Measurement:
    """Handlers of the commands."""

    def __init__(self, session: Session, stimulation: Stimulation, period_ns: int) -> None:
        self._session = session
        self._daq = session.daq
        self._stimulation = stimulation
        self._channels = {
            EventChannel.EPOCH: (cycle_of(period_ns), _DAQ_ALLOWED | _STIM_ALLOWED),
            EventChannel.SECOND: ((1, 9), _DAQ_ALLOWED),
        }

    def rows(self) -> tuple[Row, ...]:
        """Return the commands."""
        return (
            Row(Command.CLEAR_DAQ_LIST, 3, self._clear),
            Row(Command.SET_DAQ_PTR, 5, self._point),
            Row(Command.WRITE_DAQ, 7, self._write),
            Row(Command.READ_DAQ, 0, self._read),
            Row(Command.SET_DAQ_LIST_MODE, 7, self._set_mode),
            Row(Command.GET_DAQ_LIST_MODE, 3, self._mode),
            Row(Command.START_STOP_DAQ_LIST, 3, self._start_stop),
            Row(Command.START_STOP_SYNCH, 1, self._start_stop_all),
            Row(Command.GET_DAQ_CLOCK, 0, self._clock),
            Row(Command.GET_DAQ_PROCESSOR_INFO, 0, self._processor),
            Row(Command.GET_DAQ_RESOLUTION_INFO, 0, self._resolution),
            Row(Command.GET_DAQ_LIST_INFO, 3, self._list_info),
            Row(Command.GET_DAQ_EVENT_INFO, 3, self._event_info),
            Row(Command.FREE_DAQ, 0, self._free),
            Row(Command.ALLOC_DAQ, 3, self._allocate),
            Row(Command.ALLOC_ODT, 4, self._allocate_odts),
            Row(Command.ALLOC_ODT_ENTRY, 5, self._allocate_entries),
        )

    def time(self, epoch_ns: int) -> bytes:
        """Return a timestamp."""
        ticks = epoch_ns // TICK_NS & 0xFFFF_FFFF
        return ticks.to_bytes(TIMESTAMP_BYTES, "little")

    def _clear(self, data: bytes) -> bytes:
        self._daq.clear(_word(data, 1))
        return b""

    def _point(self, data: bytes) -> bytes:
        self._daq.point(_word(data, 1), data[3], data[4])
        return b""

    def _write(self, data: bytes) -> bytes:
        require(data[0] == _ENTRY_NOT_BITS, Fault.OUT_OF_RANGE)
        self._daq.write(data[1], address_of(data[2:]))
        return b""

    def _read(self, data: bytes) -> bytes:
        entry = self._daq.read()
        return struct.pack("<BBBL", _ENTRY_NOT_BITS, entry.size, 0, entry.address)

    def _set_mode(self, data: bytes) -> bytes:
        mode, number, event, prescaler, priority = struct.unpack("<BHHBB", data[:7])
        one = self._daq.idle(number)
        require(not mode & ~(STIM_MODE | TIMESTAMP_MODE), Fault.MODE_NOT_VALID)
        require(event in list(EventChannel) and prescaler > 0, Fault.OUT_OF_RANGE)
        if mode & STIM_MODE:
            locked = self._session.protection & Resource.STIM
            require(not locked, Fault.ACCESS_LOCKED)
            require(event == EventChannel.EPOCH and prescaler == 1, Fault.OUT_OF_RANGE)
        one.mode, one.event = mode, event
        one.prescaler, one.priority = prescaler, priority
        return b""

    def _mode(self, data: bytes) -> bytes:
        one = self._daq.get(_word(data, 1))
        mode = one.mode | _SELECTED * one.is_selected | _RUNNING * one.is_running
        return struct.pack("<BHHBB", mode, 0, one.event, one.prescaler, one.priority)

    def _start_stop(self, data: bytes) -> bytes:
        mode, number = data[0], _word(data, 1)
        one = self._daq.get(number)
        require(mode < 3, Fault.MODE_NOT_VALID)
        if mode == 0:
            self._daq.stop(one)
        else:
            self._check(one)
            one.is_selected = mode == 2
            if mode == 1:
                self._daq.start(one)
        return bytes([self._daq.first_pid(one) & 0xFF])

    def _check(self, one: DaqList) -> None:
        self._daq.check(one)
        if one.is_stimulation:
            entries = [entry for odt in one.odts for entry in odt]
            ranges = (range(entry.address, entry.address + entry.size) for entry in entries)
            self._stimulation.check(frozenset(byte for part in ranges for byte in part))

    def _start_stop_all(self, data: bytes) -> bytes:
        mode, daq = data[0], self._daq
        require(mode < 3, Fault.MODE_NOT_VALID)
        if mode == 0:
            daq.stop_all()
            return b""
        selected = [one for one in daq.lists if one.is_selected]
        for one in selected:
            if mode == 1:
                self._check(one)
        for one in selected:
            if mode == 1:
                daq.start(one)
            else:
                daq.stop(one)
        return b""

    def _clock(self, data: bytes) -> bytes:
        return b"\0\0\0" + self.time(self._session.now_ns)

    def _processor(self, data: bytes) -> bytes:
        return struct.pack("<BHHBB", _PROPERTIES, len(self._daq.lists), len(EventChannel), 0, 0)

    def _resolution(self, data: bytes) -> bytes:
        mode = TIMESTAMP_BYTES | TIMESTAMP_UNIT << 4
        return struct.pack("<BBBBBH", 1, ODT_BYTES, 1, ODT_BYTES, mode, 1)

    def _list_info(self, data: bytes) -> bytes:
        one = self._daq.get(_word(data, 1))
        most = max((len(entries) for entries in one.odts), default=0)
        return struct.pack("<BBBH", _DAQ_ALLOWED | _STIM_ALLOWED, len(one.odts), most, 0)

    def _event_info(self, data: bytes) -> bytes:
        number = _word(data, 1)
        require(number in list(EventChannel), Fault.OUT_OF_RANGE)
        channel = EventChannel(number)
        (cycle, unit), allowed = self._channels[channel]
        length = self._session.offer(channel.name.lower().encode())
        properties = allowed | _CONSISTENT_EVENT
        return bytes([properties, _ANY_NUMBER, length, cycle, unit, 0])

    def _free(self, data: bytes) -> bytes:
        self._daq.free()
        return b""

    def _allocate(self, data: bytes) -> bytes:
        self._daq.allocate(_word(data, 1))
        return b""

    def _allocate_odts(self, data: bytes) -> bytes:
        self._daq.allocate_odts(_word(data, 1), data[3])
        return b""

    def _allocate_entries(self, data: bytes) -> bytes:
        self._daq.allocate_entries(_word(data, 1), data[3], data[4])
        return b""


def _word(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 2], "little")
