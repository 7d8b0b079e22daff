"""Tells two senders of one message apart from repeated, late and lost frames.

A sender sends a message at most once in an epoch. So a message has two senders when two sound
frames of it disagree about the same epoch:

- Both carry the counter of this epoch. Then neither is used: nobody can tell which is right.
- Beside the frame of this epoch, one has the counter of an earlier epoch whose own frame had come
  and said something else: a second sequence of counters. The frame of this epoch is used.

A frame that repeats another says the same. One that is late, or counted wrongly, is missing in its
own epoch. None of these is a second sender.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of
from rrins.firmware_py.core.records.memory import Ram


@compiled
def begin(state: Ram) -> None:
    """Open the next epoch: no frame disagrees yet."""
    state.heard.disputed = 0
    state.heard.doubted = 0


@compiled
def keep(state: Ram, source: int, word: np.uint64) -> None:
    """Keep the payload of a source's frame of this epoch."""
    heard, counter = state.heard, counter_of(word)
    heard.epoch_after[source, counter] = state.epoch + 1
    heard.word[source, counter] = word


@compiled
def dispute(state: Ram, source: int) -> None:
    """Note that two frames of a source disagree about this epoch."""
    state.faults.disagreeing_frames += 1
    state.heard.disputed |= 1 << source


@compiled
def is_disputed(state: Ram, source: int) -> bool:
    """Return whether two frames of a source disagree about this epoch."""
    return state.heard.disputed >> source & 1 != 0


@compiled
def compare(state: Ram, source: int, word: np.uint64) -> None:
    """Compare a second frame of this epoch with the first."""
    if state.heard.word[source, counter_of(word)] != word:
        dispute(state, source)


@compiled
def doubt(state: Ram, source: int, word: np.uint64) -> None:
    """Compare a frame of another epoch with the one that had come in its epoch, if any."""
    heard, counter = state.heard, counter_of(word)
    if counter >= COUNTER_MODULUS:
        return
    epoch = state.epoch - (state.epoch - counter) % COUNTER_MODULUS
    if heard.epoch_after[source, counter] == epoch + 1 and heard.word[source, counter] != word:
        state.faults.disagreeing_frames += 1
        heard.doubted |= 1 << source


@compiled
def second_senders(state: Ram, came: int) -> int:
    """Return the sources with two senders in this epoch, one bit each.

    `came` are those of which the frame of this epoch came: a doubted sequence may else be the only
    one, counted wrongly.
    """
    return state.heard.disputed | state.heard.doubted & came
