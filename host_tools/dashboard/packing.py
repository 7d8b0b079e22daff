"""Binary messages to a browser: a row of quantities, or many. All numbers are little-endian.

======================  ==========================================================================
bytes                   what
======================  ==========================================================================
0                       kind: 1 for a row, 2 for a history
2 to 3                  number of columns
4 to 7                  of a row its sequence number, of a history its number of rows
8 on                    times in s, 8 bytes each: one, or one for each row
after them              values, 4 bytes each: a row; a history column by column
======================  ==========================================================================
"""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from rrins.compiled.record import Floats

ROW: Final = 1
HISTORY: Final = 2
_HEAD = struct.Struct("<BxHI")


def packed_row(sequence: int, time_s: float, row: Floats) -> bytes:
    """Return the message of a row."""
    head = _HEAD.pack(ROW, len(row), sequence & 0xFFFFFFFF)
    return head + struct.pack("<d", time_s) + row.astype("<f4").tobytes()


def packed_history(times: Floats, rows: Floats) -> bytes:
    """Return the message of a history: times of shape (n,), rows of shape (n, columns)."""
    head = _HEAD.pack(HISTORY, rows.shape[1], len(times))
    columns = np.ascontiguousarray(rows.T, dtype="<f4")
    return head + times.astype("<f8").tobytes() + columns.tobytes()
