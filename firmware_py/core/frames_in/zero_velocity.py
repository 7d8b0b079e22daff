"""The operator's zero velocity: he says that the vehicle stands, for as long as he repeats it."""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import decode, unpack
from rrins.dbc.contract import MessageSignals
from rrins.dbc.e2e import counter_of, crc_holds
from rrins.dbc.frame import Frame
from rrins.firmware_py.core.records.memory import Ram

PATIENCE_NS = 500_000_000
"""Time without a frame after which the vehicle no longer counts as standing."""


@compiled
def receive(state: Ram, message: MessageSignals, frame: Frame) -> None:
    """Process a frame of ZERO_VELOCITY."""
    if not crc_holds(frame, message.message):
        state.faults.crc_errors += 1
        return
    counter = counter_of(frame["data"]) + 1  # 0 in the memory: none received yet
    if counter == state.zero_velocity.counter:  # said already: a sender that hangs says nothing
        state.faults.counter_errors += 1
        return
    state.zero_velocity.counter = counter
    keep(state, message, frame["data"])


@compiled
def keep(state: Ram, message: MessageSignals, word: np.uint64) -> None:
    """Store the payload of a frame."""
    zero = state.zero_velocity
    zero.heard = True
    zero.standing = unpack(word, message.standing) != 0
    zero.velocity_sigma = decode(word, message.velocity_sigma)


@compiled
def close(state: Ram) -> None:
    """Close the epoch: count for how long the vehicle has stood."""
    zero = state.zero_velocity
    zero.silent_epochs = 0 if zero.heard else zero.silent_epochs + 1
    zero.heard = False
    if zero.silent_epochs * state.parameters.period_ns > PATIENCE_NS:
        zero.standing = False
    zero.epochs = zero.epochs + 1 if zero.standing else 0
