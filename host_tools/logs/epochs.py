"""Finds the epochs in a log: which frames the firmware received and sent in each step.

The firmware closes each step with the outer-axis command. Frames from others that precede the
firmware's frames of a step were its input; frames in between were the input of the next step. This
recovers steps as they happened even if frames were late, lost or damaged, and also steps without
any hardware frame.

A log without firmware frames is split where SYNC opens an epoch. If a SYNC is missing, it is split
where a message recurs with the counter of a later epoch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.record import Floats, Integers, Records
from rrins.dbc.codec import load
from rrins.dbc.contract import load_contract
from rrins.dbc.e2e import MessageLayout
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.logs.frame_steps import (
    IDENTIFIERS,
    NO_EPOCH,
    NO_STEP,
    FrameRole,
    new_state,
    steps_by_firmware,
    steps_by_hardware,
)
from rrins.host_tools.logs.reader import Piece

_LOOK_AHEAD = 20_000  # frames within which the firmware appears, if it is in the log at all
_MOST_OPEN = 1 << 20  # frames that may wait for the end of their step
_ROOM = 1024
_EVERY_EPOCH = ("SENSOR_", "AXIS_")


@dataclass(frozen=True)
class LogSteps:
    """Frames in log order, and the firmware steps they belong to."""

    frames: FrameArray
    time_s: Floats
    #: step of each frame, counted from 0 over the whole log; `NO_STEP` if there is none
    step: Integers
    #: whether the firmware sent the frame; otherwise it received it in that step
    is_sent: NDArray[np.bool_]
    first: int  #: number of the first step closed here
    epochs: Integers  #: epoch of each step closed here, `NO_EPOCH` before the first SYNC

    def epoch_of_frames(self) -> Integers:
        """Return the epoch of each frame, `NO_EPOCH` where there is none."""
        found = np.full(len(self.frames), NO_EPOCH, dtype=np.int64)
        known = (self.step >= self.first) & (self.step < self.first + len(self.epochs))
        found[known] = self.epochs[self.step[known] - self.first]
        return found


def _roles_of_identifiers() -> Integers:
    """Return the frame role of each identifier, derived from the senders in the DBC."""
    codec = load()
    roles = np.full(IDENTIFIERS, FrameRole.OTHER, dtype=np.int64)
    of_sender = {"FIRMWARE": FrameRole.FIRMWARE, "HARDWARE": FrameRole.HARDWARE}
    for message in codec.database.messages:
        sender = message.senders[0] if message.senders else ""
        roles[message.frame_id] = of_sender.get(sender, FrameRole.OTHER)
        if sender == "HARDWARE" and message.name.startswith(_EVERY_EPOCH):
            roles[message.frame_id] = FrameRole.EVERY_EPOCH
    roles[codec.frame_id("SYNC")] = FrameRole.SYNC
    roles[codec.frame_id("AXIS_INNER_COMMAND")] = FrameRole.INNER_COMMAND
    roles[codec.frame_id("AXIS_OUTER_COMMAND")] = FrameRole.OUTER_COMMAND
    return roles


def _messages_of_identifiers() -> Records[MessageLayout]:
    """Return the message layout of each identifier; its length is 0 if there is no such message."""
    messages = MessageLayout.zeros(IDENTIFIERS)
    for message in load().messages:
        messages[int(message["can_id"])] = message
    return messages


class EpochFinder:
    """Splits the pieces of one log into steps.

    Parameters
    ----------
    has_firmware : bool, optional
        False splits where the hardware opens an epoch, even if the firmware is in the log.

    Attributes
    ----------
    has_firmware : bool
        Whether the log is split by the firmware's frames; known once `steps` has begun to yield.
    """

    def __init__(self, has_firmware: bool | None = None) -> None:
        self._is_unknown = has_firmware is None
        self.has_firmware = has_firmware is not False
        self._contract = load_contract()
        self._role_of_identifier = _roles_of_identifiers()
        self._messages = _messages_of_identifiers()
        self._state = new_state()

    def steps(self, pieces: Iterable[Piece]) -> Iterator[LogSteps]:
        """Yield the log in runs of complete steps; the last run may hold frames without a step."""
        pieces = iter(pieces)
        begin = self._look_for_firmware(pieces) if self._is_unknown else []
        rest: Piece | None = None
        for piece in chain(begin, pieces):
            joined = piece if rest is None else _joined(rest, piece)
            while True:
                found = self._split(joined)
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

    def _look_for_firmware(self, pieces: Iterator[Piece]) -> list[Piece]:
        """Check whether the firmware is in the log; return the pieces read to find out."""
        begin: list[Piece] = []
        frames = 0
        self.has_firmware = False
        for piece in pieces:
            begin.append(piece)
            frames += len(piece)
            if np.any(self._roles(piece.frames) >= FrameRole.INNER_COMMAND):
                self.has_firmware = True
                break
            if frames > _LOOK_AHEAD:
                break
        return begin

    def _roles(self, frames: FrameArray) -> Integers:
        identifiers = frames["can_id"]
        roles = np.full(len(frames), FrameRole.OTHER, dtype=np.int64)
        known = identifiers < IDENTIFIERS
        roles[known] = self._role_of_identifier[identifiers[known]]
        return roles

    def _split(self, piece: Piece) -> LogSteps:
        """Return the steps closed within a piece, and the frames up to there."""
        frames = Frame.contiguous(piece.frames)
        roles = self._roles(frames)
        step = np.full(len(frames), NO_STEP, dtype=np.int64)
        epochs = np.zeros(len(frames) + _ROOM, dtype=np.int64)
        first = int(self._state[0]["step"])
        find_steps = steps_by_firmware if self.has_firmware else steps_by_hardware
        used, closed = find_steps(
            frames, roles, self._contract, self._messages, self._state, step, epochs
        )
        return LogSteps(
            frames[:used],
            piece.time_s[:used],
            step[:used],
            roles[:used] >= FrameRole.FIRMWARE,
            first,
            epochs[:closed],
        )

    def _without_step(self, piece: Piece) -> LogSteps:
        step = np.full(len(piece), NO_STEP, dtype=np.int64)
        is_sent = self._roles(piece.frames) >= FrameRole.FIRMWARE
        first = int(self._state[0]["step"])
        nothing = np.zeros(0, dtype=np.int64)
        return LogSteps(piece.frames, piece.time_s, step, is_sent, first, nothing)

    def _last(self, piece: Piece) -> LogSteps:
        """Close the last step of a log without firmware frames: no more frames follow."""
        found = self._without_step(piece)
        found.step[:] = found.first
        epoch = np.array([int(self._state[0]["epoch"])], dtype=np.int64)
        return LogSteps(found.frames, found.time_s, found.step, found.is_sent, found.first, epoch)


def _joined(first: Piece, second: Piece) -> Piece:
    if not len(first):
        return second
    return Piece(
        Frame.joined([first.frames, second.frames]), np.concatenate([first.time_s, second.time_s])
    )
