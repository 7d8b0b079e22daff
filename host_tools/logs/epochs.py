"""Finds the epochs in a log: which frames the firmware had in which step, and which it sent.

The firmware closes its step by the command of the outer axis. What others sent before the frames
of a step is what the firmware had in it; what comes between its frames it had in the next one. So
steps in which frames were late, lost or damaged are found as they were, and steps without any
frame of the hardware as well.

A log without the firmware's frames is cut where SYNC opens an epoch, or, where a SYNC is missing,
where a message that has been there already comes again with the counter of a later epoch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.codec import load
from dbc.contract import load_contract
from dbc.e2e import MESSAGE
from dbc.frame import FrameArray
from host_tools.logs import cut
from host_tools.logs.reader import Piece

NO_EPOCH = cut.NO_EPOCH
"""Epoch of what comes before the first SYNC."""

NO_STEP = cut.NO_STEP
"""Step of frames that the firmware did not have, or has not answered."""

_LOOK_AHEAD = 20_000  # frames within which the firmware is heard, if it is in the log at all
_MOST_OPEN = 1 << 20  # frames that wait for the end of their step
_ROOM = 1024
_EVERY_EPOCH = ("SENSOR_", "AXIS_")


@dataclass(frozen=True)
class Steps:
    """Frames of a log in its order, and the steps of the firmware they belong to.

    Attributes
    ----------
    frames : FrameArray
    time_s : array of float
    step : array of int
        Step of each frame, counted from 0 over the whole log; `NO_STEP` for frames of none.
    is_sent : array of bool
        Whether the firmware sent the frame; else it had it in its step.
    first : int
        Number of the first step that is closed here.
    epochs : array of int
        Epoch of each step that is closed here, `NO_EPOCH` before the first SYNC.
    """

    frames: FrameArray
    time_s: NDArray[np.float64]
    step: NDArray[np.int64]
    is_sent: NDArray[np.bool_]
    first: int
    epochs: NDArray[np.int64]

    def epoch_of_frames(self) -> NDArray[np.int64]:
        """Return the epoch of each frame, `NO_EPOCH` where there is none."""
        found = np.full(len(self.frames), NO_EPOCH, dtype=np.int64)
        known = (self.step >= self.first) & (self.step < self.first + len(self.epochs))
        found[known] = self.epochs[self.step[known] - self.first]
        return found


def _identifier_table() -> NDArray[np.int64]:
    """Return what each identifier means to the cut, by the senders that the DBC names."""
    codec = load()
    table = np.full(cut.IDENTIFIERS, cut.STRANGER, dtype=np.int64)
    of_sender = {"FIRMWARE": cut.FIRMWARE, "HARDWARE": cut.HARDWARE}
    for message in codec.database.messages:
        sender = message.senders[0] if message.senders else ""
        table[message.frame_id] = of_sender.get(sender, cut.STRANGER)
        if sender == "HARDWARE" and message.name.startswith(_EVERY_EPOCH):
            table[message.frame_id] = cut.EVERY_EPOCH
    table[codec.frame_id("SYNC")] = cut.SYNC
    table[codec.frame_id("AXIS_INNER_COMMAND")] = cut.COMMAND
    table[codec.frame_id("AXIS_OUTER_COMMAND")] = cut.LAST_COMMAND
    return table


def _message_table() -> NDArray[Any]:
    """Return the message of each identifier; of length 0 where there is none."""
    table = np.zeros(cut.IDENTIFIERS, dtype=MESSAGE)
    for row in load().messages:
        table[int(row["can_id"])] = row
    return table


class Cutter:
    """Cuts the pieces of one log into steps.

    Parameters
    ----------
    has_firmware : bool, optional
        False cuts where the hardware opens an epoch, even where the firmware is in the log.

    Attributes
    ----------
    has_firmware : bool
        Whether the log is cut by the firmware's frames; known once `steps` has begun to yield.
    """

    def __init__(self, has_firmware: bool | None = None) -> None:
        self._looks = has_firmware is None
        self.has_firmware = has_firmware is not False
        self._contract = load_contract()
        self._table = _identifier_table()
        self._messages = _message_table()
        self._state = cut.new_state()

    def steps(self, pieces: Iterable[Piece]) -> Iterator[Steps]:
        """Yield the log in runs of whole steps; the last one may hold frames of no step."""
        pieces = iter(pieces)
        begin = self._look(pieces) if self._looks else []
        rest: Piece | None = None
        for piece in chain(begin, pieces):
            joined = piece if rest is None else _joined(rest, piece)
            while True:
                found = self._cut(joined)
                used = len(found.frames)
                joined = Piece(joined.frames[used:], joined.time_s[used:])
                if used or len(found.epochs):
                    yield found
                if not used or not len(joined) or len(found.epochs) < _ROOM:
                    break
            if len(joined) > _MOST_OPEN:
                yield self._without_step(joined)
                joined = Piece(joined.frames[:0], joined.time_s[:0])
            rest = joined
        if rest is not None and len(rest):
            yield self._without_step(rest) if self.has_firmware else self._last(rest)

    def _look(self, pieces: Iterator[Piece]) -> list[Piece]:
        """Look whether the firmware is in the log; return what was read for that."""
        begin: list[Piece] = []
        frames = 0
        self.has_firmware = False
        for piece in pieces:
            begin.append(piece)
            frames += len(piece)
            if np.any(self._kinds(piece.frames) >= cut.COMMAND):
                self.has_firmware = True
                break
            if frames > _LOOK_AHEAD:
                break
        return begin

    def _kinds(self, frames: FrameArray) -> NDArray[np.int64]:
        identifiers = frames["can_id"]
        kinds = np.full(len(frames), cut.STRANGER, dtype=np.int64)
        known = identifiers < cut.IDENTIFIERS
        kinds[known] = self._table[identifiers[known]]
        return kinds

    def _cut(self, piece: Piece) -> Steps:
        frames = np.ascontiguousarray(piece.frames)
        kinds = self._kinds(frames)
        step = np.full(len(frames), NO_STEP, dtype=np.int64)
        epochs = np.zeros(len(frames) + _ROOM, dtype=np.int64)
        first = int(self._state[0]["step"])
        way = cut.by_firmware if self.has_firmware else cut.by_hardware
        used, closed = way(frames, kinds, self._contract, self._messages, self._state, step, epochs)
        return Steps(
            frames[:used],
            piece.time_s[:used],
            step[:used],
            kinds[:used] >= cut.FIRMWARE,
            first,
            epochs[:closed],
        )

    def _without_step(self, piece: Piece) -> Steps:
        step = np.full(len(piece), NO_STEP, dtype=np.int64)
        is_sent = self._kinds(piece.frames) >= cut.FIRMWARE
        first = int(self._state[0]["step"])
        nothing = np.zeros(0, dtype=np.int64)
        return Steps(piece.frames, piece.time_s, step, is_sent, first, nothing)

    def _last(self, piece: Piece) -> Steps:
        """Close the last step of a log without the firmware: nothing more comes."""
        found = self._without_step(piece)
        found.step[:] = found.first
        epoch = np.array([int(self._state[0]["epoch"])], dtype=np.int64)
        return Steps(found.frames, found.time_s, found.step, found.is_sent, found.first, epoch)


def _joined(first: Piece, second: Piece) -> Piece:
    if not len(first):
        return second
    return Piece(
        np.concatenate([first.frames, second.frames]), np.concatenate([first.time_s, second.time_s])
    )
