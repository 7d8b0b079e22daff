"""Where faults of the hardware are put in while it runs: commands in, reports out.

A HARDWARE_FAULT_COMMAND acts from the next epoch on. A report is a HARDWARE_FAULT_ACTIVE and a
HARDWARE_FAULT_TIMES for each active fault, then a HARDWARE_FAULT_STATUS. It comes in answer to each
command, when a fault begins or ends, and every cycle while there are any.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dbc.codec import pack, unpack
from dbc.contract import load_contract
from dbc.decimals import from_decimal, to_decimal
from dbc.e2e import counter_of, crc_holds, fill
from dbc.frame import FrameArray
from dbc.values import UNASKED, FaultAction, FaultRefusal
from host_tools.hardware.fault_values import VALUES
from host_tools.hardware.faults import NEVER, HardwareFault, put, take_out
from host_tools.hardware.memory import FAULT_CAPACITY

ANSWERS = 15
"""Commands that are answered in an epoch; those beyond are obeyed all the same."""

REPORT_CAPACITY = 2 * FAULT_CAPACITY + ANSWERS
"""Frames of the longest report."""

_NS_PER_MS = 1_000_000
_AXES = 2


class FaultDesk:
    """Puts faults into hardware that runs, takes them out, and tells which are active.

    Parameters
    ----------
    plant : record of dtype `host_tools.hardware.memory.PLANT`
        Its faults are changed in place.
    """

    def __init__(self, plant: Any) -> None:
        contract = load_contract()[0]
        self._plant = plant
        self._faults = plant["faults"]
        self._period_ns = int(plant["period_ns"])
        self._command = contract["hardware_fault_command"]
        self._command_id = int(self._command["message"]["can_id"])
        self._active = contract["hardware_fault_active"]
        self._times = contract["hardware_fault_times"]
        self._status = contract["hardware_fault_status"]
        cycle_ns = int(self._status["message"]["cycle_ms"]) * _NS_PER_MS
        self._cycle_epochs = max(1, cycle_ns // self._period_ns)
        self._sent = {"active": 0, "times": 0, "status": 0}
        self._answers: list[tuple[int, FaultRefusal]] = []
        self._due = self._next_change(-1)

    def inject(
        self, kind: int, target: int, value: float = 0.0, duration_epochs: int = 0
    ) -> FaultRefusal:
        """Let something fail from the next epoch on.

        Parameters
        ----------
        kind : int
            A `HardwareFault`.
        target : int
            Index of an axis or a sensor; `EVERY` for all sensors of the kind.
        value : float
            In the unit that a scenario gives it in.
        duration_epochs : int
            0 until it is taken out.

        Returns
        -------
        FaultRefusal
            NONE when the fault is in; it has taken the place of one of that kind and target.
        """
        refusal = self._refusal(kind, target, value)
        if refusal != FaultRefusal.NONE:
            return refusal
        epoch = int(self._plant["epoch"])
        for k in self._active_rows(epoch):
            if (self._faults["kind"][k], self._faults["target"][k]) == (kind, target):
                self._faults["last_epoch"][k] = epoch - 1
        last = epoch + duration_epochs - 1 if duration_epochs else -1
        si = value * VALUES[HardwareFault(kind)].unit if kind in VALUES else 0.0
        self._due = 0
        if put(self._plant, kind, target, epoch, last, si):
            return FaultRefusal.NONE
        return FaultRefusal.NO_ROOM

    def _refusal(self, kind: int, target: int, value: float) -> FaultRefusal:
        if kind not in set(HardwareFault):
            return FaultRefusal.UNKNOWN
        if kind < HardwareFault.GYRO_STUCK:
            is_there = 0 <= target < _AXES
        else:
            of_gyros = kind < HardwareFault.ACCELEROMETER_STUCK
            sensors = self._plant["gyros" if of_gyros else "accelerometers"]
            is_there = -1 <= target < sensors["count"]
        if not is_there:
            return FaultRefusal.NO_SUCH_TARGET
        limits = VALUES.get(HardwareFault(kind))
        if limits is not None and not limits.minimum <= value <= limits.maximum:
            return FaultRefusal.OUT_OF_RANGE
        return FaultRefusal.NONE

    def remove(self, kind: int, target: int) -> FaultRefusal:
        """Take out the faults of a kind and target, those that are still to come, too."""
        self._due = 0
        return FaultRefusal.NONE if take_out(self._plant, kind, target) else FaultRefusal.NOT_ACTIVE

    def clear(self) -> None:
        """Take out all faults, those that are still to come, too."""
        self._due = 0
        take_out(self._plant)

    def take(self, frames: FrameArray, count: int) -> None:
        """Obey the commands among the frames that came."""
        if self._command_id not in frames["can_id"][:count].tolist():
            return
        for k in range(count):
            frame = frames[k]
            if frame["can_id"] != self._command_id:
                continue
            if not crc_holds(frame, self._command["message"]):
                self._plant["counters"]["crc_errors"] += 1
                continue
            refusal = self._obey(frame["data"])
            self._answers.append((int(counter_of(frame["data"])), refusal))

    def _obey(self, word: Any) -> FaultRefusal:
        values = {
            name: int(unpack(word, self._command[name]))
            for name in ("action", "kind", "target", "exponent", "value", "duration_ms")
        }
        action, kind, target = values["action"], values["kind"], values["target"] - 1
        if action == FaultAction.INJECT:
            value = from_decimal(values["value"], values["exponent"])
            return self.inject(kind, target, value, self._epochs(values["duration_ms"]))
        if action == FaultAction.REMOVE:
            return self.remove(kind, target)
        if action == FaultAction.CLEAR:
            self.clear()
        elif action != FaultAction.REPORT:
            return FaultRefusal.UNKNOWN
        return FaultRefusal.NONE

    def _epochs(self, duration_ms: int) -> int:
        if duration_ms == 0:
            return 0
        return max(1, round(duration_ms * _NS_PER_MS / self._period_ns))

    def _active_rows(self, epoch: int) -> list[int]:
        faults = self._faults
        return [
            k
            for k in range(int(faults["count"]))
            if faults["first_epoch"][k] <= epoch <= faults["last_epoch"][k]
        ]

    def _next_change(self, epoch: int) -> int:
        """Return the next epoch, from the one after `epoch` on, in which a fault begins or ends."""
        faults = self._faults
        changes = [NEVER]
        for k in range(int(faults["count"])):
            first, last = int(faults["first_epoch"][k]), int(faults["last_epoch"][k])
            changes += [at for at in (first, last + 1) if at > epoch and first <= last]
        return min(changes)

    def report(self, epoch: int, frames: FrameArray, count: int) -> int:
        """Append a report to the first `count` frames of an epoch, if one is due.

        Returns the new count.
        """
        if epoch < self._due and not self._answers:
            return count
        rows = self._active_rows(epoch)
        answers = self._answers[:ANSWERS] or [(UNASKED, FaultRefusal.NONE)]
        self._answers.clear()
        self._due = self._next_change(epoch)
        if rows:
            self._due = min(self._due, epoch + self._cycle_epochs)
        if count + 2 * len(rows) + len(answers) > len(frames):
            return count
        for number, row in enumerate(rows):
            self._put(frames[count], "active", self._active, self._active_word(number, row))
            self._put(frames[count + 1], "times", self._times, self._times_word(number, row))
            count += 2
        for counter, refusal in answers:
            word = self._status_word(len(rows), refusal, counter, epoch)
            self._put(frames[count], "status", self._status, word)
            count += 1
        return count

    def _put(self, frame: Any, name: str, message: Any, word: Any) -> None:
        fill(frame, message["message"], word, self._sent[name])
        self._sent[name] += 1

    def _active_word(self, number: int, row: int) -> Any:
        message, faults = self._active, self._faults
        kind = HardwareFault(int(faults["kind"][row]))
        digits, exponent = 0, 0
        if kind in VALUES:
            value = float(faults["value"][row]) / VALUES[kind].unit
            digits, exponent = to_decimal(value, message["value"], message["exponent"])
        return packed(
            message,
            number=number,
            kind=kind,
            target=int(faults["target"][row]) + 1,
            exponent=exponent,
            value=digits,
        )

    def _times_word(self, number: int, row: int) -> Any:
        first, last = (int(self._faults[name][row]) for name in ("first_epoch", "last_epoch"))
        duration_ms = 0
        if last < NEVER - 1:
            longest = int(self._times["duration_ms"]["raw_maximum"])
            duration_ms = min(longest, round((last + 1 - first) * self._period_ns / _NS_PER_MS))
        return packed(self._times, number=number, first_epoch=first, duration_ms=duration_ms)

    def _status_word(self, active: int, refusal: FaultRefusal, answers: int, epoch: int) -> Any:
        return packed(
            self._status,
            active_faults=active,
            refusal=refusal,
            answers=answers,
            epoch=epoch,
            rate=1_000_000_000 // self._period_ns,
        )


def packed(message: Any, **raws: int) -> Any:
    """Return the payload of a message with raw values."""
    word = np.uint64(0)
    for name, raw in raws.items():
        word = np.uint64(pack(word, message[name], np.int64(raw)))
    return word
