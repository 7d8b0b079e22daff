"""The words of the socketcand protocol: commands of a client, and frames for it."""

from __future__ import annotations

import re
from typing import Final

from rrins.dbc.frame import EFF_FLAG, ERR_FLAG, RTR_FLAG
from rrins.host_tools.bus import datagram

_EXTENDED_MASK: Final = 0x1FFF_FFFF
_STANDARD_MASK: Final = 0x7FF
_HEX: Final = re.compile(r"-?[0-9A-Fa-f]{1,16}")


class CommandError(Exception):
    """A command that is refused; the text is the answer."""


def number_of(word: str, bits: int) -> int:
    """Read a hexadecimal number as C's `sscanf` does: some clients write it sign-extended."""
    if not _HEX.fullmatch(word):
        raise CommandError(f"no number: {word[:20]}")
    value = int(word, 16)
    if value >> 63 == 1:
        value -= 1 << 64
    if not -(1 << (bits - 1)) <= value < 1 << bits:
        raise CommandError(f"number too large: {word[:20]}")
    return value & ((1 << bits) - 1)


def identifier_of(word: str = "", *others: str) -> int:
    """Return an identifier, with the flag of an extended one."""
    if others:
        raise CommandError(f"too many words: {others[0][:20]}")
    value = number_of(word, 32)
    if len(word) == 8:  # digits
        value |= EFF_FLAG
    limit = _EXTENDED_MASK if value & EFF_FLAG else _STANDARD_MASK
    if value & ~EFF_FLAG > limit:
        raise CommandError(f"no identifier: {word[:20]}")
    return value


def frame_of(words: list[str], sender: int) -> memoryview:
    """Return a datagram with one frame, which the host stamps with the time of the bus."""
    if len(words) < 2:
        raise CommandError("a frame has an identifier and a length")
    can_id, length = identifier_of(words[0]), number_of(words[1], 8)
    if length > datagram.CLASSIC_PAYLOAD or len(words) != 2 + length:
        raise CommandError(f"a frame of length {length} with {len(words) - 2} bytes")
    data = bytes(number_of(word, 8) for word in words[2:])
    return datagram.of_one_frame(sender, can_id, length, data)


def _line(stamp: str, can_id: int, length: int, data: bytes) -> str:
    """Return a frame in the words of the protocol; empty if it has none for it."""
    if can_id & ERR_FLAG:
        return f"< error {can_id & _EXTENDED_MASK:03X} {stamp} >"
    if can_id & RTR_FLAG:
        return ""
    payload = data[:length].hex().upper()
    if can_id & EFF_FLAG:
        return f"< frame {can_id & _EXTENDED_MASK:08X} {stamp} {payload} >"
    return f"< frame {can_id & _STANDARD_MASK:03X} {stamp} {payload} >"


def text_of(batch: bytes, time_ns: int, wanted: set[int] | None = None) -> bytes:
    """Return the frames of a batch, all or those wanted, with its time in nanoseconds."""
    seconds, microseconds = divmod(max(0, time_ns) // 1000, 1_000_000)
    stamp = f"{seconds}.{microseconds:06d}"
    frames = datagram.CLASSIC.iter_unpack(memoryview(batch)[datagram.HEADER_SIZE :])
    lines = [_line(stamp, *frame) for frame in frames if wanted is None or frame[0] in wanted]
    return "".join(lines).encode()
