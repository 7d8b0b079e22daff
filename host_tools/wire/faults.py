"""Faults on the wire: their effect on frames, seeded and repeatable.

A fault is injected by the scenario or, live, by the message FAULT_COMMAND. It acts on frames that
one side sends, in the order in which they are sent, before the wire's timing. Which frame is hit is
drawn from the scenario's seed and the fault's number only. `rrins.host_tools.wire.effects` has what
becomes of the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.dbc.codec import load
from rrins.dbc.frame import FrameArray
from rrins.host_tools.hardware.faults import NEVER
from rrins.host_tools.wire import draws
from rrins.host_tools.wire.effects import (
    ANY_IDENTIFIER,
    CAPACITY,
    MOST_LATE,
    Effect,
    LateFrame,
    Node,
    Passage,
    affect,
    has_room,
)
from rrins.host_tools.wire.fault_kinds import FaultKind

_BY_MODEL = (FaultKind.CORRUPT_WIRE, FaultKind.BUS_OFF, FaultKind.CUT, FaultKind.BABBLE)
"""Kinds that the model of the wire's timing plays, where there is one."""

_NOBODY = -1


@dataclass(frozen=True)
class WireFault:
    """A fault and when it acts.

    Attributes
    ----------
    first_epoch, last_epoch : int
        When it acts, both included; `last_epoch` -1 until it is removed.
    """

    kind: FaultKind
    node: Node = Node.ANY  #: sender of the frames; without meaning for CUT and BABBLE
    identifier: int = ANY_IDENTIFIER  #: which frames; `ANY_IDENTIFIER` for all of the node
    first_epoch: int = 0
    last_epoch: int = -1
    probability: float = 1.0  #: share of the frames, or of the epochs for REORDER, that it hits
    parameter: int = 0  #: see `rrins.host_tools.wire.fault_kinds.to_number`.

    @property
    def identity(self) -> tuple[FaultKind, Node, int, int]:
        """Key of a fault: kind, node, identifier, parameter; equal keys mean the same fault."""
        return self.kind, self.node, self.identifier, self.parameter

    def is_active(self, epoch: int) -> bool:
        """Return whether the fault acts in an epoch."""
        return self.first_epoch <= epoch and not self.is_over(epoch)

    def is_over(self, epoch: int) -> bool:
        """Return whether the fault will never act again."""
        return 0 <= self.last_epoch < epoch

    @property
    def sender(self) -> Node:
        """Whose frames it affects; `ANY` for both sides'."""
        senders = {
            FaultKind.CUT: Node.ANY,
            FaultKind.POWER_OFF: Node.FIRMWARE,
            FaultKind.BABBLE: Node.HARDWARE,
        }
        return senders.get(self.kind, self.node)


class WireFaults:
    """The faults of a run.

    Parameters
    ----------
    faults : iterable of WireFault
        At most `CAPACITY`.
    seed : int
    has_timing : bool
        Whether the wire's timing is modelled: then CORRUPT_WIRE, BUS_OFF, CUT and BABBLE are the
        model's to play, and are left alone here.

    Attributes
    ----------
    effects, passages, late, layouts
        What `affect` works with; `late` by sender.
    """

    def __init__(self, faults: tuple[WireFault, ...], seed: int, has_timing: bool = False) -> None:
        self._seed = seed
        self._has_timing = has_timing
        self._faults: list[WireFault] = []
        self._number = 0
        self.effects, self.passages = Effect.zeros(CAPACITY), Passage.zeros()
        self.late = {side: LateFrame.zeros(0) for side in (Node.HARDWARE, Node.FIRMWARE)}
        self.layouts = load().messages
        self.can_cut_power = True  # whether somebody does what POWER_OFF says
        for fault in faults:
            self.add(fault)

    @property
    def affected_frames(self) -> int:
        """Frames that were hit so far."""
        return int(self.passages[0].affected)

    def add(self, fault: WireFault) -> None:
        """Inject a fault."""
        is_all = fault.kind in (FaultKind.CUT, FaultKind.POWER_OFF)
        effect = self.effects[len(self._faults)]
        effect.kind, effect.parameter = fault.kind, fault.parameter
        effect.node = _NOBODY if self._has_timing and fault.kind in _BY_MODEL else fault.sender
        effect.identifier = ANY_IDENTIFIER if is_all else fault.identifier
        effect.first_epoch, effect.last_epoch = fault.first_epoch, fault.last_epoch
        effect.probability = fault.probability
        draws.begin(effect.draws, [self._seed, self._number])
        effect.held_count = 0
        self._number += 1
        self._faults.append(fault)
        self.passages[0].count = len(self._faults)

    def _keep(self, is_kept: list[bool]) -> None:
        """Forget the other faults."""
        if all(is_kept):
            return
        kept = np.flatnonzero(is_kept)
        self._faults = [self._faults[k] for k in kept]
        self.effects[: len(kept)] = self.effects[kept]
        self.passages[0].count = len(kept)

    def renew(self, fault: WireFault) -> bool:
        """Inject a fault that begins at once and replaces an identical active one.

        Returns False if there is no room.
        """
        epoch = fault.first_epoch
        is_kept = [
            not one.is_over(epoch) and not (one.is_active(epoch) and one.identity == fault.identity)
            for one in self._faults
        ]
        if sum(is_kept) >= CAPACITY:
            return False
        self._keep(is_kept)
        self.add(fault)
        return True

    def remove(self, kind: FaultKind, node: Node, identifier: int, epoch: int = 0) -> int:
        """Remove the faults of a kind on certain frames; return how many lasted to the epoch."""
        is_meant = [one.identity[:3] == (kind, node, identifier) for one in self._faults]
        ended = sum(
            not one.is_over(epoch) for one, it in zip(self._faults, is_meant, strict=True) if it
        )
        self._keep([not it for it in is_meant])
        return ended

    def clear(self) -> None:
        """Remove all faults; delayed frames still arrive."""
        self._keep([False] * len(self._faults))

    @property
    def _is_any_late(self) -> bool:
        return bool(self.passages[0].end_late.any())

    def is_idle(self) -> bool:
        """Return whether no fault can act any more."""
        return not self._faults and not self._is_any_late

    def active(self, epoch: int) -> list[WireFault]:
        """Return the faults that act in an epoch, and drop those that are over."""
        self._keep([not fault.is_over(epoch) for fault in self._faults])
        return self.acting(epoch)

    def acting(self, epoch: int) -> list[WireFault]:
        """Return the faults that act in an epoch."""
        return [fault for fault in self._faults if fault.is_active(epoch)]

    def apply(
        self, sender: Node, frames: FrameArray, count: int, epoch: int, out: FrameArray
    ) -> int:
        """Write a side's frames of an epoch, after faults, to `out`; return their number.

        `out` has room for `rrins.host_tools.wire.effects.FRAMES` at most.
        """
        self.make_room()
        left = affect(
            self.effects,
            self.passages,
            self.late[sender],
            self.layouts,
            int(sender),
            frames,
            count,
            epoch,
            out,
        )
        return int(left)

    def make_room(self) -> None:
        """Have room for the frames that an epoch may delay."""
        if all(fault.kind != FaultKind.DELAY for fault in self._faults):
            return
        passage = self.passages[0]
        for side, late in self.late.items():
            if len(late) and has_room(passage, late, int(side)):
                continue
            first, end = int(passage.first_late[side]), int(passage.end_late[side])
            room = LateFrame.zeros(2 * (end - first + MOST_LATE))
            room[: end - first] = late[first:end]
            passage.first_late[side], passage.end_late[side] = 0, end - first
            self.late[side] = room

    def same_until(self, epoch: int) -> int:
        """Return the epoch up to which the same faults act as in this one.

        Returns `epoch` where compiled code cannot play them: with a model of the wire, or without
        power.
        """
        until = NEVER
        for fault in self._faults:
            if fault.is_active(epoch):
                if self._has_timing or fault.kind == FaultKind.POWER_OFF:
                    return epoch
                if fault.last_epoch >= 0:
                    until = min(until, fault.last_epoch + 1)
            elif not fault.is_over(epoch):
                until = min(until, fault.first_epoch)
        return until

    def has_power(self, epoch: int) -> bool:
        """Return whether the navigation computer has power in an epoch."""
        return all(fault.kind != FaultKind.POWER_OFF for fault in self.acting(epoch))

    def acts(self, epoch: int) -> bool:
        """Return whether anything happens to frames in an epoch."""
        return self._is_any_late or any(fault.is_active(epoch) for fault in self._faults)
