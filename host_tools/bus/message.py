"""A frame on the wire as a `can.Message`, and back."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final

import can

from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, FrameArray
from rrins.host_tools.bus.datagram import CLASSIC, CLASSIC_PAYLOAD, FD_FRAME_SIZE, FRAME_SIZE

_FD: Final = struct.Struct("<IBB2x64s")
_EXTENDED_MASK: Final = 0x1FFF_FFFF
_STANDARD_MASK: Final = 0x7FF
_BITRATE_SWITCH: Final = 0x01  # flags of struct canfd_frame
_ERROR_STATE: Final = 0x02
_FD_FORMAT: Final = 0x04

_PAYLOAD: Final = 8  # offset in a frame
_unpack_head = struct.Struct("<IB").unpack_from
_unpack = CLASSIC.unpack_from
_unpack_fd = _FD.unpack_from


def is_classic(message: can.Message) -> bool:
    """Return whether a message fits a classic frame."""
    return not message.is_fd and message.dlc <= CLASSIC_PAYLOAD


def identifier_of(message: can.Message) -> int:
    """Return the identifier of a message with its flags."""
    can_id = message.arbitration_id
    if message.is_extended_id:
        can_id |= EFF_FLAG
    if message.is_remote_frame:
        can_id |= RTR_FLAG
    if message.is_error_frame:
        can_id |= ERR_FLAG
    return can_id


def put_message(buffer: bytearray | memoryview, offset: int, message: can.Message) -> int:
    """Write a message as a frame and return the size of the frame.

    Raises
    ------
    ValueError
        If the message does not fit a frame.
    """
    can_id = identifier_of(message)
    data = b"" if message.is_remote_frame else message.data
    if type(data) is not bytearray:  # what python-can makes of it; it packs as it is
        data = bytes(data)
    length = message.dlc if message.is_remote_frame else len(data)
    if length > (64 if message.is_fd else 8):
        raise ValueError(f"a payload of {length} bytes does not fit a frame: {message}")
    if not message.is_fd:
        CLASSIC.pack_into(buffer, offset, can_id, length, data)
        return FRAME_SIZE
    flags = _FD_FORMAT
    if message.bitrate_switch:
        flags |= _BITRATE_SWITCH
    if message.error_state_indicator:
        flags |= _ERROR_STATE
    _FD.pack_into(buffer, offset, can_id, length, flags, data)
    return FD_FRAME_SIZE


def get_message(
    buffer: bytearray, offset: int, is_fd: bool, timestamp: float, channel: str, is_rx: bool
) -> can.Message:
    """Return the frame at `offset` as a message."""
    if not is_fd:
        can_id, length = _unpack_head(buffer, offset)
        if can_id <= _STANDARD_MASK:  # as nearly all are: no flags to look at
            start = offset + _PAYLOAD
            data = buffer[start : start + length]
            return can.Message(
                timestamp, can_id, False, False, False, channel, length, data, False, is_rx
            )
    if is_fd:
        can_id, length, flags, data = _unpack_fd(buffer, offset)
    else:
        can_id, length, data = _unpack(buffer, offset)
        flags = 0
    is_extended = bool(can_id & EFF_FLAG)
    is_remote = bool(can_id & RTR_FLAG)
    is_error = bool(can_id & ERR_FLAG)
    return can.Message(
        timestamp=timestamp,
        arbitration_id=can_id & (_EXTENDED_MASK if is_extended or is_error else _STANDARD_MASK),
        is_extended_id=is_extended,
        is_remote_frame=is_remote,
        is_error_frame=is_error,
        channel=channel,
        dlc=length,
        data=None if is_remote else data[:length],
        is_fd=is_fd,
        is_rx=is_rx,
        bitrate_switch=bool(flags & _BITRATE_SWITCH),
        error_state_indicator=bool(flags & _ERROR_STATE),
    )


def messages_of(frames: FrameArray, time_s: float, channel: str) -> Iterator[can.Message]:
    """Yield the frames of an array as messages of one time."""
    buffer = bytearray(frames.tobytes())
    for offset in range(0, len(buffer), FRAME_SIZE):
        yield get_message(buffer, offset, False, time_s, channel, True)
