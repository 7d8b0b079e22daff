"""Effects of faults on frames, in compiled code: what passes, and in which state."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import F8, I8, Integers, Record, Records
from rrins.dbc.e2e import MessageLayout, counter_of, protect
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.wire.draws import Draws, bit, uniform
from rrins.host_tools.wire.fault_kinds import FaultKind


class Node(IntEnum):
    """Sender of the affected frames; the DBC's value table of `node`."""

    ANY = 0
    FIRMWARE = 1
    HARDWARE = 2


ANY_IDENTIFIER = 4095
"""Stands for all frames of a node."""

BABBLE_IDENTIFIER = 0x001
"""Identifier of a babbling node: more urgent than any in the contract."""

CAPACITY = 127
"""Most faults at a time; a scenario has at most 100."""

FRAMES = 4096
"""Most frames of a side in an epoch, whatever the faults add."""

HELD = 128
"""Most identifiers of which a fault repeats a frame; the contract has fewer."""

_MOST_BABBLE = 0 if FaultKind.BABBLE.parameter is None else int(FaultKind.BABBLE.parameter.maximum)
MOST_LATE = FRAMES + CAPACITY * _MOST_BABBLE
"""Most frames of a side that are delayed in an epoch: all, and all that babbles between."""

_ANY_NODE = int(Node.ANY)
_DROP, _SILENCE, _BUS_OFF = int(FaultKind.DROP), int(FaultKind.SILENCE), int(FaultKind.BUS_OFF)
_LOSING = _DROP, _SILENCE, _BUS_OFF, int(FaultKind.CUT), int(FaultKind.POWER_OFF)
_DELAY, _DUPLICATE, _STALE = int(FaultKind.DELAY), int(FaultKind.DUPLICATE), int(FaultKind.STALE)
_CORRUPT, _WRONG_COUNTER = int(FaultKind.CORRUPT), int(FaultKind.WRONG_COUNTER)
_BABBLE, _REORDER = int(FaultKind.BABBLE), int(FaultKind.REORDER)


class Effect(Record):
    """A fault as the frames feel it."""

    kind: I8  #: `FaultKind`
    node: I8  #: `Node` whose frames it hits; -1 for none
    identifier: I8  #: which of them; `ANY_IDENTIFIER` for all
    first_epoch: I8
    last_epoch: I8  #: included; -1 until it is removed
    probability: F8  #: share of the frames that it hits
    parameter: I8
    draws: Draws
    held_count: I8
    held: Annotated[Records[Frame], HELD]  #: by STALE, the first of each identifier


class LateFrame(Record):
    """A frame that is delayed."""

    due: I8  #: epoch
    frame: Annotated[Records[Frame], 1]


class Passage(Record):
    """Frames on their way, late ones, and the faults' account of it all."""

    count: I8  #: faults
    affected: I8  #: frames, so far
    first_late: Annotated[
        Integers, len(Node)
    ]  #: of the late frames of each `Node`, ordered by `due`
    end_late: Annotated[Integers, len(Node)]  #: after their last
    before: Annotated[Records[Frame], FRAMES]


@compiled
def acts(effect: Effect, epoch: int) -> bool:
    """Return whether a fault acts in an epoch."""
    return bool(effect.first_epoch <= epoch and not 0 <= effect.last_epoch < epoch)


@compiled
def has_room(passage: Passage, late: Records[LateFrame], sender: int) -> bool:
    """Return whether all frames of a side may be delayed in an epoch; without `late` none is."""
    return bool(len(late) == 0 or len(late) - passage.end_late[sender] >= MOST_LATE)


@compiled_with(nogil=True)
def affect(
    effects: Records[Effect],
    passages: Records[Passage],
    late: Records[LateFrame],
    layouts: Records[MessageLayout],
    sender: int,
    frames: FrameArray,
    count: int,
    epoch: int,
    out: FrameArray,
) -> int:
    """Write a side's frames of an epoch, after the faults, to `out`; return their number.

    Parameters
    ----------
    effects : Records[Effect]
        The first `count` of the passage are the faults, in the order in which they were injected.
    passages : Records[Passage]
        One.
    late : Records[LateFrame]
        Frames of the side that are delayed; there must be room (`has_room`).
    layouts : Records[MessageLayout]
        Of all messages.
    sender : int
        `Node` of the side.
    frames : FrameArray
        The first `count` are the side's.
    out : FrameArray
        At most `FRAMES`; none of `frames`.
    """
    passage = passages[0]
    count = min(count, len(out))
    for k in range(count):
        out[k] = frames[k]
        out[k].reserved = 0
    for k in range(passage.count):
        effect = effects[k]
        if acts(effect, epoch) and (effect.node == _ANY_NODE or effect.node == sender):
            if effect.kind == _BABBLE:
                count = _babble(max(1, effect.parameter), count, out)
            elif effect.kind == _REORDER:
                _reorder(effect, passage, count, out)
            else:
                count = _hit(effect, passage, late, layouts, sender, count, epoch, out)
    for k in range(count):
        out[k].reserved = 0
    return _deliver(passage, late, sender, epoch, count, out)


@compiled
def _keep(passage: Passage, count: int, out: FrameArray) -> FrameArray:
    """Return a copy of the first frames."""
    before = passage.before
    for k in range(count):
        before[k] = out[k]
    return before


@compiled
def _hit(
    effect: Effect,
    passage: Passage,
    late: Records[LateFrame],
    layouts: Records[MessageLayout],
    sender: int,
    count: int,
    epoch: int,
    out: FrameArray,
) -> int:
    """Let a fault act on each of the frames that it is drawn for; return how many there are now."""
    before = _keep(passage, count, out)
    left = 0
    for k in range(count):
        frame = before[k]  # `reserved` marks a copy
        is_meant = effect.identifier == ANY_IDENTIFIER or effect.identifier == frame.can_id
        if effect.kind == _DUPLICATE and frame.reserved != 0:
            is_meant = False  # or a dozen such faults would make thousands of one frame
        copies = 1
        if is_meant and uniform(effect.draws) < effect.probability:
            passage.affected += 1
            if effect.kind in _LOSING:
                copies = 0
            elif effect.kind == _DELAY:
                copies = 0
                _delay(passage, late, sender, epoch + max(1, effect.parameter), frame)
            elif effect.kind == _DUPLICATE:
                copies = 2
            elif effect.kind == _STALE:
                _repeat(effect, frame, before, k)
            else:
                _spoil(effect, layouts, frame)
        for copy in range(copies):
            if left < len(out):
                out[left] = before[k]
                if copy < copies - 1:
                    out[left].reserved = 1
                left += 1
    return left


@compiled
def _spoil(effect: Effect, layouts: Records[MessageLayout], frame: Frame) -> None:
    """Change a frame. CORRUPT_WIRE changes none: the controllers notice, and send it again."""
    if effect.kind == _CORRUPT:
        wrong = effect.parameter - 1 if effect.parameter > 0 else bit(effect.draws)
        frame["data"] ^= np.uint64(1) << np.uint64(wrong)
    elif effect.kind == _WRONG_COUNTER:
        for layout in layouts:
            if layout.can_id == frame.can_id and layout.data_id > 0:
                frame["data"] = protect(frame["data"], layout, counter_of(frame["data"]) + 1)


@compiled
def _repeat(effect: Effect, frame: Frame, before: FrameArray, k: int) -> None:
    """Put the first frame of its identifier in the place of a frame, which is `before[k]`."""
    mark, at = frame.reserved, 0
    while at < effect.held_count and effect.held[at].can_id != frame.can_id:
        at += 1
    if at == len(effect.held):
        return
    if at == effect.held_count:
        effect.held[at] = frame
        effect.held_count += 1
    before[k] = effect.held[at]
    before[k].reserved = mark


@compiled
def _reorder(effect: Effect, passage: Passage, count: int, out: FrameArray) -> None:
    """Shuffle the frames (Fisher and Yates, from the inside out), if the epoch is drawn."""
    if uniform(effect.draws) >= effect.probability:
        return
    passage.affected += count
    before = _keep(passage, count, out)
    for k in range(count):
        other = int(uniform(effect.draws) * (k + 1))
        out[k] = out[other]
        out[other] = before[k]


@compiled
def _shift(by: int, count: int, out: FrameArray) -> int:
    """Make room before the first frames; return how many there are then."""
    count = min(count + by, len(out))
    for k in range(count - 1, by - 1, -1):
        out[k] = out[k - by]
    return count


@compiled
def _babble(noise: int, count: int, out: FrameArray) -> int:
    """Put the frames of a babbling node first; return how many there are then."""
    count = _shift(noise, count, out)
    for k in range(min(noise, count)):
        frame = out[k]
        frame.can_id, frame.length, frame.flags, frame.raw_dlc = BABBLE_IDENTIFIER, 8, 0, 0
        frame["data"] = 0
        frame.reserved = 0
    return count


@compiled
def _delay(passage: Passage, late: Records[LateFrame], sender: int, due: int, frame: Frame) -> None:
    """Put a frame where it is due: after those that are due in the same epoch."""
    at = passage.end_late[sender]
    while at > passage.first_late[sender] and late[at - 1].due > due:
        late[at] = late[at - 1]
        at -= 1
    late[at].due = due
    late[at].frame[0] = frame
    late[at].frame[0].reserved = 0
    passage.end_late[sender] += 1


@compiled
def _deliver(
    passage: Passage,
    late: Records[LateFrame],
    sender: int,
    epoch: int,
    count: int,
    out: FrameArray,
) -> int:
    """Put the late frames that are due first; return how many there are then."""
    first, end = passage.first_late[sender], passage.end_late[sender]
    until = first
    while until < end and late[until].due <= epoch:
        until += 1
    count = _shift(until - first, count, out)
    for k in range(min(until - first, count)):
        out[k] = late[first + k].frame[0]
    passage.first_late[sender] = until
    if until == end:
        passage.first_late[sender] = passage.end_late[sender] = 0
    return count
