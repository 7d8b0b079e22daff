"""Lays two sequences of frames side by side, epoch by epoch, and compares them.

The hardware's frames, and those of others, have the epoch that the hardware had opened; the
firmware's have that of the step in which it sent them, wherever in a log they stand. What comes
before the first SYNC is laid side by side by how often its message was there before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import tee

import numpy as np
from numpy.typing import NDArray

from host_tools.logs.comparison import BEFORE_SYNC, Comparison, Sent, joined, nothing_sent
from host_tools.logs.epochs import NO_EPOCH, Cutter, Steps
from host_tools.logs.errors import RecordError
from host_tools.logs.reader import Log, Piece

_THE_END = np.iinfo(np.int64).max

OnProgress = Callable[[int], None]
"""Called with the bytes read so far."""


class Ahead:
    """Frames that are read and not compared yet.

    Parameters
    ----------
    blocks : iterable of Sent
        Keys do not fall from block to block, but for those before the first SYNC.
    """

    def __init__(self, blocks: Iterable[Sent]) -> None:
        self._blocks = iter(blocks)
        self._waiting = nothing_sent()
        self._before = [nothing_sent()]
        self.last_epoch = NO_EPOCH

    @property
    def has_ended(self) -> bool:
        """Whether all is read."""
        return self.last_epoch == _THE_END

    def read_on(self) -> None:
        """Read the next block."""
        block = next(self._blocks, None)
        if block is None:
            self.last_epoch = _THE_END
            return
        is_before = block.epoch == NO_EPOCH
        if is_before.any():
            self._before.append(block.only(is_before))
            block = block.only(~is_before)
        if len(block.key):
            self._waiting = joined([self._waiting, block])
            self.last_epoch = int(block.key[-1])

    def take(self, until: int) -> Sent:
        """Take what is before an epoch."""
        is_earlier = self._waiting.key < until
        taken, self._waiting = self._waiting.only(is_earlier), self._waiting.only(~is_earlier)
        return taken

    def before_sync(self) -> Sent:
        """Return what came before the first SYNC: the n-th frame of each message has key n."""
        found = joined(self._before)
        identifiers = found.frames["can_id"].astype(np.int64)
        order = np.argsort(identifiers, kind="stable")
        ordered = identifiers[order]
        begins = np.r_[True, ordered[1:] != ordered[:-1]] if len(ordered) else np.zeros(0, bool)
        starts = np.maximum.accumulate(np.where(begins, np.arange(len(ordered)), 0))
        turn = np.empty_like(identifiers)
        turn[order] = np.arange(len(ordered)) - starts
        return Sent(found.frames, BEFORE_SYNC + turn, found.epoch)


def compare_blocks(
    comparison: Comparison,
    pairs: list[tuple[Ahead, Ahead]],
    on_progress: Callable[[], None] = lambda: None,
) -> None:
    """Compare pairs of sequences whose keys are epochs, as far as both of a pair are read."""
    left_to_do = list(pairs)
    while left_to_do:
        for left, right in left_to_do:
            behind = left if left.last_epoch <= right.last_epoch else right
            behind.read_on()
            until = min(left.last_epoch, right.last_epoch)
            comparison.add(left.take(until), right.take(until))
        on_progress()
        left_to_do = [pair for pair in left_to_do if not all(one.has_ended for one in pair)]
    for left, right in pairs:
        comparison.add(left.before_sync(), right.before_sync())


def compare_logs(
    ours: Log, theirs: Log, on_progress: OnProgress = lambda position: None
) -> Comparison:
    """Compare all messages of two logs, epoch by epoch, from the first frame to the last.

    Raises
    ------
    RecordError
        When one of them cannot be read, or neither has a frame of the contract.
    """
    comparison = Comparison((str(ours.path), str(theirs.path)))
    (our_hardware, our_firmware), (their_hardware, their_firmware) = _both(ours), _both(theirs)
    compare_blocks(
        comparison,
        [(our_hardware, their_hardware), (our_firmware, their_firmware)],
        lambda: on_progress(ours.position + theirs.position),
    )
    if comparison.is_same and not comparison.frames:
        raise RecordError(f"{ours.path}, {theirs.path}: nothing to compare: no frame is of the DBC")
    return comparison


def firmware_of(log: Log) -> Ahead:
    """Return what the firmware sent in a log."""
    return Ahead(_by_firmware(log.pieces()))


def _both(log: Log) -> tuple[Ahead, Ahead]:
    """Return what the hardware and others sent in a log, and what the firmware did."""
    one, other = tee(log.pieces())
    return Ahead(_by_hardware(log, one)), Ahead(_by_firmware(other))


def _by_hardware(log: Log, pieces: Iterable[Piece]) -> Iterator[Sent]:
    last = NO_EPOCH
    for steps in Cutter(has_firmware=False).steps(pieces):
        found = _sent(steps, ~steps.is_sent, steps.epoch_of_frames())
        known = found.epoch[found.epoch != NO_EPOCH]
        if len(known):
            if int(known[0]) < last - 1:
                raise RecordError(
                    f"{log.path}: epoch {int(known[0])} comes after epoch {last}: "
                    "it holds more than one run"
                )
            last = max(last, int(known[-1]))
        yield found


def _by_firmware(pieces: Iterable[Piece]) -> Iterator[Sent]:
    last = NO_EPOCH
    for steps in Cutter().steps(pieces):
        epoch = steps.epoch_of_frames()
        if last != NO_EPOCH:
            epoch[epoch == NO_EPOCH] = last + 1  # of a step that it did not close
        found = _sent(steps, steps.is_sent, epoch)
        last = int(found.epoch.max(initial=last))
        yield found


def _sent(steps: Steps, mask: NDArray[np.bool_], epoch: NDArray[np.int64]) -> Sent:
    """Return some of the frames of steps, in the order of their epochs."""
    found = Sent(steps.frames[mask], epoch[mask], epoch[mask])
    order = np.argsort(found.key, kind="stable")
    return Sent(found.frames[order], found.key[order], found.epoch[order])
