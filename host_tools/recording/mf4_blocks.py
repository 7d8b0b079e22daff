"""Checks how the blocks of an MF4 file follow each other, before asammdf follows them.

asammdf follows links wherever they lead: round in a circle without end, if a bit of one is wrong.

References
----------
*ASAM MDF 4.1.0*, section 5.7: each block has an identifier, a length and a list of links.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, Final

from rrins.host_tools.recording.errors import RecordError

_HEADER = struct.Struct("<4s4xQQ")  # identifier, length, number of links
_FIRST = 64  # where the first block begins, behind the identification
_LINK = 8  # bytes
_MOST_LINKS = 8  # the last of interest
_MOST_CHANNELS = 10_000

_FOLLOWED: Final = {
    b"##HD": (0, 1, 2, 3, 4),  # data groups, history, hierarchy, attachments, events
    b"##DG": (0, 1, 2),  # next, channel groups, data
    b"##CG": (0, 1, 4),  # next, channels, sample reductions
    b"##CN": (0, 1, 5),  # next, composition, data
    b"##SR": (0, 1),
    b"##CH": (0, 1),
    b"##FH": (0,),
    b"##AT": (0,),
    b"##EV": (0,),
    b"##HL": (0,),
    b"##DL": (0,),
}
"""Links by which each block of a sound file is reached once."""


def check_blocks(path: Path) -> None:
    """Raise `RecordError` if a file's blocks have no end, or it has too many channels."""
    with path.open("rb") as file:
        seen: set[int] = set()
        channels = 0
        waiting = [_FIRST]
        while waiting:
            at = waiting.pop()
            if at in seen:
                raise RecordError(f"{path}: cannot be read as MF4 (blocks in a circle)")
            seen.add(at)
            identifier, links = _block(file, at)
            channels += identifier == b"##CN"
            if channels > _MOST_CHANNELS:
                raise RecordError(f"{path}: has more than {_MOST_CHANNELS} channels")
            followed = (links[k] for k in _FOLLOWED.get(identifier, ()) if k < len(links))
            waiting += [link for link in followed if link]


def _block(file: BinaryIO, at: int) -> tuple[bytes, tuple[int, ...]]:
    """Return a block's identifier and its first links; nothing if it is not a block."""
    try:
        file.seek(at)
        identifier, _, count = _HEADER.unpack(file.read(_HEADER.size))
        count = min(count, _MOST_LINKS)
        return identifier, struct.unpack(f"<{count}Q", file.read(_LINK * count))
    except (struct.error, OSError, OverflowError, ValueError):  # asammdf says what is wrong
        return b"", ()
