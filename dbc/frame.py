"""The CAN frame as both sides and the wire hold it: Linux's ``struct can_frame``, 16 bytes.

The eight payload bytes are one little-endian 64-bit word, so that a signal is a shift and a mask.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FRAME = np.dtype(
    (
        np.record,
        [
            ("can_id", "<u4"),  # identifier, with the flags EFF, RTR and ERR of SocketCAN on top
            ("length", "u1"),  # payload bytes, 0-8
            ("flags", "u1"),  # padding in struct can_frame; zero on the wire
            ("reserved", "u1"),
            ("raw_dlc", "u1"),  # len8_dlc of struct can_frame
            ("data", "<u8"),
        ],
    )
)
"""dtype of one classic CAN frame; ``FRAME.itemsize`` is ``sizeof(struct can_frame)``."""

EFF_FLAG = 0x8000_0000
RTR_FLAG = 0x4000_0000
ERR_FLAG = 0x2000_0000

FrameArray = NDArray[Any]
"""A one-dimensional array of dtype `FRAME`."""


def frame_array(capacity: int) -> FrameArray:
    """Return `capacity` zeroed frames."""
    return np.zeros(capacity, dtype=FRAME)
