"""Writes BLF logs: frames one by one, or thousands at once."""

from __future__ import annotations

import can
import numpy as np
from can.util import channel2int

from rrins.compiled.record import Floats
from rrins.dbc.frame import FrameArray
from rrins.host_tools.recording.blf import BEGIN, CLASSIC, MASKS
from rrins.host_tools.recording.mf4 import is_simulated

_CHANNELS = 0xFFFF
_MESSAGE, _NANOSECONDS = 1, 2  # kind of an object, unit of its time
_LARGEST_IDENTIFIER = 0x7FF


class BlfWriter(can.BLFWriter):
    """A writer that counts simulated time from zero and accepts any channel name."""

    def on_message_received(self, msg: can.Message) -> None:
        """Write a frame."""
        if not 0 <= (channel2int(msg.channel) or 0) < _CHANNELS:
            msg.channel = None
        self._begin(msg.timestamp)
        super().on_message_received(msg)

    def _begin(self, time_s: float) -> None:
        if self.start_timestamp is None:
            self.start_timestamp = 0.0 if is_simulated(time_s) else int(time_s * 1000) / 1000

    def takes(self, frames: FrameArray) -> bool:
        """Return whether `on_frames` can write these: data frames with standard identifiers."""
        return bool((frames["can_id"] <= _LARGEST_IDENTIFIER).all())

    def on_frames(self, frames: FrameArray, time_s: Floats, channel: str) -> None:
        """Write frames that `takes` accepts; byte for byte as `on_message_received` would."""
        number = channel2int(channel)
        is_numbered = number is not None and 0 <= number < _CHANNELS
        self._begin(float(time_s[0]))
        assert self.start_timestamp is not None
        rows = np.zeros(len(frames), CLASSIC[48])
        rows["begin"], rows["size"] = BEGIN, rows.itemsize
        rows["kind"], rows["unit"] = _MESSAGE, _NANOSECONDS
        rows["time"] = np.maximum((time_s - self.start_timestamp) * 1e9, 0.0).astype(np.uint64)
        rows["channel"] = number + 1 if is_numbered and number is not None else self.channel
        rows["dlc"], rows["id"] = frames["length"], frames["can_id"]
        rows["data"] = frames["data"] & MASKS[frames["length"]]
        self.stop_timestamp = float(time_s[-1])
        self.object_count += len(rows)
        self._buffer.append(rows.tobytes())
        self._buffer_size += rows.nbytes
        while self._buffer_size >= self.max_container_size:
            self._flush()
