"""The CAN frame in the memory of both sides and the wire: ``struct can_frame``, 16 bytes.

The eight payload bytes are one little-endian 64-bit word, so that a signal is a shift and a mask.
"""

from __future__ import annotations

from rrins.compiled.record import U1, U4, U8, Record, Records


class Frame(Record):
    """One classic CAN frame; ``Frame.dtype.itemsize`` is ``sizeof(struct can_frame)``.

    Outside compiled code the payload is ``frame["data"]``, since every numpy record already has an
    attribute `data`.
    """

    can_id: U4  #: identifier, with the flags EFF, RTR and ERR of SocketCAN on top
    length: U1  #: payload bytes, 0-8
    flags: U1  #: padding in struct can_frame; zero on the wire
    reserved: U1
    raw_dlc: U1  #: len8_dlc of struct can_frame
    data: U8


EFF_FLAG = 0x8000_0000
RTR_FLAG = 0x4000_0000
ERR_FLAG = 0x2000_0000

FrameArray = Records[Frame]
"""A one-dimensional array of frames."""


def frame_array(capacity: int) -> FrameArray:
    """Return `capacity` zeroed frames."""
    return Frame.zeros(capacity)
