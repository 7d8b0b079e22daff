"""Groups of frames of one epoch, such as a GNSS fix, that count together or not at all."""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.e2e import COUNTER_MODULUS, MessageLayout, counter_of, crc_holds
from rrins.dbc.frame import Frame
from rrins.firmware_py.core.records.memory import Gnss
from rrins.firmware_py.core.records.transfer_records import Master

INTACT, WRONG_CRC, WRONG_COUNTER = 0, 1, 2
"""Results of `receive`."""


@compiled
def begin(group: Gnss | Master) -> None:
    """Open the next epoch with no frame received."""
    group.arrived = 0
    group.refused = False


@compiled
def receive(
    group: Gnss | Master, frame: Frame, message: MessageLayout, part: int, epoch: int
) -> int:
    """Keep a frame if it is intact and of this epoch; return what was found.

    Of two frames of one part, the first is kept; the group is refused if they differ.
    """
    if not crc_holds(frame, message):
        return WRONG_CRC
    word = frame["data"]
    if counter_of(word) != epoch % COUNTER_MODULUS:
        return WRONG_COUNTER
    if group.arrived >> part & 1:
        group.refused |= group.word[part] != word
        return WRONG_COUNTER
    keep(group, part, word)
    return INTACT


@compiled
def keep(group: Gnss | Master, part: int, word: np.uint64) -> None:
    """Store the payload of a frame until the epoch is closed."""
    group.arrived |= 1 << part
    group.word[part] = word
