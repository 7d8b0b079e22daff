"""Diagnosis in a log: the messages of a tool and of the computer, in words."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from rrins.dbc.codec import load
from rrins.dbc.frame import FrameArray
from rrins.host_tools.diag.trace import Message, Trace


@functools.cache
def is_diagnostic(message: str) -> bool:
    """Return whether the frames of a message of the DBC carry diagnosis."""
    return load().frame_id(message) in Trace().identifiers


class Diagnosis:
    """Follows the diagnosis in the frames of a log, piece by piece."""

    def __init__(self) -> None:
        self._trace = Trace()

    def messages(self, frames: FrameArray) -> Iterator[tuple[int, Message]]:
        """Yield the place of the frame that completes a message, and the message."""
        found = np.isin(frames["can_id"], self._trace.identifiers)
        for k in np.flatnonzero(found).tolist():
            frame = frames[k]
            data = int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]
            for message in self._trace.add(int(frame["can_id"]), data):
                yield k, message

    def texts(self, frames: FrameArray) -> dict[int, str]:
        """Return what is said, by the place of the frame."""
        told: dict[int, str] = {}
        for k, message in self.messages(frames):
            told[k] = f"{told[k]}; {message.text}" if k in told else message.text
        return told
