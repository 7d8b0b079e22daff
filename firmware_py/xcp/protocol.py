"""Numbers of XCP (ASAM MCD-1 XCP 1.5, part 2), and the limits of this slave."""

from __future__ import annotations

from enum import IntEnum


class Command(IntEnum):
    """Commands: the first byte of a command packet."""

    CONNECT = 0xFF
    DISCONNECT = 0xFE
    GET_STATUS = 0xFD
    SYNCH = 0xFC
    GET_COMM_MODE_INFO = 0xFB
    GET_ID = 0xFA
    SET_REQUEST = 0xF9
    GET_SEED = 0xF8
    UNLOCK = 0xF7
    SET_MTA = 0xF6
    UPLOAD = 0xF5
    SHORT_UPLOAD = 0xF4
    BUILD_CHECKSUM = 0xF3
    TRANSPORT_LAYER_CMD = 0xF2
    DOWNLOAD = 0xF0
    DOWNLOAD_NEXT = 0xEF
    DOWNLOAD_MAX = 0xEE
    SHORT_DOWNLOAD = 0xED
    MODIFY_BITS = 0xEC
    SET_CAL_PAGE = 0xEB
    GET_CAL_PAGE = 0xEA
    GET_PAG_PROCESSOR_INFO = 0xE9
    GET_SEGMENT_INFO = 0xE8
    GET_PAGE_INFO = 0xE7
    SET_SEGMENT_MODE = 0xE6
    GET_SEGMENT_MODE = 0xE5
    COPY_CAL_PAGE = 0xE4
    CLEAR_DAQ_LIST = 0xE3
    SET_DAQ_PTR = 0xE2
    WRITE_DAQ = 0xE1
    SET_DAQ_LIST_MODE = 0xE0
    GET_DAQ_LIST_MODE = 0xDF
    START_STOP_DAQ_LIST = 0xDE
    START_STOP_SYNCH = 0xDD
    GET_DAQ_CLOCK = 0xDC
    READ_DAQ = 0xDB
    GET_DAQ_PROCESSOR_INFO = 0xDA
    GET_DAQ_RESOLUTION_INFO = 0xD9
    GET_DAQ_LIST_INFO = 0xD8
    GET_DAQ_EVENT_INFO = 0xD7
    FREE_DAQ = 0xD6
    ALLOC_DAQ = 0xD5
    ALLOC_ODT = 0xD4
    ALLOC_ODT_ENTRY = 0xD3


class Packet(IntEnum):
    """First byte of a packet of the slave that is not measured data."""

    RESPONSE = 0xFF
    ERROR = 0xFE
    EVENT = 0xFD


class Event(IntEnum):
    """Events that the slave tells."""

    STORE_CAL = 0x03
    DAQ_OVERLOAD = 0x06
    SESSION_TERMINATED = 0x07
    STIM_TIMEOUT = 0x09


class Fault(IntEnum):
    """Why a command is refused."""

    CMD_SYNCH = 0x00
    CMD_BUSY = 0x10
    DAQ_ACTIVE = 0x11
    CMD_UNKNOWN = 0x20
    CMD_SYNTAX = 0x21
    OUT_OF_RANGE = 0x22
    WRITE_PROTECTED = 0x23
    ACCESS_DENIED = 0x24
    ACCESS_LOCKED = 0x25
    PAGE_NOT_VALID = 0x26
    MODE_NOT_VALID = 0x27
    SEGMENT_NOT_VALID = 0x28
    SEQUENCE = 0x29
    DAQ_CONFIG = 0x2A
    MEMORY_OVERFLOW = 0x30


class Resource(IntEnum):
    """The resources that a tool can use, one bit each."""

    CALIBRATION = 0x01
    DAQ = 0x04
    STIM = 0x08


RESOURCES = Resource.CALIBRATION | Resource.DAQ | Resource.STIM
PROTECTED = Resource.CALIBRATION | Resource.STIM
"""Resources that need the key, as writing by UDS does."""

VERSION = 0x01
"""Major version of protocol and transport layer."""

MAX_CTO = MAX_DTO = 8
"""Longest packet: a classic CAN frame."""

BLOCK_CAPACITY = 255
"""Bytes of a block of UPLOAD or DOWNLOAD."""

BLOCK_PACKETS = 43
"""Packets of the longest block of DOWNLOAD (MAX_BS)."""

CHECKSUM_CAPACITY = 1 << 22
"""Longest range of BUILD_CHECKSUM, bytes."""

ODT_BYTES = MAX_DTO - 1
"""Data of an ODT: a packet without its number."""

TIMESTAMP_BYTES = 4
TIMESTAMP_UNIT = 3
"""Code of 1 µs; one tick is one unit."""
TICK_NS = 1000

LISTS_CAPACITY = 64
ODTS_CAPACITY = 0xC0
"""ODTs of all lists: the numbers that stimulation can use, too."""

FIRST_COMMAND = 0xC0
"""First byte from which a packet of the master is a command, below data for stimulation."""


class XcpError(Exception):
    """A command is refused.

    Attributes
    ----------
    fault : Fault
    details : bytes
        What the error packet adds.
    """

    def __init__(self, fault: Fault, details: bytes = b"") -> None:
        super().__init__(fault.name)
        self.fault = fault
        self.details = details


def require(holds: bool, fault: Fault) -> None:
    """Raise `XcpError` unless the condition holds."""
    if not holds:
        raise XcpError(fault)
