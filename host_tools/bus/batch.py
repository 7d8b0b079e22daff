"""Several frames at once: their bytes and metadata."""

from __future__ import annotations

import numpy as np

from rrins.dbc.frame import Frame, FrameArray


class Batch:
    """Metadata of the frames of a `RrinsBus.recv_batch`.

    One object for each bus, written anew by every call: take what you need before the next one.

    Attributes
    ----------
    count : int
        Frames received.
    epoch : int
        Epoch of the batch; 0 for a single message.
    time_ns : int
        Time of the batch in nanoseconds.
    closes_epoch : bool
        Whether its sender has sent everything in this epoch.
    sender : int
        Node number of the sender; the host is node 0.
    """

    __slots__ = ("closes_epoch", "count", "epoch", "sender", "time_ns")

    def __init__(self) -> None:
        self.count = 0
        self.epoch = 0
        self.time_ns = 0
        self.closes_epoch = False
        self.sender = 0


def bytes_of(frames: FrameArray) -> memoryview:
    """Return the bytes of an array of frames, shared with it.

    Raises
    ------
    ValueError
        If the array does not have the layout of the wire.
    """
    if frames.dtype != Frame.dtype or frames.ndim != 1 or not frames.flags.c_contiguous:
        raise ValueError("frames must be a contiguous one-dimensional array of dtype Frame.dtype")
    return frames.view(np.uint8).data
