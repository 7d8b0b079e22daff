"""Commands that change parameters and pages."""

from __future__ import annotations

import struct

from rrins.firmware_py.xcp.pages import PAGES, REFERENCE, WORKING
from rrins.firmware_py.xcp.protocol import (
    BLOCK_CAPACITY,
    MAX_CTO,
    Command,
    Fault,
    Resource,
    XcpError,
    require,
)
from rrins.firmware_py.xcp.session import Row, Session, address_of

_DATA = MAX_CTO - 2  # bytes of DOWNLOAD and DOWNLOAD_NEXT in a packet
_BY_COMPUTER, _BY_TOOL, _ALL_SEGMENTS = 0x01, 0x02, 0x80  # of SET_CAL_PAGE
_ANY_ACCESS = 0x3F  # of a page: computer and tool, alone and together
_READ_ACCESS = 0x0F


class Calibration:
    """Handlers of the calibration commands."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._pages = session.memory.pages
        self._block = b""
        self._block_left = 0

    def rows(self) -> tuple[Row, ...]:
        """Return the commands."""
        locked = Resource.CALIBRATION
        return (
            Row(Command.DOWNLOAD, 1, self._download, locked),
            Row(Command.DOWNLOAD_NEXT, 1, self._download_next, locked),
            Row(Command.DOWNLOAD_MAX, MAX_CTO - 1, self._download_max, locked),
            Row(Command.SHORT_DOWNLOAD, 7, self._short_download, locked),
            Row(Command.MODIFY_BITS, 5, self._modify_bits, locked),
            Row(Command.SET_CAL_PAGE, 3, self._set_page, locked),
            Row(Command.GET_CAL_PAGE, 2, self._page),
            Row(Command.GET_PAG_PROCESSOR_INFO, 0, self._processor),
            Row(Command.GET_SEGMENT_INFO, 3, self._segment),
            Row(Command.GET_PAGE_INFO, 3, self._page_info),
            Row(Command.SET_SEGMENT_MODE, 2, self._set_mode, locked),
            Row(Command.GET_SEGMENT_MODE, 2, self._mode),
            Row(Command.COPY_CAL_PAGE, 4, self._copy, locked),
        )

    def forget_block(self) -> None:
        """Drop a block that is not complete, as another command has come."""
        self._block_left = 0

    def _write(self, data: bytes) -> bytes:
        session = self._session
        session.memory.write(session.mta, data)
        session.mta += len(data)
        return b""

    def _download(self, data: bytes) -> bytes | None:
        count = data[0]
        require(0 < count <= BLOCK_CAPACITY, Fault.OUT_OF_RANGE)
        require(len(data) - 1 >= min(count, _DATA), Fault.CMD_SYNTAX)
        self._block, self._block_left = b"", count
        return self._take(data[1:])

    def _download_next(self, data: bytes) -> bytes | None:
        left = self._block_left
        if not left or data[0] != left or len(data) - 1 < min(left, _DATA):
            self._block_left = 0
            raise XcpError(Fault.SEQUENCE, bytes([left]))
        return self._take(data[1:])

    def _take(self, data: bytes) -> bytes | None:
        """Take a packet's data of a block; write the block once it is whole."""
        part = data[: min(self._block_left, _DATA)]
        self._block += part
        self._block_left -= len(part)
        return self._write(self._block) if not self._block_left else None

    def _download_max(self, data: bytes) -> bytes:
        return self._write(data[: MAX_CTO - 1])

    def _short_download(self, data: bytes) -> bytes:
        # Its head fills a packet of classic CAN: no byte can follow (XCP 1.0, part 2, 1.6.2.2.3).
        require(data[0] == 0, Fault.OUT_OF_RANGE)
        self._session.mta = address_of(data[2:])
        return b""

    def _modify_bits(self, data: bytes) -> bytes:
        shift, keep, toggle = struct.unpack("<BHH", data[:5])
        require(shift < 32, Fault.OUT_OF_RANGE)
        mask = ~((~keep & 0xFFFF) << shift) & 0xFFFF_FFFF
        session = self._session
        session.memory.modify_bits(session.mta, mask, (toggle << shift) & 0xFFFF_FFFF)
        return b""

    def _set_page(self, data: bytes) -> bytes:
        mode, number, page = data[:3]
        require(page < PAGES, Fault.PAGE_NOT_VALID)
        require(bool(mode & (_BY_COMPUTER | _BY_TOOL)), Fault.MODE_NOT_VALID)
        is_all = mode & _ALL_SEGMENTS
        for segment in self._pages.segments if is_all else (self._pages.segment(number),):
            if mode & _BY_COMPUTER:
                segment.computer_page = page
            if mode & _BY_TOOL:
                segment.tool_page = page
            segment.apply()
        return b""

    def _page(self, data: bytes) -> bytes:
        segment = self._pages.segment(data[1])
        require(data[0] in (_BY_COMPUTER, _BY_TOOL), Fault.MODE_NOT_VALID)
        is_tool = data[0] == _BY_TOOL
        return bytes([0, 0, segment.tool_page if is_tool else segment.computer_page])

    def _processor(self, data: bytes) -> bytes:
        return bytes([len(self._pages.segments), 0])

    def _segment(self, data: bytes) -> bytes:
        mode, number, info = data[:3]
        segment = self._pages.segment(number)
        if mode == 0:
            require(info < 2, Fault.OUT_OF_RANGE)
            return struct.pack("<BHL", 0, 0, (segment.address, segment.size)[info])
        require(mode == 1, Fault.OUT_OF_RANGE)
        return bytes([PAGES, 0, 0, 0, 0])

    def _page_info(self, data: bytes) -> bytes:
        self._pages.segment(data[1])
        require(data[2] < PAGES, Fault.PAGE_NOT_VALID)
        return bytes([_ANY_ACCESS if data[2] == WORKING else _READ_ACCESS, data[1]])

    def _set_mode(self, data: bytes) -> bytes:
        self._pages.segment(data[1])
        require(data[0] == 0, Fault.MODE_NOT_VALID)  # no page is kept at power-off
        return b""

    def _mode(self, data: bytes) -> bytes:
        self._pages.segment(data[1])
        return bytes([0, 0])

    def _copy(self, data: bytes) -> bytes:
        source, from_page, target, to_page = data[:4]
        segment = self._pages.segment(target)
        self._pages.segment(source)
        require(from_page < PAGES and to_page < PAGES, Fault.PAGE_NOT_VALID)
        require(to_page == WORKING, Fault.WRITE_PROTECTED)
        require(source == target and from_page == REFERENCE, Fault.SEGMENT_NOT_VALID)
        segment.restore()
        return b""
