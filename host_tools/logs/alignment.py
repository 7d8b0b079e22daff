"""Aligns two sequences of frames epoch by epoch and compares them.

A frame from the hardware or from a third party belongs to the epoch that the hardware had opened; a
frame from the firmware belongs to the step in which it was sent, wherever it appears in the log.
Frames before the first SYNC are matched by message and occurrence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import tee

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Integers
from rrins.host_tools.logs.comparison import (
    BEFORE_SYNC,
    Comparison,
    Sent,
    joined,
    nothing_sent,
    occurrences,
)
from rrins.host_tools.logs.epochs import EpochFinder, LogSteps
from rrins.host_tools.logs.frame_steps import NO_EPOCH
from rrins.host_tools.logs.reader import Log, Piece
from rrins.host_tools.recording.errors import RecordError

_THE_END = np.iinfo(np.int64).max

OnProgress = Callable[[int], None]
"""Callback; receives the number of bytes read so far."""


class PendingFrames:
    """Frames already read but not yet compared.

    Parameters
    ----------
    blocks : iterable of Sent
        Keys never decrease from block to block, except before the first SYNC.
    """

    def __init__(self, blocks: Iterable[Sent]) -> None:
        self._blocks = iter(blocks)
        self._waiting = nothing_sent()
        self._before = [nothing_sent()]
        self.last_epoch = NO_EPOCH

    @property
    def has_ended(self) -> bool:
        """Whether every block has been read."""
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
        """Remove and return the frames before an epoch."""
        is_earlier = self._waiting.key < until
        taken, self._waiting = self._waiting.only(is_earlier), self._waiting.only(~is_earlier)
        return taken

    def before_sync(self) -> Sent:
        """Return the frames before the first SYNC; the n-th frame of each message has key n."""
        found = joined(self._before)
        turn = occurrences(found.frames["can_id"].astype(np.int64))
        return Sent(found.frames, BEFORE_SYNC + turn, found.epoch)


def compare_blocks(
    comparison: Comparison,
    pairs: list[tuple[PendingFrames, PendingFrames]],
    on_progress: Callable[[], None] = lambda: None,
) -> None:
    """Compare pairs of sequences keyed by epoch, as far as both of a pair have been read."""
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
        If a log cannot be read, or neither log has a frame of the DBC.
    """
    comparison = Comparison((str(ours.path), str(theirs.path)))
    (our_hardware, our_firmware), (their_hardware, their_firmware) = _both(ours), _both(theirs)
    compare_blocks(
        comparison,
        [(our_hardware, their_hardware), (our_firmware, their_firmware)],
        lambda: on_progress(ours.position + theirs.position),
    )
    if comparison.is_same and not comparison.frames:
        raise RecordError(f"{ours.path}, {theirs.path}: nothing to compare: no DBC frames")
    return comparison


def firmware_of(log: Log) -> PendingFrames:
    """Return the frames that the firmware sent in a log."""
    return PendingFrames(_by_firmware(log.pieces()))


def _both(log: Log) -> tuple[PendingFrames, PendingFrames]:
    """Return the frames from the hardware and third parties, and those from the firmware."""
    one, other = tee(log.pieces())
    return PendingFrames(_by_hardware(log, one)), PendingFrames(_by_firmware(other))


def _by_hardware(log: Log, pieces: Iterable[Piece]) -> Iterator[Sent]:
    last = NO_EPOCH
    for steps in EpochFinder(has_firmware=False).steps(pieces):
        found = _sent(steps, ~steps.is_sent, steps.epoch_of_frames())
        known = found.epoch[found.epoch != NO_EPOCH]
        if len(known):
            if int(known[0]) < last - 1:
                raise RecordError(
                    f"{log.path}: epoch {int(known[0])} follows epoch {last}: "
                    "the log holds more than one run"
                )
            last = max(last, int(known[-1]))
        yield found


def _by_firmware(pieces: Iterable[Piece]) -> Iterator[Sent]:
    last = NO_EPOCH
    for steps in EpochFinder().steps(pieces):
        epoch = steps.epoch_of_frames()
        if last != NO_EPOCH:
            epoch[epoch == NO_EPOCH] = last + 1  # the firmware did not close this step
        found = _sent(steps, steps.is_sent, epoch)
        last = int(found.epoch.max(initial=last))
        yield found


def _sent(steps: LogSteps, mask: NDArray[np.bool_], epoch: Integers) -> Sent:
    """Return the selected frames in order of epoch."""
    found = Sent(steps.frames[mask], epoch[mask], epoch[mask])
    order = np.argsort(found.key, kind="stable")
    return Sent(found.frames[order], found.key[order], found.epoch[order])
