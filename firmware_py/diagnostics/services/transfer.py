"""Upload and download of the calibration file: 0x34 to 0x37."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics.access import Session
from rrins.firmware_py.diagnostics.calibration_image import ImageError, Parameters
from rrins.firmware_py.diagnostics.computer import Computer
from rrins.firmware_py.diagnostics.refusal import Answer, Later, RefusalError, require
from rrins.firmware_py.diagnostics.regions import (
    BLOCK_LENGTH,
    CALIBRATION_ADDRESS,
    CALIBRATION_CAPACITY,
)
from rrins.firmware_py.diagnostics.responses import Code
from rrins.firmware_py.diagnostics.server import Handler, Part, Server
from rrins.firmware_py.diagnostics.services.data import address_and_size

_PLAIN = 0x00  # dataFormatIdentifier: neither compressed nor encrypted
_LENGTH_FORMAT = 0x20  # maxNumberOfBlockLength has two bytes
_BLOCK = BLOCK_LENGTH - 2
_CRC_SIZE = 4


@dataclass
class _Transfer:
    """A transfer in progress."""

    is_download: bool
    size: int
    data: bytearray = field(default_factory=bytearray)  # received, or to send
    done: int = 0  # bytes
    counter: int = 0  # of the last block
    block: bytes = b""  # the last one

    @property
    def is_complete(self) -> bool:
        return self.done == self.size


class Transfers(Part):
    """The services that move the calibration file."""

    def __init__(self, computer: Computer) -> None:
        self._computer = computer
        self._transfer: _Transfer | None = None

    def leave_session(self, session: Session) -> None:
        """Drop an unfinished transfer."""
        self._transfer = None

    def _range(self, data: bytes) -> tuple[int, int]:
        """Return the address and size in a request to begin a transfer."""
        require(len(data) >= 4, Code.INCORRECT_MESSAGE_LENGTH)
        require(data[0] == _PLAIN, Code.REQUEST_OUT_OF_RANGE)
        return address_and_size(data[1:])

    def request_download(self, server: Server, data: bytes) -> bytes:
        """Begin to receive a calibration file (0x34)."""
        address, size = self._range(data)
        fits = address == CALIBRATION_ADDRESS and 0 < size <= CALIBRATION_CAPACITY
        require(fits, Code.REQUEST_OUT_OF_RANGE)
        return self._begin(_Transfer(True, size))

    def request_upload(self, server: Server, data: bytes) -> bytes:
        """Begin to send the calibration file (0x35); the tool chooses the length."""
        address, size = self._range(data)
        file = self._computer.calibration_file()
        require(address == CALIBRATION_ADDRESS and size > 0, Code.REQUEST_OUT_OF_RANGE)
        length = min(size, len(file))
        return self._begin(_Transfer(False, length, bytearray(file[:length])))

    def _begin(self, transfer: _Transfer) -> bytes:
        require(self._transfer is None, Code.CONDITIONS_NOT_CORRECT)
        self._transfer = transfer
        return bytes([_LENGTH_FORMAT]) + BLOCK_LENGTH.to_bytes(2, "big")

    def transfer_data(self, server: Server, data: bytes) -> bytes:
        """Transfer a block (0x36); the previous one may be requested again."""
        require(len(data) >= 1, Code.INCORRECT_MESSAGE_LENGTH)
        transfer = self._transfer
        if transfer is None:
            raise RefusalError(Code.REQUEST_SEQUENCE_ERROR)
        counter, block = data[0], data[1:]
        has_right_length = 0 < len(block) <= _BLOCK if transfer.is_download else not block
        require(has_right_length, Code.INCORRECT_MESSAGE_LENGTH)
        if counter == transfer.counter and transfer.done:
            return self._again(transfer, block)
        require(not transfer.is_complete, Code.REQUEST_SEQUENCE_ERROR)
        is_next = counter == (transfer.counter + 1) & 0xFF
        require(is_next, Code.WRONG_BLOCK_SEQUENCE_COUNTER)
        if transfer.is_download:
            too_much = transfer.done + len(block) > transfer.size
            require(not too_much, Code.TRANSFER_DATA_SUSPENDED)
            transfer.data += block
            transfer.block = block
        else:
            transfer.block = bytes(transfer.data[transfer.done : transfer.done + _BLOCK])
        transfer.done += len(transfer.block)
        transfer.counter = counter
        return bytes([counter]) if transfer.is_download else bytes([counter]) + transfer.block

    @staticmethod
    def _again(transfer: _Transfer, block: bytes) -> bytes:
        """Answer a repeated block, whose response was lost."""
        if not transfer.is_download:
            return bytes([transfer.counter]) + transfer.block
        require(block == transfer.block, Code.WRONG_BLOCK_SEQUENCE_COUNTER)
        return bytes([transfer.counter])

    def exit(self, server: Server, data: bytes) -> Answer:
        """End a transfer (0x37), with the CRC-32 of all its data; the response repeats it."""
        require(len(data) in (0, _CRC_SIZE), Code.INCORRECT_MESSAGE_LENGTH)
        transfer = self._transfer
        if transfer is None or not transfer.is_complete:
            raise RefusalError(Code.REQUEST_SEQUENCE_ERROR)
        needs = _CRC_SIZE if transfer.is_download else 0
        require(len(data) >= needs, Code.INCORRECT_MESSAGE_LENGTH)
        self._transfer = None
        crc = zlib.crc32(transfer.data).to_bytes(_CRC_SIZE, "big")
        require(data in (b"", crc), Code.GENERAL_PROGRAMMING_FAILURE)
        if not transfer.is_download:
            return crc
        return self._store(self._checked(bytes(transfer.data)), crc)

    def _checked(self, file: bytes) -> Parameters:
        """Return the parameters in a file; raise `RefusalError` unless all are this computer's."""
        try:
            parameters = image.decode(file)
        except ImageError:
            raise RefusalError(Code.GENERAL_PROGRAMMING_FAILURE) from None
        known = all(self._computer.parameters.has(number) for number in parameters)
        usable = known and self._computer.parameters.can_use(parameters)
        require(usable, Code.GENERAL_PROGRAMMING_FAILURE)
        return parameters

    def _store(self, parameters: Parameters, crc: bytes) -> Later:
        memory = self._computer.parameters
        job = memory.replace(parameters)

        def poll() -> bytes | None:
            if not job.done:
                return None
            require(memory.finish(job), Code.GENERAL_PROGRAMMING_FAILURE)
            return crc

        return Later(poll)

    def handlers(self) -> dict[int, Handler]:
        """Return the services of this group."""
        return {
            0x34: self.request_download,
            0x35: self.request_upload,
            0x36: self.transfer_data,
            0x37: self.exit,
        }
