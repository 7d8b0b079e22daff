"""Parses the usual lines of text logs (Vector, PEAK, CSV), many at a time.

A line is parsed here only if it is exactly what its format's writers write: one classic data frame.
Any other line, damaged or only unusual, is left to python-can's readers and the checks around them.
Where a line is parsed here, the result is the same to the bit.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Bytes, Floats, Integers
from rrins.dbc.frame import EFF_FLAG, Frame, FrameArray

ASC, TRC, CSV = 0, 1, 2
"""Formats: Vector ASCII with hexadecimal numbers and absolute times, PEAK, python-can's CSV."""

NUMBER, TIME_MS, DATA_TYPE, BUS, IDENTIFIER, DIRECTION, RESERVED, LENGTH, DATA = range(9)
"""What a column of a PEAK log holds; `DATA` comes last."""

NO_CHANNEL = -1
"""Channel of a frame in a log without channels."""

SHORTEST_LINE = 8
"""Bytes of a line that is parsed, at least."""

_PAYLOAD = 8  # bytes of a full classic frame
_STANDARD, _EXTENDED = 0x7FF, 0x1FFF_FFFF
_LARGEST_CHANNEL = 999
_DIGITS = 18  # of a number that an int64 holds
_EXACT = 1 << 53  # integers below are exact as floats
_TENS = np.array([10**k for k in range(_DIGITS + 1)], dtype=np.int64)
_UNKNOWN = -1.0  # instead of a time

_NEWLINE, _RETURN, _SPACE, _TAB = 10, 13, 32, 9
_COMMA, _MINUS, _DOT, _SLASH, _PLUS, _EQUALS, _BRACKET = 44, 45, 46, 47, 43, 61, 41
_ZERO, _ONE, _EIGHT, _NINE = 48, 49, 56, 57
_UPPER_D, _UPPER_R, _UPPER_T, _LOWER_D, _LOWER_Q, _LOWER_X = 68, 82, 84, 100, 113, 120


@compiled
def _hex(byte: int) -> int:
    """Return the value of a hexadecimal digit, or -1 for any other byte."""
    if _ZERO <= byte <= _NINE:
        return byte - _ZERO
    if 65 <= byte <= 70:
        return byte - 55
    if 97 <= byte <= 102:
        return byte - 87
    return -1


@compiled
def _sextet(byte: int) -> int:
    """Return the value of a digit of base64, or -1 for any other byte."""
    if 65 <= byte <= 90:
        return byte - 65
    if 97 <= byte <= 122:
        return byte - 71
    if _ZERO <= byte <= _NINE:
        return byte + 4
    if byte == _PLUS:
        return 62
    return 63 if byte == _SLASH else -1


@compiled
def _quotient(whole: int, decimals: int) -> float:
    """Return the float nearest to ``whole / 10**decimals``, as Python reads it from digits."""
    unit = int(_TENS[decimals])
    quotient = float(whole) / float(unit)
    if whole < _EXACT or decimals == 0:  # both exact, and one division rounds once
        return quotient
    fraction, exponent = math.frexp(quotient)
    mantissa = int(fraction * float(_EXACT))
    shift = 53 - exponent
    if not 0 <= shift < 64 or mantissa <= 1 << 52 or mantissa >= _EXACT - 1:
        return _UNKNOWN
    # By how much the quotient is too small, in units of its last place divided by `unit`. That is
    # few, so the difference is right although both products overflow.
    over = (whole << shift) - mantissa * unit
    if 2 * over > unit or (2 * over == unit and mantissa & 1):
        mantissa += 1
    elif 2 * over < -unit or (2 * over == -unit and mantissa & 1):
        mantissa -= 1
    return math.ldexp(float(mantissa), -shift)


@compiled
def _skip_blanks(text: Bytes, at: int) -> int:
    """Return where the next word begins; a text ends with a newline."""
    while text[at] == _SPACE or text[at] == _TAB:
        at += 1
    return at


@compiled
def _skip_gap(text: Bytes, at: int) -> int:
    """Return where the next word begins, or -1 if there is no gap before it."""
    if at < 0 or not (text[at] == _SPACE or text[at] == _TAB):
        return -1
    return _skip_blanks(text, at)


@compiled
def _parse_time(text: Bytes, at: int, times: Floats, row: int, needs_dot: bool) -> int:
    """Parse digits with or without a fraction; return where they end, or -1."""
    whole = 0
    digits = decimals = 0
    is_behind_dot = False
    while True:
        byte = int(text[at])
        if byte == _DOT and not is_behind_dot and digits:
            is_behind_dot = True
        elif _ZERO <= byte <= _NINE:
            if digits == _DIGITS:
                return -1
            whole = 10 * whole + (byte - _ZERO)
            digits += 1
            decimals += is_behind_dot
        else:
            break
        at += 1
    if not digits or is_behind_dot != (decimals > 0) or (needs_dot and not decimals):
        return -1
    times[row] = _quotient(whole, decimals)
    return at if times[row] >= 0 else -1


@compiled
def _parse_channel(text: Bytes, at: int, channels: Integers, row: int) -> int:
    """Parse a channel's number; return where it ends, or -1."""
    if at < 0:
        return -1
    first = at
    number = 0
    while _ZERO <= text[at] <= _NINE and number <= _LARGEST_CHANNEL:
        number = 10 * number + int(text[at]) - _ZERO
        at += 1
    channels[row] = number
    return at if at > first and number <= _LARGEST_CHANNEL else -1


@compiled
def _parse_identifier(text: Bytes, at: int, frame: Frame, standard_digits: int) -> int:
    """Parse a hexadecimal identifier; return where it ends, or -1.

    It is extended if it has more than `standard_digits`.
    """
    if at < 0:
        return -1
    first = at
    identifier = 0
    while _hex(int(text[at])) >= 0 and at - first < 9:
        identifier = 16 * identifier + _hex(int(text[at]))
        at += 1
    is_extended = at - first > standard_digits
    if at == first or identifier > (_EXTENDED if is_extended else _STANDARD):
        return -1
    frame.can_id = identifier | EFF_FLAG if is_extended else identifier
    return at


@compiled
def _parse_bytes(text: Bytes, at: int, length: int, frame: Frame) -> int:
    """Parse bytes of two digits each; return where they end, or -1."""
    word = np.uint64(0)
    for k in range(length):
        at = _skip_gap(text, at)
        if at < 0:
            return -1
        high = _hex(int(text[at]))
        low = -1 if high < 0 else _hex(int(text[at + 1]))
        if low < 0:
            return -1
        word |= np.uint64(16 * high + low) << np.uint64(8 * k)
        at += 2
    frame["data"] = word
    frame.length = length
    return at


@compiled
def _skip_end(text: Bytes, at: int) -> int:
    """Return where the next line begins, or -1 if anything but blanks is left of this one."""
    if at < 0:
        return -1
    at = _skip_blanks(text, at)
    if text[at] == _RETURN:
        at += 1
    return at + 1 if text[at] == _NEWLINE else -1


@compiled
def _parse_asc(
    text: Bytes, at: int, frames: FrameArray, times: Floats, channels: Integers, row: int
) -> int:
    """Parse ``0.100000 1  43  Rx   d 8 01 02 …  Length = …``; return where the next line begins."""
    frame = frames[row]
    at = _skip_gap(text, _parse_time(text, _skip_blanks(text, at), times, row, True))
    at = _skip_gap(text, _parse_channel(text, at, channels, row))
    if at < 0:
        return -1
    digits = 0
    while digits < 9 and _hex(int(text[at + digits])) >= 0:
        digits += 1
    is_extended = text[at + digits] == _LOWER_X
    at = _parse_identifier(text, at, frame, 0 if is_extended else 9)
    at = _skip_gap(text, at + is_extended if at > 0 else -1)
    if at < 0 or not (text[at] == _UPPER_R or text[at] == _UPPER_T) or text[at + 1] != _LOWER_X:
        return -1
    is_requested = text[at] == _UPPER_T and text[at + 2] == _UPPER_R and text[at + 3] == _LOWER_Q
    at = _skip_gap(text, at + (4 if is_requested else 2))
    if at < 0 or text[at] != _LOWER_D:
        return -1
    at = _skip_gap(text, at + 1)
    if at < 0 or not _ZERO <= text[at] <= _EIGHT:
        return -1
    at = _parse_bytes(text, at + 1, int(text[at]) - _ZERO, frame)
    if at < 0 or not (text[at] == _SPACE or text[at] == _TAB):
        return _skip_end(text, at)
    while _SPACE <= text[at] < 127 or text[at] == _TAB:
        if text[at] == _UPPER_R or text[at] == _UPPER_T:  # perhaps two lines run together
            return -1
        at += 1
    return _skip_end(text, at)


@compiled
def _parse_trc(
    text: Bytes,
    at: int,
    roles: Integers,
    frames: FrameArray,
    times: Floats,
    channels: Integers,
    row: int,
) -> int:
    """Parse a line with the columns of `roles`; return where the next line begins."""
    frame = frames[row]
    channels[row] = 1
    length = -1
    at = _skip_blanks(text, at)
    for column in range(len(roles)):
        role = roles[column]
        if role == DATA:
            return -1 if length < 0 else _skip_end(text, _parse_bytes(text, at, length, frame))
        if column:
            at = _skip_gap(text, at)
        if at < 0:
            return -1
        first = at
        if role == NUMBER:
            while _ZERO <= text[at] <= _NINE:
                at += 1
            if at == first:
                return -1
            at += text[at] == _BRACKET
        elif role == TIME_MS:
            at = _parse_time(text, at, times, row, False)
        elif role == DATA_TYPE:
            at = at + 2 if text[at] == _UPPER_D and text[at + 1] == _UPPER_T else -1
        elif role == BUS:
            at = _parse_channel(text, at, channels, row)
        elif role == IDENTIFIER:
            at = _parse_identifier(text, at, frame, 4)
        elif role == DIRECTION:
            is_known = text[at] == _UPPER_R or text[at] == _UPPER_T
            at = at + 2 if is_known and text[at + 1] == _LOWER_X else -1
        elif role == RESERVED:
            at = at + 1 if text[at] == _MINUS else -1
        else:
            length = int(text[at]) - _ZERO if _ZERO <= text[at] <= _EIGHT else -1
            at = at + 1 if length >= 0 else -1
    return -1


@compiled
def _parse_flag(text: Bytes, at: int) -> int:
    """Return 0 or 1 for ``,0`` or ``,1`` before another comma, or -1."""
    if text[at] == _COMMA and text[at + 2] == _COMMA and _ZERO <= text[at + 1] <= _ONE:
        return int(text[at + 1]) - _ZERO
    return -1


@compiled
def _parse_base64(text: Bytes, at: int, length: int, frame: Frame) -> int:
    """Parse `length` bytes in base64; return where they end, or -1."""
    word = np.uint64(0)
    bits = 0
    held = 0
    count = 0
    for k in range((length + 2) // 3 * 4):
        byte = int(text[at + k])
        value = _sextet(byte)
        if value < 0:
            if byte != _EQUALS or count < length:
                return -1
            continue
        if count == length:  # more bytes than stated
            return -1
        held = (held << 6 | value) & 0xFFFF
        bits += 6
        if bits >= 8:
            bits -= 8
            word |= np.uint64(held >> bits & 0xFF) << np.uint64(8 * count)
            count += 1
    frame["data"] = word
    frame.length = length
    return at + (length + 2) // 3 * 4 if count == length else -1


@compiled
def _parse_csv(
    text: Bytes, at: int, frames: FrameArray, times: Floats, channels: Integers, row: int
) -> int:
    """Parse ``0.5,0x43,0,0,0,8,AQIDBAUGBwg=``; return where the next line begins."""
    frame = frames[row]
    channels[row] = NO_CHANNEL
    at = _parse_time(text, at, times, row, False)
    if at < 0 or text[at] != _COMMA or text[at + 1] != _ZERO or text[at + 2] != _LOWER_X:
        return -1
    first = at + 3
    at = first
    while at - first < 9 and _hex(int(text[at])) >= 0:
        at += 1
    is_extended = _parse_flag(text, at)
    end = _parse_identifier(text, first, frame, 0 if is_extended else 9)
    if end != at or is_extended < 0 or _parse_flag(text, at + 2) or _parse_flag(text, at + 4):
        return -1
    at += 7
    if not _ZERO <= text[at] <= _EIGHT or text[at + 1] != _COMMA:
        return -1
    at = _parse_base64(text, at + 2, int(text[at]) - _ZERO, frame)
    if at < 0:
        return -1
    if text[at] == _RETURN:
        at += 1
    return at + 1 if text[at] == _NEWLINE else -1


@compiled
def parse(
    form: int,
    text: Bytes,
    at: int,
    end: int,
    roles: Integers,
    frames: FrameArray,
    times: Floats,
    channels: Integers,
    row: int,
) -> tuple[int, int]:
    """Parse lines up to the first that is not as usual; return where it begins, and the next row.

    Parameters
    ----------
    form : int
        `ASC`, `TRC` or `CSV`.
    text : array of uint8
        Whole lines up to `end`, the last byte being a newline. Behind `end` there are 64 bytes and
        more, so that nothing is read beyond the text.
    at, end : int
    roles : array of int64
        What the columns of a PEAK log hold.
    frames, times, channels : array
        Receive a frame, its time (s; ms in a PEAK log) and its channel's number for each line.
    row : int
        The first row to fill.
    """
    while at < end and row < len(frames):
        if form == ASC:
            after = _parse_asc(text, at, frames, times, channels, row)
        elif form == TRC:
            after = _parse_trc(text, at, roles, frames, times, channels, row)
        else:
            after = _parse_csv(text, at, frames, times, channels, row)
        if after < 0:
            break
        at = after
        row += 1
    return at, row
