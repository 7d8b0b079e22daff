"""Tells a sender that repeats one frame for ever, by the state machine of AUTOSAR E2E.

The counter of a frame that is repeated in every epoch is right in every 15th by chance. After a
frame was repeated in epochs that are not its own, a run of right counters is needed before the
source's data count again. A source of which 14 frames in a row were the same is useless. One that
repeats a frame only now and then is trusted in between; that frame is not, even with the right
counter, unless it says what the frame before it said.

AUTOSAR, *Specification of SW-C End-to-End Communication Protection Library*: the status REPEATED,
and the number of right frames after which data are valid again.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.e2e import COUNTER_MODULUS, MessageLayout, protect
from rrins.firmware_py.core.records.memory import Ram

_DISTRUSTED_FROM = 2
_RIGHT_RUN = 3
_USELESS_FROM = COUNTER_MODULUS - 1
_REMEMBERED = COUNTER_MODULUS * COUNTER_MODULUS
"""Epochs for which a frame that was repeated is not taken for a new one."""


@compiled
def note_foreign(state: Ram, source: int, word: np.uint64) -> None:
    """Note a frame of another epoch: within 14 epochs, no sound sender sends it in two."""
    heard, ago = state.heard, state.epoch + 1 - state.heard.foreign_after[source]
    is_same = heard.foreign_word[source] == word and 0 < ago < _REMEMBERED
    heard.repeated_after[source] = state.epoch + 1 if is_same else 0
    if is_same and ago < COUNTER_MODULUS:
        heard.repetitions[source] = min(heard.repetitions[source] + 1, _USELESS_FROM)
        heard.right_run[source] = 0
    heard.foreign_word[source] = word
    heard.foreign_after[source] = state.epoch + 1


@compiled
def _is_again(state: Ram, source: int, message: MessageLayout, word: np.uint64) -> bool:
    """Return whether a frame with the right counter is the one that was repeated."""
    heard, counter = state.heard, state.epoch % COUNTER_MODULUS
    since, before = heard.repeated_after[source], (counter - 1) % COUNTER_MODULUS
    is_recent = since != 0 and state.epoch + 1 - since < _REMEMBERED
    if not is_recent or heard.foreign_word[source] != word:
        return False
    return bool(protect(heard.word[source, before], message, counter) != word)


@compiled
def is_trusted(state: Ram, source: int, message: MessageLayout, word: np.uint64) -> bool:
    """Note a frame with the right counter; return whether its data count."""
    heard = state.heard
    if _is_again(state, source, message, word):
        heard.right_run[source] = 0
        return False
    if heard.repetitions[source] >= _DISTRUSTED_FROM:
        heard.right_run[source] += 1
        if heard.right_run[source] < _RIGHT_RUN:
            return False
    heard.repetitions[source] = 0
    heard.right_run[source] = 0
    return True


@compiled
def is_useless(state: Ram, source: int) -> bool:
    """Return whether a source has sent nothing but one frame for as many epochs as counters are."""
    return bool(state.heard.repetitions[source] >= _USELESS_FROM)
