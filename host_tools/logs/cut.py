"""The compiled part of `host_tools.logs.epochs`: gives each frame of a log its step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.codec import unpack
from dbc.contract import load_contract
from dbc.e2e import COUNTER_MODULUS, counter_of, crc_holds
from firmware_py.intake import ADOPT_BEYOND

IDENTIFIERS = 2048

STRANGER = 0
"""Kinds of frames: of anybody else; of the hardware, and among them those of every epoch, and SYNC;
of the firmware, and among them the command of the inner axis, and that of the outer, the last."""
HARDWARE = 1
EVERY_EPOCH = 2
SYNC = 3
FIRMWARE = 4
COMMAND = 5
LAST_COMMAND = 6

NO_EPOCH = -1
NO_STEP = -1

_EPOCH_MODULUS = 1 << 24
_AHEAD = COUNTER_MODULUS // 2  # a counter further ahead than this is one behind

_STATE = np.dtype(
    (
        np.record,
        [
            ("step", "<i8"),  # the next one to be closed
            ("epoch", "<i8"),  # by the firmware: of the last step; by the hardware: of the present
            ("newest", "<i8"),  # epoch of the latest SYNC
            ("synchronised", "u1"),
            ("begun", "u1"),
            ("seen", "u1", (IDENTIFIERS,)),  # messages of the present epoch
        ],
    )
)


def new_state() -> NDArray[Any]:
    """Return what is carried from one piece of a log to the next: an array of one record."""
    state = np.zeros(1, dtype=_STATE)
    state["epoch"] = NO_EPOCH
    return state


@njit(cache=True)
def _sync_epoch(frame: Any, sync: Any, near: int, is_near: bool) -> int:
    """Return the epoch that a SYNC opens, counted on beyond its 24 bits."""
    low = unpack(frame["data"], sync.epoch)
    if is_near:
        ahead = (low - near) % _EPOCH_MODULUS
        if ahead >= _EPOCH_MODULUS // 2:
            ahead -= _EPOCH_MODULUS
        if abs(ahead) <= ADOPT_BEYOND:
            return near + ahead
    wraps = (counter_of(frame["data"]) - low) % COUNTER_MODULUS
    return low + _EPOCH_MODULUS * wraps


@njit(cache=True)
def _note_syncs(state: Any, frames: Any, kinds: Any, begin: int, end: int, sync: Any) -> None:
    """Take the SYNCs that the firmware had in a step; the epoch follows them as the firmware's.

    It takes over the count of one that is far off, and looks no further than one that is ahead.
    """
    is_ahead = False
    for k in range(begin, end):
        if kinds[k] != SYNC or not crc_holds(frames[k], sync.message):
            continue
        expected = state.epoch + 1
        found = _sync_epoch(frames[k], sync, expected, state.synchronised != 0)
        if state.synchronised and abs(found - expected) <= ADOPT_BEYOND:
            state.newest = max(state.newest, found)
            is_ahead = is_ahead or found > expected
        elif not is_ahead:
            state.epoch = found - 1
            state.newest = found
            state.synchronised = 1


@njit(cache=True)
def _lost_steps(state: Any, command: Any, message: Any) -> int:
    """Return how many steps before that of a command have none in the log."""
    if state.begun == 0 or state.synchronised == 0 or not crc_holds(command, message):
        return 0
    ahead = (counter_of(command["data"]) - (state.epoch + 1)) % COUNTER_MODULUS
    if ahead <= _AHEAD and state.epoch + 1 + ahead <= state.newest:
        return ahead
    return 0


@njit(cache=True)
def _start_of_run(kinds: Any, begin: int, end: int) -> int:
    """Return where the frames begin that the firmware sent in a row, ``kinds[end]`` the last.

    A frame of the hardware among them is of the next epoch, and was there before the firmware came
    to what follows it; anybody else's is not known to have been.
    """
    start = end
    for k in range(end, begin - 1, -1):
        if HARDWARE <= kinds[k] <= SYNC:
            break
        if kinds[k] >= FIRMWARE:
            start = k
    return start


@njit(cache=True)
def _first_heard(frames: Any, kinds: Any, end: int, last: int, sync: Any) -> int:
    """Return the first frame that the firmware can have had in its first step.

    It came in after its own greetings, and, where several epochs were opened before it answered,
    with the one that its first command belongs to.
    """
    heard = 0
    begin = end
    others = 0
    counter = counter_of(frames[last]["data"])
    for k in range(end):
        if kinds[k] >= FIRMWARE:
            heard = k + 1
        elif kinds[k] == SYNC and crc_holds(frames[k], sync.message):
            if counter_of(frames[k]["data"]) == counter:
                begin = k
            else:
                others += 1
    return max(heard, begin) if others else heard


@njit(cache=True)
def _start_unsynchronised(
    frames: Any, kinds: Any, begin: int, start: int, last: int, sync: Any
) -> int:
    """Return up to where the firmware had the frames in a step before which it had no SYNC.

    With the first one it takes over the epoch, so its commands carry that: when they do not, the
    SYNC came too late for the step, though it is before the answer in the log.
    """
    counter = counter_of(frames[last]["data"])
    for n in range(begin, start):
        if kinds[n] != SYNC or not crc_holds(frames[n], sync.message):
            continue
        if counter_of(frames[n]["data"]) != counter:
            return n
        for k in range(last + 1, len(frames)):  # by its own count, by chance, it was the same
            if kinds[k] == LAST_COMMAND:
                return n if counter_of(frames[k]["data"]) == counter else start
        return start
    return start


@njit(cache=True)
def _is_last(frames: Any, kinds: Any, k: int) -> bool:
    """Return whether a frame is the last one of its step.

    Where the command of the outer axis is lost, that of the inner one is, if the hardware is heard
    next, and the outer one does not come late.
    """
    if kinds[k] != COMMAND:
        return bool(kinds[k] == LAST_COMMAND)
    if k + 1 == len(frames) or not HARDWARE <= kinds[k + 1] <= SYNC:
        return False
    for n in range(k + 1, len(frames)):
        if kinds[n] == COMMAND:
            return True
        if kinds[n] == LAST_COMMAND:
            return bool(counter_of(frames[n]["data"]) != counter_of(frames[k]["data"]))
    return False  # not known yet


@njit(cache=True)
def by_firmware(
    frames: Any, kinds: Any, contracts: Any, messages: Any, states: Any, step: Any, epochs: Any
) -> tuple[int, int]:
    """Give each frame its step, up to the last step that the firmware has closed.

    Returns the frames that are done, and the steps that were closed.
    """
    contract, state = contracts[0], states[0]
    begin = 0
    closed = 0
    for k in range(len(frames)):
        if kinds[k] < COMMAND or not _is_last(frames, kinds, k):
            continue
        if closed + _AHEAD + 1 > len(epochs):
            break
        start = _start_of_run(kinds, begin, k)
        if state.begun == 0:
            begin = _first_heard(frames, kinds, start, k, contract.sync)
            state.begun = 1
        end = start
        if state.synchronised == 0:
            start = _start_unsynchronised(frames, kinds, begin, start, k, contract.sync)
        _note_syncs(state, frames, kinds, begin, start, contract.sync)
        lost = _lost_steps(state, frames[k], messages[frames[k].can_id])
        for n in range(begin, k + 1):
            if kinds[n] >= FIRMWARE:
                step[n] = state.step + lost
            else:
                step[n] = state.step if n < start else state.step + lost + 1
        for _ in range(lost + 1):
            state.epoch += 1
            epochs[closed] = state.epoch if state.synchronised else NO_EPOCH
            closed += 1
        _note_syncs(state, frames, kinds, start, end, contract.sync)  # for the next step
        state.step += lost + 1
        begin = k + 1
    return begin, closed


@njit(cache=True)
def by_hardware(
    frames: Any, kinds: Any, contracts: Any, messages: Any, states: Any, step: Any, epochs: Any
) -> tuple[int, int]:
    """Give each frame its step, in a log without the firmware's frames; see `by_firmware`."""
    contract, state = contracts[0], states[0]
    begin = 0
    closed = 0
    for k in range(len(frames)):
        frame = frames[k]
        is_sync = kinds[k] == SYNC
        if not EVERY_EPOCH <= kinds[k] <= SYNC or not crc_holds(frame, messages[frame.can_id]):
            step[k] = state.step if state.begun else NO_STEP
            continue
        ahead = 0
        if is_sync:
            found = _sync_epoch(frame, contract.sync, state.epoch, state.begun != 0)
            if state.begun == 0:
                state.begun = 1
                state.epoch = found
            ahead = found - state.epoch
        elif state.begun and state.seen[frame.can_id]:
            ahead = (counter_of(frame["data"]) - state.epoch) % COUNTER_MODULUS
            ahead = ahead if ahead <= _AHEAD else 0
        is_jump = abs(ahead) > ADOPT_BEYOND
        if ahead > 0 or is_jump:
            steps = 1 if is_jump else ahead
            if closed + steps > len(epochs):
                break
            for n in range(steps):
                epochs[closed + n] = state.epoch + n
            closed += steps
            state.step += steps
            state.epoch += ahead
            state.seen[:] = 0
            begin = k
            # Where SYNC is missing, what else is sent before the sensors is of the new epoch, too.
            while not is_sync and begin > 0 and not EVERY_EPOCH <= kinds[begin - 1] <= SYNC:
                begin -= 1
                step[begin] = state.step
        state.seen[frame.can_id] = 1
        step[k] = state.step if state.begun else NO_STEP
    return begin, closed


@njit(cache=True)
def _by_sync(frames: Any, contracts: Any, epoch: int, out: Any) -> int:
    sync = contracts[0].sync
    for k in range(len(frames)):
        frame = frames[k]
        if frame.can_id == sync.message.can_id and crc_holds(frame, sync.message):
            found = _sync_epoch(frame, sync, epoch, epoch != NO_EPOCH)
            if found > epoch or epoch - found > ADOPT_BEYOND:
                epoch = found
        out[k] = epoch
    return epoch


def epochs_by_sync(frames: Any, epoch: int, out: NDArray[np.int64]) -> int:
    """Write the epoch that the last SYNC before each frame, or it, has opened; return the last.

    `epoch` is that of the frame before, `NO_EPOCH` where there was no SYNC.
    """
    return int(_by_sync(frames, load_contract(), epoch, out))
