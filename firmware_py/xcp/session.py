"""Session of a tool: whether it is connected, what it has unlocked, and where it reads and writes.

The standard commands of XCP. A command's handler takes the bytes after the command's code, at least
as many as its row says, and returns those after the code of the positive response. A longer answer
than a packet holds is a block (slave block mode); None is an answer that is still to come.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics import access
from rrins.firmware_py.diagnostics.seed_and_key import SeedAndKey, Verdict
from rrins.firmware_py.version import VERSION
from rrins.firmware_py.xcp.daq import DaqLists
from rrins.firmware_py.xcp.memory import TEXT_ADDRESS, Memory
from rrins.firmware_py.xcp.protocol import (
    BLOCK_PACKETS,
    CHECKSUM_CAPACITY,
    MAX_CTO,
    MAX_DTO,
    PROTECTED,
    RESOURCES,
    Command,
    Fault,
    XcpError,
    require,
)
from rrins.firmware_py.xcp.protocol import (
    VERSION as XCP_VERSION,
)

A2L_NAME = "rrins"
"""Name of the A2L file, without its ending."""

Handler = Callable[[bytes], bytes | None]


@dataclass(frozen=True)
class Row:
    """A command of this slave."""

    command: Command
    size: int  #: bytes after the command's code, at least
    handler: Handler
    resource: int = 0  #: `Resource` that must be unlocked


class IdType(IntEnum):
    """Identifications of GET_ID."""

    TEXT = 0
    A2L_NAME = 1
    A2L_FILE = 2
    A2L_TEXT = 4


_INTEL, _SLAVE_BLOCKS, _OPTIONAL = 0x00, 0x40, 0x80  # of COMM_MODE_BASIC
_MASTER_BLOCKS = 0x01  # of COMM_MODE_OPTIONAL
_DAQ_RUNNING = 0x40  # of the session status
_CRC_32 = 0x09
_KEY_PART = MAX_CTO - 2  # bytes of seed or key in a packet
_DRIVER_VERSION = 0x10
_GET_DAQ_ID = 0xFE  # of TRANSPORT_LAYER_CMD


@dataclass
class Session:
    """State that commands share.

    Attributes
    ----------
    a2l : callable
        Returns the text of the A2L file.
    now_ns : int
        Time since power-on.
    mta : int
        Memory transfer address.
    """

    memory: Memory
    daq: DaqLists
    keys: SeedAndKey
    a2l: Callable[[], str]
    now_ns: int = 0
    is_connected: bool = False
    unlocked: int = 0
    mta: int = 0
    _seed_left: bytes = b""
    _resource: int = 0
    _key: bytes = b""

    def rows(self) -> tuple[Row, ...]:
        """Return the standard commands."""
        return (
            Row(Command.CONNECT, 1, self._connect),
            Row(Command.DISCONNECT, 0, self._disconnect),
            Row(Command.GET_STATUS, 0, self._status),
            Row(Command.SYNCH, 0, self._synch),
            Row(Command.GET_COMM_MODE_INFO, 0, self._comm_mode),
            Row(Command.GET_ID, 1, self._identify),
            Row(Command.SET_REQUEST, 3, self._request),
            Row(Command.GET_SEED, 2, self._give_seed),
            Row(Command.UNLOCK, 1, self._unlock),
            Row(Command.SET_MTA, 7, self._set_mta),
            Row(Command.UPLOAD, 1, self._upload),
            Row(Command.SHORT_UPLOAD, 7, self._short_upload),
            Row(Command.BUILD_CHECKSUM, 7, self._checksum),
            Row(Command.TRANSPORT_LAYER_CMD, 3, self._transport),
        )

    def end(self) -> None:
        """End the session: lists stop, and what was unlocked is locked again."""
        self.is_connected = False
        self.unlocked = 0
        self.keys.forget()
        self._seed_left = self._key = b""
        self.daq.stop_all()

    @property
    def protection(self) -> int:
        """Resources that are locked, one bit each."""
        return PROTECTED & ~self.unlocked

    def _connect(self, data: bytes) -> bytes:
        self.is_connected = True
        mode = _INTEL | _SLAVE_BLOCKS | _OPTIONAL
        return struct.pack("<BBBHBB", RESOURCES, mode, MAX_CTO, MAX_DTO, XCP_VERSION, XCP_VERSION)

    def _disconnect(self, data: bytes) -> bytes:
        self.end()
        return b""

    def _status(self, data: bytes) -> bytes:
        status = _DAQ_RUNNING if self.daq.is_running else 0
        return struct.pack("<BBBH", status, self.protection, 0, 0)

    def _synch(self, data: bytes) -> bytes:
        raise XcpError(Fault.CMD_SYNCH)

    def _comm_mode(self, data: bytes) -> bytes:
        return bytes([0, _MASTER_BLOCKS, 0, BLOCK_PACKETS, 0, 0, _DRIVER_VERSION])

    def _identify(self, data: bytes) -> bytes:
        texts = {
            IdType.TEXT: lambda: f"RRINS {VERSION}",
            IdType.A2L_NAME: lambda: A2L_NAME,
            IdType.A2L_FILE: lambda: f"{A2L_NAME}.a2l",
            IdType.A2L_TEXT: self.a2l,
        }
        text = texts[IdType(data[0])]().encode() if data[0] in list(IdType) else b""
        return struct.pack("<BHL", 0, 0, self.offer(text))

    def offer(self, text: bytes) -> int:
        """Let the tool upload a text next; return its length."""
        self.memory.text = text
        self.mta = TEXT_ADDRESS
        return len(text)

    def _request(self, data: bytes) -> bytes:
        raise XcpError(Fault.OUT_OF_RANGE)  # nothing is stored, and lists do not resume

    def _give_seed(self, data: bytes) -> bytes:
        mode, resource = data[:2]
        if mode == 0:
            require(resource in (1, 4, 8, 16), Fault.OUT_OF_RANGE)
            if not resource & self.protection:
                return b"\0"
            seed = self.keys.seed(self.now_ns)
            require(seed is not None, Fault.ACCESS_LOCKED)
            self._seed_left, self._resource, self._key = seed or b"", resource, b""
        else:
            require(mode == 1 and bool(self._seed_left), Fault.SEQUENCE)
        part, length = self._seed_left[:_KEY_PART], len(self._seed_left)
        self._seed_left = self._seed_left[_KEY_PART:]
        return bytes([length]) + part

    def _unlock(self, data: bytes) -> bytes:
        left = data[0]
        require(left == access.KEY_SIZE - len(self._key), Fault.SEQUENCE)
        self._key += data[1 : 1 + min(left, _KEY_PART)]
        if len(self._key) == access.KEY_SIZE:
            key, self._key = self._key, b""
            verdict = self.keys.check(key, self.now_ns)
            require(verdict is not Verdict.NO_SEED, Fault.SEQUENCE)
            if verdict is not Verdict.RIGHT:
                self.end()
                raise XcpError(Fault.ACCESS_LOCKED)
            self.unlocked |= self._resource
        return bytes([self.protection])

    def _set_mta(self, data: bytes) -> bytes:
        self.mta = address_of(data[2:])
        return b""

    def _upload(self, data: bytes) -> bytes:
        require(data[0] > 0, Fault.OUT_OF_RANGE)
        found = self.memory.read(self.mta, data[0])
        self.mta += data[0]
        return found

    def _short_upload(self, data: bytes) -> bytes:
        require(0 < data[0] < MAX_CTO, Fault.OUT_OF_RANGE)
        address = address_of(data[2:])
        found = self.memory.read(address, data[0])
        self.mta = address + data[0]
        return found

    def _checksum(self, data: bytes) -> bytes:
        (size,) = struct.unpack("<L", data[3:7])
        if not 0 < size <= CHECKSUM_CAPACITY:
            raise XcpError(Fault.OUT_OF_RANGE, struct.pack("<HL", 0, CHECKSUM_CAPACITY))
        checksum = self.memory.checksum(self.mta, size)
        self.mta += size
        return struct.pack("<BHL", _CRC_32, 0, checksum)

    def _transport(self, data: bytes) -> bytes:
        require(data[0] == _GET_DAQ_ID, Fault.CMD_UNKNOWN)
        self.daq.get(int.from_bytes(data[1:3], "little"))
        return struct.pack("<BHL", 1, 0, load().frame_id("XCP_RESPONSE"))


def address_of(data: bytes) -> int:
    """Return the address in an extension and a double word; `XcpError` is raised for another."""
    require(data[0] == 0, Fault.OUT_OF_RANGE)
    return int.from_bytes(data[1:5], "little")
