"""Reads candump's log format, ``(seconds) channel id#data``, many lines at a time.

Ten times faster than line by line, and a line that is damaged costs that line only.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO, Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, FrameArray, frame_array

_BLOCK = 1 << 21  # bytes
_SHORTEST_LINE = 12  # "(0) a 000#\n" and one
_PAYLOAD = 8  # bytes of a whole classic frame
_NEWLINE, _SPACE, _TAB, _RETURN = 10, 32, 9, 13
_OPEN, _CLOSE, _DOT, _HASH, _REMOTE = 40, 41, 46, 35, 82

_FRAME, _BLANK, _BAD, _FD = 0, 1, 2, 3


@njit(cache=True)
def _hex(byte: int) -> int:
    """Return the value of a hexadecimal digit, -1 of anything else."""
    if 48 <= byte <= 57:
        return byte - 48
    if 65 <= byte <= 70:
        return byte - 55
    if 97 <= byte <= 102:
        return byte - 87
    return -1


@njit(cache=True)
def _skip_blanks(text: Any, at: int, end: int) -> int:
    while at < end and (text[at] == _SPACE or text[at] == _TAB):
        at += 1
    return at


@njit(cache=True)
def _take_time(text: Any, at: int, end: int, times: Any, row: int) -> int:
    """Read ``(1436509052.249713)``; return where it ends, -1 for anything else."""
    if at >= end or text[at] != _OPEN:
        return -1
    at += 1
    number = 0
    digits = 0
    after_dot = -1
    while at < end and text[at] != _CLOSE:
        byte = int(text[at])
        if byte == _DOT and after_dot < 0:
            after_dot = 0
        elif 48 <= byte <= 57 and digits < 18:
            number = 10 * number + (byte - 48)
            digits += 1
            if after_dot >= 0:
                after_dot += 1
        else:
            return -1
        at += 1
    if at >= end or not digits:
        return -1
    times[row] = number / 10.0 ** max(after_dot, 0)
    return at + 1


@njit(cache=True)
def _take_payload(text: Any, at: int, end: int, frame: Any) -> bool:
    """Read the bytes behind ``#`` into a frame; return whether they are sound."""
    word = np.uint64(0)
    length = 0
    while at < end and text[at] != _SPACE and text[at] != _TAB:
        if text[at] == _DOT:
            at += 1
            continue
        if at + 1 >= end or length == 8:
            return False
        high, low = _hex(int(text[at])), _hex(int(text[at + 1]))
        if high < 0 or low < 0:
            return False
        word |= np.uint64(16 * high + low) << np.uint64(8 * length)
        length += 1
        at += 2
    frame["data"] = word
    frame.length = length
    return True


@njit(cache=True)
def _take_remote(text: Any, at: int, end: int, frame: Any) -> bool:
    """Read ``R``, or ``R`` and a length, behind ``#``."""
    frame.can_id |= np.uint32(RTR_FLAG)
    frame["data"] = np.uint64(0)
    frame.length = 0
    at += 1
    if at < end and 48 <= text[at] <= 56:
        frame.length = int(text[at]) - 48
    return True


@njit(cache=True)
def _take_line(text: Any, at: int, end: int, frames: Any, times: Any, row: int) -> int:
    """Read the line ``text[at:end]`` into a row; return what it was."""
    if end > at and text[end - 1] == _RETURN:
        end -= 1
    at = _skip_blanks(text, at, end)
    if at == end:
        return _BLANK
    at = _take_time(text, at, end, times, row)
    if at < 0:
        return _BAD
    at = _skip_blanks(text, at, end)
    while at < end and text[at] != _SPACE and text[at] != _TAB:  # the channel
        at += 1
    at = _skip_blanks(text, at, end)
    identifier = 0
    digits = 0
    while at < end and text[at] != _HASH:
        value = _hex(int(text[at]))
        if value < 0 or digits == 8:
            return _BAD
        identifier = 16 * identifier + value
        digits += 1
        at += 1
    if at >= end or not digits:
        return _BAD
    frame = frames[row]
    error = identifier & ERR_FLAG
    identifier &= 0x1FFF_FFFF
    if digits > 3:
        identifier |= error if error else EFF_FLAG
    frame.can_id = np.uint32(identifier)
    at += 1
    if at < end and text[at] == _HASH:
        return _FD
    if at < end and (text[at] == _REMOTE or text[at] == _REMOTE + 32):
        return _FRAME if _take_remote(text, at, end, frame) else _BAD
    return _FRAME if _take_payload(text, at, end, frame) else _BAD


@njit(cache=True)
def _take_lines(text: Any, size: int, frames: Any, times: Any, counts: Any) -> int:
    """Read all whole lines of ``text[:size]``; return the bytes that were read.

    `counts` gets the frames, the bad lines and the FD frames.
    """
    at = 0
    row = 0
    while True:
        end = at
        while end < size and text[end] != _NEWLINE:
            end += 1
        if end == size:
            break
        found = _take_line(text, at, end, frames, times, row)
        if found == _FRAME:
            row += 1
        elif found == _BAD:
            counts[1] += 1
        elif found == _FD:
            counts[2] += 1
        at = end + 1
    counts[0] = row
    return at


class Candump:
    """Reads a candump log.

    Attributes
    ----------
    bad_lines : int
        Lines that are no frames.
    fd_frames : int
        CAN FD frames, which are passed over.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self.bad_lines = 0
        self.fd_frames = 0

    def __iter__(self) -> Iterator[tuple[FrameArray, NDArray[np.float64]]]:
        """Yield the frames and their times, in the order of the log."""
        rest = b""
        while block := self._stream.read(_BLOCK):
            text = rest + block
            read, frames, times_s = self._parse(text)
            rest = text[read:]
            if len(rest) > _BLOCK:  # no line is as long
                rest = b""
                self.bad_lines += 1
            yield frames, times_s
        if rest:
            _, frames, times_s = self._parse(rest + b"\n")
            if len(frames) and frames["length"][-1] < _PAYLOAD:  # without its end, it may be cut
                frames, times_s = frames[:-1], times_s[:-1]
                self.bad_lines += 1
            yield frames, times_s

    def _parse(self, text: bytes) -> tuple[int, FrameArray, NDArray[np.float64]]:
        capacity = len(text) // _SHORTEST_LINE + 2
        frames = frame_array(capacity)
        times_s = np.zeros(capacity)
        counts = np.zeros(3, dtype=np.int64)
        bytes_ = np.frombuffer(text, dtype=np.uint8)
        read = int(_take_lines(bytes_, len(bytes_), frames, times_s, counts))
        self.bad_lines += int(counts[1])
        self.fd_frames += int(counts[2])
        return read, frames[: counts[0]], times_s[: counts[0]]
