"""Protocol for injecting faults of the hardware or the wire into a running simulation.

Messages share a name prefix: a COMMAND takes effect in the next epoch. A report is an ACTIVE and a
TIMES for each active fault, and a CYCLE if it is intermittent, then a STATUS for each command that
it answers, or one for none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rrins.dbc.codec import pack, unpack
from rrins.dbc.contract import MessageSignals, load_contract
from rrins.dbc.e2e import counter_of, crc_holds, fill
from rrins.dbc.frame import FrameArray
from rrins.dbc.values import UNASKED, FaultRefusal

ANSWERS = 15
"""Most commands answered in an epoch; further ones are executed without an answer."""

_NS_PER_MS = 1_000_000


@dataclass(frozen=True)
class ActiveFault:
    """A fault in a report."""

    raws: Mapping[str, int]  #: raw values of the message ACTIVE, all but the number
    first_epoch: int
    last_epoch: int | None  #: None if it lasts until removed
    #: raw values of the message CYCLE, all but the number; empty if it is not intermittent
    cycle: Mapping[str, int] = field(default_factory=dict)


class FaultServer:
    """Receives commands and sends reports; subclasses define the effect of a command.

    Parameters
    ----------
    family : str
        Prefix of the names of the messages, in lower case.
    period_ns : int
        Length of an epoch.
    """

    def __init__(self, family: str, period_ns: int) -> None:
        contract = load_contract()[0]
        self._period_ns = period_ns
        self._command = contract[f"{family}_command"]
        self._command_id = int(self._command.message.can_id)
        self._active = contract[f"{family}_active"]
        self._times = contract[f"{family}_times"]
        self._status = contract[f"{family}_status"]
        self._cycle = contract["hardware_fault_cycle"]
        cycle_ns = int(self._status.message.cycle_ms) * _NS_PER_MS
        self._cycle_epochs = max(1, cycle_ns // period_ns)
        self._faults_sent = 0
        self._statuses_sent = 0
        self._answers: list[tuple[int, FaultRefusal]] = []

    def _take_commands(
        self, frames: FrameArray, count: int, obey: Callable[[Mapping[str, int]], FaultRefusal]
    ) -> int:
        """Execute the commands among the received frames, and answer them.

        `obey` gets the raw values of a command by signal. Returns the number of wrong CRCs.
        """
        identifiers = frames["can_id"][:count].tolist()
        if self._command_id not in identifiers:
            return 0
        wrong = 0
        for k, identifier in enumerate(identifiers):
            if identifier != self._command_id:
                continue
            frame = frames[k]
            if not crc_holds(frame, self._command.message):
                wrong += 1
                continue
            word = frame["data"]
            refusal = obey(unpacked(self._command, word))
            self._answers.append((int(counter_of(word)), refusal))
        return wrong

    def _epochs(self, milliseconds: int) -> int:
        """Return the number of epochs nearest to a time, at least one."""
        return max(1, round(milliseconds * _NS_PER_MS / self._period_ns))

    def _milliseconds(self, epochs: int) -> int:
        return round(epochs * self._period_ns / _NS_PER_MS)

    def _append_report(
        self, frames: FrameArray, count: int, active: Sequence[ActiveFault], **status: int
    ) -> int:
        """Append a report to the first `count` frames, if there is room for all of it.

        `status` holds the raw values of STATUS that only one kind of server has. Returns the new
        count.
        """
        answers = self._answers[:ANSWERS] or [(UNASKED, FaultRefusal.NONE)]
        self._answers.clear()
        intermittent = sum(bool(fault.cycle) for fault in active)
        if count + 2 * len(active) + intermittent + len(answers) > len(frames):
            return count
        for number, fault in enumerate(active):
            word = packed(self._active, number=number, **fault.raws)
            fill(frames[count], self._active.message, word, self._faults_sent)
            word = self._times_word(number, fault)
            fill(frames[count + 1], self._times.message, word, self._faults_sent)
            count += 2
            if fault.cycle:
                word = packed(self._cycle, number=number, **fault.cycle)
                fill(frames[count], self._cycle.message, word, self._faults_sent)
                count += 1
            self._faults_sent += 1
        for counter, refusal in answers:
            word = packed(
                self._status,
                active_faults=len(active),
                refusal=refusal,
                answers=counter,
                **status,
            )
            fill(frames[count], self._status.message, word, self._statuses_sent)
            self._statuses_sent += 1
            count += 1
        return count

    def _times_word(self, number: int, fault: ActiveFault) -> np.uint64:
        duration_ms = 0
        if fault.last_epoch is not None:
            duration_ms = self._milliseconds(fault.last_epoch + 1 - fault.first_epoch)
        return packed(
            self._times,
            number=number,
            first_epoch=fault.first_epoch,
            duration_ms=min(largest_of(self._times, "duration_ms"), duration_ms),
        )


def largest_of(message: MessageSignals, signal: str) -> int:
    """Return the largest raw value that a signal can have."""
    return int(message[signal].raw_maximum)


def unpacked(message: MessageSignals, word: np.uint64) -> dict[str, int]:
    """Return the raw values of all signals in a payload."""
    names = [name for name in message.dtype.names or () if name != "message"]
    return {name: int(unpack(word, message[name])) for name in names}


def packed(message: MessageSignals, **raws: int) -> np.uint64:
    """Return the payload of a message with raw values."""
    word = np.uint64(0)
    for name, raw in raws.items():
        word = np.uint64(pack(word, message[name], np.int64(raw)))
    return word
