"""The compiled part of `rrins.host_tools.logs.epochs`: assigns each frame of a log to its step."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

from rrins.compiled.compilation import compiled
from rrins.compiled.record import I8, U1, Bytes, Integers, Record, Records
from rrins.dbc.codec import unpack
from rrins.dbc.contract import Contract, MessageSignals, load_contract
from rrins.dbc.e2e import COUNTER_MODULUS, MessageLayout, counter_of, crc_holds
from rrins.dbc.frame import Frame, FrameArray
from rrins.firmware_py.core.frames_in.intake import ADOPT_BEYOND

IDENTIFIERS = 2048

NO_EPOCH = -1
"""Epoch of frames before the first SYNC."""

NO_STEP = -1
"""Step of frames that the firmware did not receive or has not answered."""


class FrameRole(IntEnum):
    """Role of a frame: who sent it, and whether it begins or ends a step.

    The order matters: HARDWARE to SYNC come from the hardware, FIRMWARE and up from the firmware.
    """

    OTHER = 0  #: from any other sender
    HARDWARE = 1
    EVERY_EPOCH = 2  #: from the hardware, in every epoch
    SYNC = 3
    FIRMWARE = 4
    INNER_COMMAND = 5
    OUTER_COMMAND = 6  #: the last of a step


_HARDWARE, _EVERY_EPOCH = int(FrameRole.HARDWARE), int(FrameRole.EVERY_EPOCH)
_SYNC, _FIRMWARE = int(FrameRole.SYNC), int(FrameRole.FIRMWARE)
_INNER_COMMAND, _OUTER_COMMAND = int(FrameRole.INNER_COMMAND), int(FrameRole.OUTER_COMMAND)

_EPOCH_MODULUS = 1 << 24
_AHEAD = COUNTER_MODULUS // 2  # a counter further ahead than this is behind


class StepState(Record):
    """State carried from one piece of a log to the next."""

    step: I8  #: the next step to close
    epoch: I8  #: split by firmware: of the last step; by hardware: of the current one
    newest: I8  #: epoch of the latest SYNC
    far_epoch: I8  #: that which another SYNC would continue, far from the count, plus 1; 0: none
    sync_seen: U1  #: whether the step has the SYNC of its epoch
    synchronised: U1
    begun: U1
    seen: Annotated[Bytes, IDENTIFIERS]  #: messages of the current epoch


def new_state() -> Records[StepState]:
    """Return the state before the first step, as an array of one record."""
    state = StepState.zeros()
    state["epoch"] = NO_EPOCH
    return state


@compiled
def _sync_epoch(frame: Frame, sync: MessageSignals, near: int, is_near: bool) -> int:
    """Return the epoch that a SYNC opens, unwrapped beyond its 24 bits."""
    low = unpack(frame["data"], sync.epoch)
    if is_near:
        ahead = (low - near) % _EPOCH_MODULUS
        if ahead >= _EPOCH_MODULUS // 2:
            ahead -= _EPOCH_MODULUS
        if abs(ahead) <= ADOPT_BEYOND:
            return near + ahead
    wraps = (counter_of(frame["data"]) - low) % COUNTER_MODULUS
    return low + _EPOCH_MODULUS * wraps


@compiled
def _follow_syncs(
    state: StepState,
    frames: FrameArray,
    roles: Integers,
    begin: int,
    end: int,
    sync: MessageSignals,
) -> None:
    """Apply the SYNCs that the firmware received in a step, the way the firmware does.

    It adopts the count of a SYNC that is far off once another continues it, and none after that of
    its own epoch; what follows one that is ahead, it ignores.
    """
    is_ahead = False
    for k in range(begin, end):
        if roles[k] != _SYNC or not crc_holds(frames[k], sync.message):
            continue
        expected = state.epoch + 1
        found = _sync_epoch(frames[k], sync, expected, state.synchronised != 0)
        if state.synchronised and abs(found - expected) <= ADOPT_BEYOND:
            state.newest = max(state.newest, found)
            is_ahead = is_ahead or found > expected
            if found == expected:
                state.sync_seen, state.far_epoch = 1, 0
        elif not is_ahead and _is_adopted(state, found):
            state.epoch = found - 1
            state.newest = found
            state.synchronised = 1
            state.sync_seen, state.far_epoch = 1, 0


@compiled
def _is_adopted(state: StepState, found: int) -> bool:
    """Return whether the firmware adopts the count of a SYNC that is far off."""
    if state.synchronised == 0:
        return True
    if state.sync_seen:
        return False
    expected = state.far_epoch - 1
    if state.far_epoch > 0 and expected <= found <= expected + 1:
        return True
    state.far_epoch = found + 1
    return False


@compiled
def _lost_steps(state: StepState, command: Frame, message: MessageLayout) -> int:
    """Return how many steps before a command have no command in the log."""
    if state.begun == 0 or state.synchronised == 0 or not crc_holds(command, message):
        return 0
    ahead = (counter_of(command["data"]) - (state.epoch + 1)) % COUNTER_MODULUS
    if ahead <= _AHEAD and state.epoch + 1 + ahead <= state.newest:
        return ahead
    return 0


@compiled
def _start_of_run(roles: Integers, begin: int, end: int) -> int:
    """Return the start of the firmware's consecutive frames that end at ``roles[end]``.

    A hardware frame among them belongs to the next epoch and arrived before the firmware sent the
    frames after it; for a third party's frame this is not certain.
    """
    start = end
    for k in range(end, begin - 1, -1):
        if _HARDWARE <= roles[k] <= _SYNC:
            break
        if roles[k] >= _FIRMWARE:
            start = k
    return start


@compiled
def _first_heard(
    frames: FrameArray, roles: Integers, end: int, last: int, sync: MessageSignals
) -> int:
    """Return the first frame that the firmware can have received in its first step.

    It follows the firmware's own start-up messages. If several epochs were opened before the
    firmware answered, it belongs to the epoch of the first command.
    """
    heard = 0
    begin = end
    others = 0
    counter = counter_of(frames[last]["data"])
    for k in range(end):
        if roles[k] >= _FIRMWARE:
            heard = k + 1
        elif roles[k] == _SYNC and crc_holds(frames[k], sync.message):
            if counter_of(frames[k]["data"]) == counter:
                begin = k
            else:
                others += 1
    return max(heard, begin) if others else heard


@compiled
def _start_unsynchronised(
    frames: FrameArray, roles: Integers, begin: int, start: int, last: int, sync: MessageSignals
) -> int:
    """Return the end of the frames that the firmware received in a step before its first SYNC.

    The firmware adopts the epoch of the first SYNC, so its commands carry that epoch. If they do
    not, the SYNC came too late for the step even though it precedes the answer in the log.
    """
    counter = counter_of(frames[last]["data"])
    for n in range(begin, start):
        if roles[n] != _SYNC or not crc_holds(frames[n], sync.message):
            continue
        if counter_of(frames[n]["data"]) != counter:
            return n
        for k in range(last + 1, len(frames)):  # the firmware's own count happened to match
            if roles[k] == _OUTER_COMMAND:
                return n if counter_of(frames[k]["data"]) == counter else start
        return start
    return start


@compiled
def _is_last(frames: FrameArray, roles: Integers, k: int) -> bool:
    """Return whether a frame is the last of its step.

    If the outer-axis command is lost, the inner-axis command is the last one, provided that a
    hardware frame follows and the outer-axis command does not arrive late.
    """
    if roles[k] != _INNER_COMMAND:
        return bool(roles[k] == _OUTER_COMMAND)
    if k + 1 == len(frames) or not _HARDWARE <= roles[k + 1] <= _SYNC:
        return False
    for n in range(k + 1, len(frames)):
        if roles[n] == _INNER_COMMAND:
            return True
        if roles[n] == _OUTER_COMMAND:
            return bool(counter_of(frames[n]["data"]) != counter_of(frames[k]["data"]))
    return False  # undecided so far


@compiled
def steps_by_firmware(
    frames: FrameArray,
    roles: Integers,
    contracts: Records[Contract],
    messages: Records[MessageLayout],
    states: Records[StepState],
    step: Integers,
    epochs: Integers,
) -> tuple[int, int]:
    """Assign each frame to its step, up to the last step that the firmware has closed.

    Returns the number of frames assigned and the number of steps closed.
    """
    contract, state = contracts[0], states[0]
    begin = 0
    closed = 0
    for k in range(len(frames)):
        if roles[k] < _INNER_COMMAND or not _is_last(frames, roles, k):
            continue
        if closed + _AHEAD + 1 > len(epochs):
            break
        start = _start_of_run(roles, begin, k)
        if state.begun == 0:
            begin = _first_heard(frames, roles, start, k, contract.sync)
            state.begun = 1
        end = start
        if state.synchronised == 0:
            start = _start_unsynchronised(frames, roles, begin, start, k, contract.sync)
        _follow_syncs(state, frames, roles, begin, start, contract.sync)
        lost = _lost_steps(state, frames[k], messages[frames[k].can_id])
        for n in range(begin, k + 1):
            if roles[n] >= _FIRMWARE:
                step[n] = state.step + lost
            else:
                step[n] = state.step if n < start else state.step + lost + 1
        for _ in range(lost + 1):
            state.epoch += 1
            state.sync_seen = 0
            if state.far_epoch > 0:
                state.far_epoch += 1
            epochs[closed] = state.epoch if state.synchronised else NO_EPOCH
            closed += 1
        _follow_syncs(state, frames, roles, start, end, contract.sync)  # for the next step
        state.step += lost + 1
        begin = k + 1
    return begin, closed


@compiled
def steps_by_hardware(
    frames: FrameArray,
    roles: Integers,
    contracts: Records[Contract],
    messages: Records[MessageLayout],
    states: Records[StepState],
    step: Integers,
    epochs: Integers,
) -> tuple[int, int]:
    """Assign frames to steps in a log without firmware frames; see `steps_by_firmware`."""
    contract, state = contracts[0], states[0]
    begin = 0
    closed = 0
    for k in range(len(frames)):
        frame = frames[k]
        is_sync = roles[k] == _SYNC
        if not _EVERY_EPOCH <= roles[k] <= _SYNC or not crc_holds(frame, messages[frame.can_id]):
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
            # If SYNC is missing, other frames before the sensors belong to the new epoch, too.
            while not is_sync and begin > 0 and not _EVERY_EPOCH <= roles[begin - 1] <= _SYNC:
                begin -= 1
                step[begin] = state.step
        state.seen[frame.can_id] = 1
        step[k] = state.step if state.begun else NO_STEP
    return begin, closed


@compiled
def _by_sync(frames: FrameArray, contracts: Records[Contract], epoch: int, out: Integers) -> int:
    sync = contracts[0].sync
    for k in range(len(frames)):
        frame = frames[k]
        if frame.can_id == sync.message.can_id and crc_holds(frame, sync.message):
            found = _sync_epoch(frame, sync, epoch, epoch != NO_EPOCH)
            if found > epoch or epoch - found > ADOPT_BEYOND:
                epoch = found
        out[k] = epoch
    return epoch


def epochs_by_sync(frames: FrameArray, epoch: int, out: Integers) -> int:
    """Write the epoch opened by the last SYNC up to each frame; return the last epoch.

    `epoch` is that of the preceding frame, `NO_EPOCH` if there was no SYNC yet.
    """
    return int(_by_sync(frames, load_contract(), epoch, out))
