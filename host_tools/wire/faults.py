"""Faults on the wire: their effect on frames, seeded and repeatable.

A fault is injected by the scenario or, live, by the message FAULT_COMMAND. It acts on frames that
one side sends, in the order in which they are sent, before the wire's timing. Which frame is hit is
drawn from the scenario's seed and the fault's number only.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from rrins.compiled.record import Records
from rrins.dbc.codec import load
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of, protect
from rrins.dbc.frame import FrameArray, frame_array
from rrins.host_tools.hardware.faults import NEVER
from rrins.host_tools.wire.fault_kinds import FaultKind
from rrins.host_tools.wire.losses import CAPACITY as LOSSES
from rrins.host_tools.wire.losses import Draws, Loss


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

_SILENT = (FaultKind.DROP, FaultKind.SILENCE, FaultKind.BUS_OFF, FaultKind.CUT)


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
        return self.first_epoch <= epoch and not 0 <= self.last_epoch < epoch

    def is_over(self, epoch: int) -> bool:
        """Return whether the fault will never act again."""
        return 0 <= self.last_epoch < epoch

    def means(self, sender: Node, can_id: int) -> bool:
        """Return whether the fault affects a frame of a side."""
        if self.kind == FaultKind.CUT:
            return True
        if self.kind == FaultKind.POWER_OFF:
            return sender == Node.FIRMWARE
        if self.node not in (Node.ANY, sender):
            return False
        return self.identifier in (ANY_IDENTIFIER, can_id)


_Held = dict[int, FrameArray]


@dataclass(frozen=True)
class _Entry:
    """A fault, its random numbers, the frames that it holds by identifier."""

    fault: WireFault
    draws: Draws
    held: _Held


_Delayed = tuple[int, int, FrameArray]
"""The epoch in which a frame is due, its number among those delayed, the frame."""

_Passing = list[FrameArray]
"""Frames on their way, each an array of one."""


class WireFaults:
    """The faults of a run.

    Parameters
    ----------
    faults : iterable of WireFault
    seed : int
    has_timing : bool
        Whether the wire's timing is modelled: then CORRUPT_WIRE, BUS_OFF, CUT and BABBLE are the
        model's to play, and are left alone here.
    """

    def __init__(self, faults: tuple[WireFault, ...], seed: int, has_timing: bool = False) -> None:
        self._seed = seed
        self._has_timing = has_timing
        self._faults: list[_Entry] = []
        self._number = 0
        self._delayed: dict[Node, list[_Delayed]] = {Node.HARDWARE: [], Node.FIRMWARE: []}
        self._sequence = itertools.count()
        self._losses = Loss.zeros(LOSSES)
        self._losing: list[_Entry] = []  # whose draws are in `_losses`
        self._copies: _Held = {}  # by identity: the copies that DUPLICATE made in this epoch
        self._messages = {  # those that have a counter
            int(row.can_id): row for row in load().messages if row.data_id
        }
        self.affected_frames = 0
        self.can_cut_power = True  # whether somebody does what POWER_OFF says
        for fault in faults:
            self.add(fault)

    def add(self, fault: WireFault) -> None:
        """Inject a fault."""
        random = np.random.default_rng([self._seed, self._number])
        self._number += 1
        self._faults.append(_Entry(fault, Draws(random), {}))

    def renew(self, fault: WireFault) -> bool:
        """Inject a fault that begins at once and replaces an identical active one.

        Returns False if there is no room.
        """
        epoch = fault.first_epoch
        kept = [
            entry
            for entry in self._faults
            if not entry.fault.is_over(epoch)
            and not (entry.fault.is_active(epoch) and entry.fault.identity == fault.identity)
        ]
        if len(kept) >= CAPACITY:
            return False
        self._faults = kept
        self.add(fault)
        return True

    def remove(self, kind: FaultKind, node: Node, identifier: int, epoch: int = 0) -> int:
        """Remove the faults of a kind on certain frames; return how many lasted to the epoch."""
        meant = (kind, node, identifier)
        left, ended = [], 0
        for entry in self._faults:
            if entry.fault.identity[:3] == meant:
                ended += not entry.fault.is_over(epoch)
            else:
                left.append(entry)
        self._faults = left
        return ended

    def clear(self) -> None:
        """Remove all faults; delayed frames still arrive."""
        self._faults.clear()

    def is_idle(self) -> bool:
        """Return whether no fault can act any more."""
        return not self._faults and not any(self._delayed.values())

    def active(self, epoch: int) -> list[WireFault]:
        """Return the faults that act in an epoch, and drop those that are over."""
        self._faults = [entry for entry in self._faults if not entry.fault.is_over(epoch)]
        return self.acting(epoch)

    def acting(self, epoch: int) -> list[WireFault]:
        """Return the faults that act in an epoch."""
        return [entry.fault for entry in self._faults if entry.fault.is_active(epoch)]

    def apply(
        self, sender: Node, frames: FrameArray, count: int, epoch: int, out: FrameArray
    ) -> int:
        """Write a side's frames of an epoch, after faults, to `out`; return their number."""
        passing = _each(frames[:count].copy())
        self._copies.clear()
        for entry in self._faults:
            if entry.fault.is_active(epoch):
                passing = self._hit(entry, sender, passing, epoch)[: len(out)]
        passing = [*self._due(sender, epoch), *passing][: len(out)]
        for k, frame in enumerate(passing):
            out[k] = frame[0]
        return len(passing)

    def loses_until(self, epoch: int) -> int:
        """Return the epoch up to which the same faults act as in this one, and only lose frames.

        Returns `epoch` if other faults act.
        """
        until, acting = NEVER, 0
        for fault in (entry.fault for entry in self._faults):
            if fault.is_active(epoch):
                acting += 1
                if self._has_timing or fault.kind not in _SILENT or acting > LOSSES:
                    return epoch
                if fault.last_epoch >= 0:
                    until = min(until, fault.last_epoch + 1)
            elif not fault.is_over(epoch):
                until = min(until, fault.first_epoch)
        return epoch if any(self._delayed.values()) else until

    def losses(self, epoch: int) -> Records[Loss]:
        """Return the faults that act in an epoch, of which `loses_until` says that they only lose.

        `settle_losses` is due before anything else is asked of the faults.
        """
        self._losing = [entry for entry in self._faults if entry.fault.is_active(epoch)]
        losses = self._losses[: len(self._losing)]
        for loss, entry in zip(losses, self._losing, strict=True):
            loss.node, loss.identifier = entry.fault.node, entry.fault.identifier
            loss.is_cut = entry.fault.kind == FaultKind.CUT
            loss.probability = entry.fault.probability
            entry.draws.look(loss.draws)
            loss.used = loss.lost = 0
        return losses

    def settle_losses(self) -> None:
        """Account for what was lost since `losses`."""
        for loss, entry in zip(self._losses, self._losing, strict=False):
            entry.draws.use(int(loss.used))
            self._count(int(loss.lost))
        self._losing = []

    def has_power(self, epoch: int) -> bool:
        """Return whether the navigation computer has power in an epoch."""
        return all(fault.kind != FaultKind.POWER_OFF for fault in self.acting(epoch))

    def acts(self, epoch: int) -> bool:
        """Return whether anything happens to frames in an epoch."""
        return any(self._delayed.values()) or any(
            entry.fault.is_active(epoch) for entry in self._faults
        )

    def _due(self, sender: Node, epoch: int) -> _Passing:
        """Return the delayed frames of a side that are due."""
        delayed = self._delayed[sender]
        due = []
        while delayed and delayed[0][0] <= epoch:
            due.append(heapq.heappop(delayed)[2])
        return due

    def _hit(self, entry: _Entry, sender: Node, passing: _Passing, epoch: int) -> _Passing:
        fault, draws = entry.fault, entry.draws
        if fault.kind == FaultKind.REORDER:
            return self._reorder(fault, draws.random, sender, passing)
        if fault.kind == FaultKind.BABBLE:
            return (
                passing
                if self._has_timing or sender != Node.HARDWARE
                else [*_each(babble(max(1, fault.parameter))), *passing]
            )
        left: _Passing = []
        for frame in passing:
            hit = fault.means(sender, int(frame["can_id"][0]))
            if fault.kind == FaultKind.DUPLICATE and id(frame) in self._copies:
                hit = False  # or a dozen such faults would make thousands of one frame
            if hit and draws.draw() < fault.probability:
                left.extend(self._affect(entry, sender, frame, epoch))
            else:
                left.append(frame)
        return left

    def _reorder(
        self, fault: WireFault, random: np.random.Generator, sender: Node, passing: _Passing
    ) -> _Passing:
        if fault.node not in (Node.ANY, sender) or random.random() >= fault.probability:
            return passing
        self._count(len(passing))
        return [passing[k] for k in random.permutation(len(passing))]

    def _affect(
        self, entry: _Entry, sender: Node, frame: FrameArray, epoch: int
    ) -> Iterator[FrameArray]:
        fault, random, held = entry.fault, entry.draws.random, entry.held
        kind = fault.kind
        by_model = (FaultKind.CORRUPT_WIRE, FaultKind.BUS_OFF, FaultKind.CUT)
        if self._has_timing and kind in by_model:
            yield frame
            return
        self._count(1)
        if kind in _SILENT or kind == FaultKind.POWER_OFF:
            return
        if kind == FaultKind.DELAY:
            at = epoch + max(1, fault.parameter)
            heapq.heappush(self._delayed[sender], (at, next(self._sequence), frame))
            return
        if kind == FaultKind.CORRUPT:
            bit = fault.parameter - 1 if fault.parameter else int(random.integers(64))
            frame["data"] ^= np.uint64(1) << np.uint64(bit)
        elif kind == FaultKind.WRONG_COUNTER:
            self._miscount(frame)
        elif kind == FaultKind.DUPLICATE:
            copy = frame.copy()
            self._copies[id(copy)] = copy
            yield copy
        elif kind == FaultKind.STALE:
            again = held.setdefault(int(frame["can_id"][0]), frame).copy()
            if id(frame) in self._copies:
                self._copies[id(again)] = again
            frame = again
        yield frame  # CORRUPT_WIRE, too: the controllers send the frame again

    def _miscount(self, frame: FrameArray) -> None:
        """Give a frame the counter after its own, with a CRC that fits."""
        message = self._messages.get(int(frame["can_id"][0]))
        if message is not None:
            counter = (counter_of(frame[0]["data"]) + 1) % COUNTER_MODULUS
            frame["data"] = protect(frame[0]["data"], message, counter)

    def _count(self, frames: int) -> None:
        self.affected_frames += frames


def _each(frames: FrameArray) -> _Passing:
    """Return each of the frames as an array of one."""
    return [frames[k : k + 1] for k in range(len(frames))]


def babble(count: int) -> FrameArray:
    """Return the frames that a babbling node sends in an epoch."""
    noise = frame_array(count)
    noise["can_id"] = BABBLE_IDENTIFIER
    noise["length"] = 8
    return noise
