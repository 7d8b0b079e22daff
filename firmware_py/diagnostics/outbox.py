"""Room in an epoch's frames for those of diagnostics and measurement."""

from __future__ import annotations

from collections.abc import Sequence

from rrins.dbc.frame import FrameArray


def put_before_last(words: Sequence[int], blank: FrameArray, outbox: FrameArray, sent: int) -> int:
    """Insert frames before the last one, which closes the epoch.

    Parameters
    ----------
    words : sequence of int
        Payloads.
    blank : FrameArray
        As many frames with identifier and length, at least.
    outbox : FrameArray
        The first `sent` are the epoch's frames.

    Returns
    -------
    int
        Frames in `outbox` now.
    """
    count = len(words)
    if not count:
        return sent
    outbox[sent - 1 + count] = outbox[sent - 1]
    blank["data"][:count] = words
    outbox[sent - 1 : sent - 1 + count] = blank[:count]
    return sent + count
