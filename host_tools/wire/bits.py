"""A classic CAN frame as bits: how long it is on the wire, to the bit.

ISO 11898-1; Bosch, *CAN Specification 2.0*, 1991, part A, 3.1.1 and 5, part B for extended frames.
From SOF to the last bit of the CRC sequence a bit of the other value follows every five equal ones
(stuffing); CRC delimiter, ACK slot, ACK delimiter and the seven bits of EOF are not stuffed.
Dominant is 0, recessive is 1. A data length code is the number of payload bytes, 0 to 8; the codes
9 to 15 that also mean eight bytes are not sent. Frames are told by the fields of `Frame`:
`can_id` with the flags of SocketCAN, `length`, and `data` with the first payload byte lowest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled
from rrins.dbc.frame import EFF_FLAG, RTR_FLAG

INTERMISSION_BITS = 3
"""Recessive bits that part a frame, or an error frame, from the next."""

ACK_DELIMITER_BITS = 1
EOF_BITS = 7

_CRC_BITS = 15
_CRC_POLYNOMIAL = 0x4599
_CRC_MASK = 0x7FFF
_TAIL_BITS = 1 + 1 + ACK_DELIMITER_BITS + EOF_BITS  # CRC delimiter, ACK slot, and those
_STANDARD_HEADER_BITS = 19  # SOF, identifier 11, RTR, IDE, r0, DLC 4
_EXTENDED_HEADER_BITS = 39  # SOF, base 11, SRR, IDE, extension 18, RTR, r1, r0, DLC 4
_DLC_BITS = 4
_EXTENSION_BITS = 18
_STUFF_AFTER = 5
_STANDARD_PAD = 0b10101  # alternating bits before SOF: they change neither a run nor the count
_EXTENDED_PAD = 0b1


def _crc_table() -> NDArray[np.int64]:
    table = np.zeros(256, dtype=np.int64)
    for value in range(256):
        crc = value << (_CRC_BITS - 8)
        for _ in range(8):
            crc = (crc << 1) ^ (_CRC_POLYNOMIAL if crc >> (_CRC_BITS - 1) else 0)
            crc &= _CRC_MASK
        table[value] = crc
    return table


def _stuffing_table() -> NDArray[np.int64]:
    """For each state and byte: the stuff bits of the byte, times 8, plus the state after it.

    A state is the last bit on the wire, times 4, plus the number of bits equal to it, less one.
    """
    table = np.zeros((8, 256), dtype=np.int64)
    for state in range(8):
        for value in range(256):
            last, run, stuffed = state >> 2, (state & 3) + 1, 0
            for place in range(7, -1, -1):
                bit = value >> place & 1
                run = run + 1 if bit == last else 1
                last = bit
                if run == _STUFF_AFTER:
                    last, run = 1 - bit, 1
                    stuffed += 1
            table[state, value] = stuffed << 3 | last << 2 | (run - 1)
    return table


_CRC_TABLE = _crc_table()
_STUFFING = _stuffing_table()


@compiled
def arbitration_key(can_id: int) -> int:
    """Return the arbitration field as one number (int64): the lower one wins the bus.

    Identifier, RTR or SRR, IDE, extension and RTR in the order of the wire: with equal base
    identifiers a standard data frame wins against a standard remote frame, and that against an
    extended one.
    """
    word = np.int64(can_id)
    remote = np.int64(1) if word & RTR_FLAG else np.int64(0)
    if not word & EFF_FLAG:
        return int((word & 0x7FF) << 21 | remote << 20)
    base = word >> _EXTENSION_BITS & 0x7FF
    return int(base << 21 | 0b11 << 19 | (word & 0x3FFFF) << 1 | remote)


@compiled
def _header(can_id: int, length: int) -> int:
    """Return the bits from SOF to the DLC as a number (int64)."""
    word = np.int64(can_id)
    remote = np.int64(1) if word & RTR_FLAG else np.int64(0)
    if not word & EFF_FLAG:
        return int((word & 0x7FF) << 7 | remote << 6 | np.int64(length))
    base = word >> _EXTENSION_BITS & 0x7FF
    return int(base << 27 | 0b11 << 25 | (word & 0x3FFFF) << 7 | remote << 6 | np.int64(length))


@compiled
def _byte(data: np.uint64, index: int) -> int:
    return int(np.int64((np.uint64(data) >> np.uint64(8 * index)) & np.uint64(0xFF)))


@compiled
def payload_bytes(can_id: int, length: int) -> int:
    """Return how many payload bytes (int64) a frame puts on the wire: none if it is remote."""
    return int(np.int64(0) if np.int64(can_id) & RTR_FLAG else np.int64(length))


@compiled
def frame_bits(can_id: int, length: int, data: np.uint64) -> int:
    """Return the bits (int64) of a frame from SOF to the end of EOF, stuff bits included.

    `INTERMISSION_BITS` come on top before the next frame. With eight bytes it is 108 to 132 bits
    for a standard and 128 to 157 for an extended identifier; the upper ends are bounds.
    """
    header = _header(can_id, length)
    if np.int64(can_id) & EFF_FLAG:
        bits = np.int64(_EXTENDED_HEADER_BITS)
        padded = _EXTENDED_PAD << _EXTENDED_HEADER_BITS | header
        shift = 32
    else:
        bits = np.int64(_STANDARD_HEADER_BITS)
        padded = _STANDARD_PAD << _STANDARD_HEADER_BITS | header
        shift = 16
    crc = np.int64(0)
    state = np.int64(0)
    while shift >= 0:
        # The CRC starts at zero, so that leading zeros stand for the padding in it.
        crc = (crc << 8 & _CRC_MASK) ^ _CRC_TABLE[crc >> 7 ^ (header >> shift & 0xFF)]
        entry = _STUFFING[state, padded >> shift & 0xFF]
        state = entry & 7
        bits += entry >> 3
        shift -= 8
    count = payload_bytes(can_id, length)
    for index in range(count):
        value = _byte(data, index)
        crc = (crc << 8 & _CRC_MASK) ^ _CRC_TABLE[crc >> 7 ^ value]
        entry = _STUFFING[state, value]
        state = entry & 7
        bits += entry >> 3
    entry = _STUFFING[state, crc >> 7]
    state = entry & 7
    bits += entry >> 3
    # The last seven bits, and one that differs from the last so that it completes no run.
    entry = _STUFFING[state, (crc & 0x7F) << 1 | (~crc & 1)]
    bits += entry >> 3
    return int(bits + 8 * count + _CRC_BITS + _TAIL_BITS)


@compiled
def wire_word(can_id: int, length: int, data: np.uint64) -> np.uint64:
    """Return the payload as one number (uint64) in the order of the wire, first byte highest."""
    word = np.uint64(0)
    for index in range(payload_bytes(can_id, length)):
        word |= np.uint64(_byte(data, index)) << np.uint64(56 - 8 * index)
    return word


@compiled
def agreed_bits(
    can_id: int, length: int, data: np.uint64, other_length: int, other_data: np.uint64
) -> int:
    """Return the bits (int64) of a frame from SOF to the first in which another one differs.

    Both frames have the same `can_id`, and they must differ in length or payload.
    """
    header = _header(can_id, length)
    width = np.int64(_STANDARD_HEADER_BITS)
    if np.int64(can_id) & EFF_FLAG:
        width = np.int64(_EXTENDED_HEADER_BITS)
    word = wire_word(can_id, length, data)
    if length != other_length:
        difference = np.uint64(np.int64(length) ^ np.int64(other_length))
        top, before = _DLC_BITS - 1, width - _DLC_BITS
    else:
        difference = word ^ wire_word(can_id, other_length, other_data)
        top, before = 63, width
    while not (difference >> np.uint64(top)) & np.uint64(1):
        top -= 1
        before += 1
    bits = np.int64(0)
    last = np.int64(-1)
    run = 0
    for place in range(before + 1):
        if run == _STUFF_AFTER:
            bits += 1
            last, run = 1 - last, 1
        if place < width:
            bit = header >> (width - 1 - place) & 1
        else:
            bit = np.int64((word >> np.uint64(63 - (place - width))) & np.uint64(1))
        run = run + 1 if bit == last else 1
        last = bit
        bits += 1
    return int(bits)
