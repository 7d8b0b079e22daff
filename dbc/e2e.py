"""End-to-end protection of a frame: AUTOSAR E2E profile 1, variant 1A.

AUTOSAR, *Specification of SW-C End-to-End Communication Protection Library*: CRC-8 with the
polynomial 0x1D (SAE J1850) but start value and final XOR 0x00, over the low and the high byte of
the 16-bit data ID, then over the payload without the CRC itself. The CRC lies in byte 0, the
counter in the low nibble of byte 1; the counter runs from 0 to 14. These two places are the
profile's own; the DBC names them `crc` and `alive_counter`, and a test checks that both agree.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, U2, U4, Record
from rrins.dbc.frame import Frame

COUNTER_MODULUS = 15
"""The counter runs from 0 to 14; profile 1 reserves 15 for 'invalid'."""


class MessageLayout(Record):
    """A message: identifier, protection and length of its frames."""

    can_id: U4
    data_id: U2  #: of E2E profile 1; 0: no protection
    length: U2  #: payload bytes
    cycle_ms: I8  #: 0: none


_POLYNOMIAL = 0x1D
_CRC_MASK = 0xFF
_COUNTER_SHIFT = 8
_COUNTER_MASK = 0xF


def _crc_table() -> NDArray[np.uint8]:
    table = np.zeros(256, dtype=np.uint8)
    for value in range(256):
        crc = value
        for _ in range(8):
            crc = ((crc << 1) ^ _POLYNOMIAL) & 0xFF if crc & 0x80 else crc << 1
        table[value] = crc
    return table


_TABLE = _crc_table()


@compiled
def crc8(word: np.uint64, length: int, data_id: int) -> np.uint8:
    """Return the CRC (uint8) of a payload word of `length` bytes under a data ID."""
    crc = _TABLE[np.uint8(data_id & 0xFF)]
    crc = _TABLE[crc ^ np.uint8((data_id >> 8) & 0xFF)]
    rest = np.uint64(word)
    for _ in range(1, length):
        rest >>= np.uint64(8)
        crc = _TABLE[crc ^ np.uint8(rest & np.uint64(0xFF))]
    return crc


@compiled
def protect(word: np.uint64, message: MessageLayout, counter: int) -> np.uint64:
    """Return the payload word with counter and CRC filled in.

    `counter` is taken modulo `COUNTER_MODULUS`.
    """
    count = np.uint64(counter % COUNTER_MODULUS)
    cleared = np.uint64(word) & ~np.uint64((_COUNTER_MASK << _COUNTER_SHIFT) | _CRC_MASK)
    word = cleared | (count << np.uint64(_COUNTER_SHIFT))
    return word | np.uint64(crc8(word, message.length, message.data_id))


@compiled
def crc_holds(frame: Frame, message: MessageLayout) -> bool:
    """Return whether a frame has its message's length and a correct CRC, if it has a CRC."""
    if message.data_id == 0:
        return True
    if frame.length != message.length:
        return False
    right = crc8(frame["data"], message.length, message.data_id)
    return np.uint64(right) == frame["data"] & np.uint64(_CRC_MASK)


@compiled
def counter_of(word: np.uint64) -> int:
    """Return the alive counter (int64) of a payload word."""
    return int(np.int64((word >> np.uint64(_COUNTER_SHIFT)) & np.uint64(_COUNTER_MASK)))


@compiled
def fill(frame: Frame, message: MessageLayout, word: np.uint64, counter: int) -> None:
    """Make `frame` the protected frame of a message."""
    frame.can_id = message.can_id
    frame.length = message.length
    frame.flags = 0
    frame.reserved = 0
    frame.raw_dlc = 0
    frame["data"] = protect(word, message, counter)
