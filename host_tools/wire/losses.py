"""Faults that only lose frames, in compiled code: it loses those that `WireFaults.apply` would."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from rrins.compiled.compilation import compiled_with
from rrins.compiled.record import F8, I8, Bool, Floats, Record, Records
from rrins.dbc.frame import FrameArray

CAPACITY = 8
"""Most faults of a call."""

DRAWS = 8192
"""Random numbers that a fault has drawn ahead."""


class Loss(Record):
    """A fault that loses a share of the frames that one side sends."""

    node: I8  #: `Node`: who sends them
    identifier: I8  #: which frames; `ANY_IDENTIFIER` for all
    is_cut: Bool  #: whether it is all frames of both sides
    probability: F8  #: share of the frames that are lost
    draws: Annotated[Floats, DRAWS]  #: random numbers from 0 to 1, in the order of their use
    used: I8  #: how many of them are used up
    lost: I8  #: frames


class Draws:
    """Random numbers from 0 to 1 that may be drawn before it is known how many will be used.

    Parameters
    ----------
    random : Generator
        Draws them; once `look` was called, only for these.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self._ahead: Floats = np.empty(0)
        self._used = 0

    def draw(self) -> float:
        """Return the next one, and use it up."""
        if self._used == len(self._ahead):
            return self.random.random()
        self._used += 1
        return float(self._ahead[self._used - 1])

    def look(self, into: Floats) -> None:
        """Write the next ones to an array."""
        left = self._ahead[self._used :]
        fresh = self.random.random(max(0, len(into) - len(left)))
        self._ahead, self._used = np.concatenate((left, fresh)), 0
        into[:] = self._ahead[: len(into)]

    def use(self, count: int) -> None:
        """Use up the next ones, which `look` wrote."""
        self._used += count


@compiled_with(nogil=True)
def lose(
    losses: Records[Loss],
    sender: int,
    any_node: int,
    any_identifier: int,
    frames: FrameArray,
    count: int,
    out: FrameArray,
) -> int:
    """Write what is left of a side's frames of an epoch to `out`; return their number.

    Parameters
    ----------
    losses : Records[Loss]
        Those that act in the epoch, in the order in which they were injected.
    sender : int
        `Node` of the side.
    any_node, any_identifier : int
        What stands for both sides, and for all frames.
    frames : FrameArray
        The first `count` are the side's.
    count : int
    out : FrameArray
        As long as `frames`; may be the same array.
    """
    left = 0
    for k in range(count):
        can_id = frames[k].can_id
        passes = True
        for loss in losses:
            is_sent = loss.node == any_node or loss.node == sender
            is_meant = loss.identifier == any_identifier or loss.identifier == can_id
            if passes and (loss.is_cut or (is_sent and is_meant)):
                draw = loss.draws[loss.used]
                loss.used += 1
                if draw < loss.probability:
                    loss.lost += 1
                    passes = False
        if passes:
            out[left] = frames[k]
            left += 1
    return left


@compiled_with(nogil=True)
def may_lose(losses: Records[Loss], count: int) -> bool:
    """Return whether the draws suffice for a number of frames."""
    used = 0
    for loss in losses:
        used = max(used, loss.used)
    return bool(used + count <= DRAWS)
