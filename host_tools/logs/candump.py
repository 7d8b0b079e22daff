"""Reads candump's log format, ``(seconds) channel id#data``, many lines at a time.

This is ten times faster than parsing line by line, and a damaged line loses only itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Bytes, Floats, Integers
from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG, Frame, FrameArray, frame_array

_BLOCK = 1 << 21  # bytes
_SHORTEST_LINE = 12  # "(0) a 000#\n" and one
_PAYLOAD = 8  # bytes of a full classic frame
_EXACT_DIGITS = 15  # of the integers that a float represents exactly
_EXACT = 1 << 53
_CHANNELS = 64  # distinguished; the last one stands for all others
_CHANNEL_BYTES = 64  # of a channel name
_BOM = b"\xef\xbb\xbf"
_NEWLINE, _SPACE, _TAB, _RETURN = 10, 32, 9, 13
_OPEN, _CLOSE, _DOT, _HASH, _REMOTE, _RAW_LENGTH = 40, 41, 46, 35, 82, 95

_FRAME, _BLANK, _BAD, _FD = 0, 1, 2, 3

Block = tuple[FrameArray, Floats, Bytes]
"""Frames, their times and their channel numbers."""


@compiled
def _hex(byte: int) -> int:
    """Return the value of a hexadecimal digit, or -1 for any other byte."""
    if 48 <= byte <= 57:
        return byte - 48
    if 65 <= byte <= 70:
        return byte - 55
    if 97 <= byte <= 102:
        return byte - 87
    return -1


@compiled
def _skip_blanks(text: Bytes, at: int, end: int) -> int:
    while at < end and (text[at] == _SPACE or text[at] == _TAB):
        at += 1
    return at


@compiled
def _parse_time(text: Bytes, at: int, end: int, times: Floats, row: int) -> int:
    """Parse ``(1436509052.249713)``; return where it ends, or -1 for any other text."""
    if at >= end or text[at] != _OPEN:
        return -1
    at += 1
    whole = fraction = 0
    unit = 1
    digits = decimals = 0
    is_behind_dot = False
    while at < end and text[at] != _CLOSE:
        byte = int(text[at])
        if byte == _DOT and not is_behind_dot:
            is_behind_dot = True
        elif not 48 <= byte <= 57:
            return -1
        elif not is_behind_dot:
            if digits == _EXACT_DIGITS:
                return -1
            whole = 10 * whole + (byte - 48)
            digits += 1
        elif decimals < _EXACT_DIGITS:
            fraction = 10 * fraction + (byte - 48)
            unit *= 10
            decimals += 1
        at += 1
    if at >= end or not digits + decimals:
        return -1
    if digits + decimals <= _EXACT_DIGITS + 1 and whole * unit < _EXACT:
        times[row] = (whole * unit + fraction) / float(unit)
    else:
        times[row] = whole + fraction / float(unit)
    return at + 1


@compiled
def _number_of_channel(text: Bytes, at: int, end: int, known: Bytes) -> int:
    """Return the index of the name ``text[at:end]`` in `known`, adding the name if it is new."""
    size = min(end - at, _CHANNEL_BYTES)
    for number in range(_CHANNELS - 1):
        if known[number, 0] == 0:
            for k in range(size):
                known[number, k] = text[at + k]
            return number
        is_same = size == _CHANNEL_BYTES or known[number, size] == 0
        k = 0
        while is_same and k < size:
            is_same = known[number, k] == text[at + k]
            k += 1
        if is_same:
            return number
    return _CHANNELS - 1


@compiled
def _parse_payload(text: Bytes, at: int, end: int, frame: Frame) -> bool:
    """Parse the bytes after ``#`` into a frame; return whether they are valid."""
    word = np.uint64(0)
    length = 0
    while at < end and text[at] != _SPACE and text[at] != _TAB:
        if text[at] == _DOT:
            at += 1
            continue
        if text[at] == _RAW_LENGTH and length == 8:  # followed by the raw length code, 9 to F
            if at + 1 >= end or _hex(int(text[at + 1])) < 9:
                return False
            break
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
    while at < end:
        if text[at] == _HASH:  # two lines run together
            return False
        at += 1
    return True


@compiled
def _parse_remote(text: Bytes, at: int, end: int, frame: Frame) -> bool:
    """Parse ``R``, or ``R`` and a length, after ``#``."""
    frame["can_id"] |= np.uint32(RTR_FLAG)
    frame["data"] = np.uint64(0)
    frame.length = 0
    at += 1
    if at < end and 48 <= text[at] <= 56:
        frame.length = int(text[at]) - 48
    return True


@compiled
def _parse_line(
    text: Bytes, at: int, end: int, frames: FrameArray, times: Floats, place: Integers, row: int
) -> int:
    """Parse the line ``text[at:end]`` into a row; return what kind of line it was.

    `place` receives the bounds of its channel name.
    """
    if end > at and text[end - 1] == _RETURN:
        end -= 1
    at = _skip_blanks(text, at, end)
    if at == end:
        return _BLANK
    at = _parse_time(text, at, end, times, row)
    if at < 0:
        return _BAD
    at = _skip_blanks(text, at, end)
    place[0] = at
    while at < end and text[at] != _SPACE and text[at] != _TAB:
        at += 1
    place[1] = at
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
    frame.can_id = identifier
    at += 1
    if at < end and text[at] == _HASH:
        return _FD
    if at < end and (text[at] == _REMOTE or text[at] == _REMOTE + 32):
        return _FRAME if _parse_remote(text, at, end, frame) else _BAD
    return _FRAME if _parse_payload(text, at, end, frame) else _BAD


@compiled
def _parse_lines(
    text: Bytes,
    frames: FrameArray,
    times: Floats,
    channels: Bytes,
    known: Bytes,
    counts: Integers,
    place: Integers,
) -> int:
    """Parse all complete lines of a text; return the number of bytes consumed.

    `channels` receives the index of each channel name in `known`; `counts` receives the numbers of
    frames, bad lines and FD frames. `place` is scratch, shape (2,).
    """
    at = 0
    row = 0
    size = len(text)
    while True:
        end = at
        while end < size and text[end] != _NEWLINE:
            end += 1
        if end == size:
            break
        found = _parse_line(text, at, end, frames, times, place, row)
        if found == _FRAME:
            channels[row] = _number_of_channel(text, place[0], place[1], known)
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

    Parameters
    ----------
    stream : binary file
    block : int
        Bytes to read at once.

    Attributes
    ----------
    bad_lines : int
        Lines that are not frames.
    fd_frames : int
        CAN FD frames, which are skipped.
    """

    def __init__(self, stream: IO[bytes], block: int = _BLOCK) -> None:
        self._stream = stream
        self._block = min(block, _BLOCK)
        self._known = np.zeros((_CHANNELS, _CHANNEL_BYTES), dtype=np.uint8)
        self.bad_lines = 0
        self.fd_frames = 0

    def channel(self, number: int) -> str:
        """Return the name of a channel."""
        return bytes(self._known[number]).rstrip(b"\0").decode(errors="replace")

    def __iter__(self) -> Iterator[Block]:
        """Yield the frames, their times and their channel numbers in log order."""
        rest = self._stream.read(len(_BOM)).removeprefix(_BOM)
        while block := self._stream.read(self._block):
            text = rest + block
            read, found = self._parse(text)
            rest = text[read:]
            if len(rest) > _BLOCK:  # no line is this long
                rest = b""
                self.bad_lines += 1
            yield found
        if rest:
            _, found = self._parse(rest + b"\n")
            lengths = found[0]["length"]
            if len(lengths) and lengths[-1] < _PAYLOAD:  # without a line end it may be cut off
                found = found[0][:-1], found[1][:-1], found[2][:-1]
                self.bad_lines += 1
            yield found

    def _parse(self, text: bytes) -> tuple[int, Block]:
        capacity = len(text) // _SHORTEST_LINE + 2
        frames = frame_array(capacity)
        times_s = np.zeros(capacity)
        channels = np.zeros(capacity, dtype=np.uint8)
        counts = np.zeros(3, dtype=np.int64)
        bytes_ = np.frombuffer(text, dtype=np.uint8)
        place = np.zeros(2, dtype=np.int64)
        read = int(_parse_lines(bytes_, frames, times_s, channels, self._known, counts, place))
        self.bad_lines += int(counts[1])
        self.fd_frames += int(counts[2])
        return read, (frames[: counts[0]], times_s[: counts[0]], channels[: counts[0]])
