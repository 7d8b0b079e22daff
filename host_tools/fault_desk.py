"""Where faults are put on the wire of a run under way: commands in, reports out.

A FAULT_COMMAND acts from the next epoch on. A report is a FAULT_ACTIVE and a FAULT_TIMES for each
active fault, then a FAULT_STATUS. It comes in answer to each command, when a fault begins or ends,
and every cycle while there are any. Neither commands nor reports pass the wire themselves.
"""

from __future__ import annotations

from typing import Any

from dbc.codec import to_raw, unpack
from dbc.contract import load_contract
from dbc.e2e import counter_of, crc_holds, fill
from dbc.frame import FrameArray
from dbc.values import UNASKED, FaultAction, FaultRefusal
from host_tools.faults import ANY_IDENTIFIER, MOST_BABBLE, Fault, FaultKind, Faults, Node
from host_tools.hardware.fault_desk import ANSWERS, packed

SHARE_STEPS = 10_000
"""The parameter of the action SHARE that means all frames."""

_NS_PER_MS = 1_000_000
_MOST_IDENTIFIERS = 2048
_BITS = 64

_Frames = tuple[FaultKind, Node, int]


class FaultDesk:
    """Puts faults on a wire, takes them off, and tells which are active.

    Parameters
    ----------
    faults : Faults
    period_ns : int
        Length of an epoch.
    """

    def __init__(self, faults: Faults, period_ns: int) -> None:
        contract = load_contract()[0]
        self._faults = faults
        self._period_ns = period_ns
        self._command = contract["fault_command"]
        self._command_id = int(self._command["message"]["can_id"])
        self._active = contract["fault_active"]
        self._times = contract["fault_times"]
        self._status = contract["fault_status"]
        cycle_ns = int(self._status["message"]["cycle_ms"]) * _NS_PER_MS
        self._cycle_epochs = max(1, cycle_ns // period_ns)
        self._sent = {"active": 0, "times": 0, "status": 0}
        self._answers: list[tuple[int, FaultRefusal]] = []
        self._shares: dict[_Frames, float] = {}
        self._reported: list[Fault] = []
        self._due = 0

    @property
    def is_awake(self) -> bool:
        """Whether there is something to report, even though no fault acts now."""
        return bool(self._answers or self._reported)

    def take(self, frames: FrameArray, count: int, epoch: int) -> None:
        """Obey the commands among the frames that came in an epoch."""
        if self._command_id not in frames["can_id"][:count].tolist():
            return
        for k in range(count):
            frame = frames[k]
            if frame["can_id"] == self._command_id and crc_holds(frame, self._command["message"]):
                refusal = self._obey(frame["data"], epoch + 1)
                self._answers.append((int(counter_of(frame["data"])), refusal))

    def _obey(self, word: Any, epoch: int) -> FaultRefusal:
        values = {
            name: int(unpack(word, self._command[name]))
            for name in ("action", "kind", "node", "identifier", "duration_ms", "parameter")
        }
        try:
            action = FaultAction(values["action"])
        except ValueError:
            return FaultRefusal.UNKNOWN
        if action == FaultAction.CLEAR:
            self._faults.clear()
            return FaultRefusal.NONE
        if action == FaultAction.REPORT:
            return FaultRefusal.NONE
        return self._obey_on_frames(action, values, epoch)

    def _obey_on_frames(
        self, action: FaultAction, values: dict[str, int], epoch: int
    ) -> FaultRefusal:
        try:
            kind = FaultKind(values["kind"])
        except ValueError:
            return FaultRefusal.UNKNOWN
        if kind == FaultKind.NONE or action == FaultAction.NONE:
            return FaultRefusal.UNKNOWN
        identifier, parameter = values["identifier"], values["parameter"]
        is_there = identifier < _MOST_IDENTIFIERS or identifier == ANY_IDENTIFIER
        if values["node"] not in set(Node) or not is_there:
            return FaultRefusal.NO_SUCH_TARGET
        meant = (kind, Node(values["node"]), identifier)
        if action == FaultAction.REMOVE:
            return self.remove(*meant, epoch)
        if action == FaultAction.SHARE:
            if not 1 <= parameter <= SHARE_STEPS:
                return FaultRefusal.OUT_OF_RANGE
            self._shares[meant] = parameter / SHARE_STEPS
            return FaultRefusal.NONE
        return self._obey_inject(meant, parameter, values["duration_ms"], epoch)

    def _obey_inject(
        self, meant: _Frames, parameter: int, duration_ms: int, epoch: int
    ) -> FaultRefusal:
        probability = self._shares.pop(meant, 1.0)
        kind = meant[0]
        if kind == FaultKind.DELAY:
            parameter = max(1, self._epochs(parameter))
        elif kind == FaultKind.BABBLE:
            if parameter > MOST_BABBLE:
                return FaultRefusal.OUT_OF_RANGE
            parameter = max(1, parameter)
        elif kind == FaultKind.CORRUPT:
            if parameter > _BITS:
                return FaultRefusal.OUT_OF_RANGE
        else:
            parameter = 0
        last = epoch + max(1, self._epochs(duration_ms)) - 1 if duration_ms else -1
        return self.inject(Fault(*meant, epoch, last, probability, parameter))

    def inject(self, fault: Fault) -> FaultRefusal:
        """Put in a fault that begins at once; it takes the place of the same one."""
        return FaultRefusal.NONE if self._faults.renew(fault) else FaultRefusal.NO_ROOM

    def remove(self, kind: FaultKind, node: Node, identifier: int, epoch: int) -> FaultRefusal:
        """Take out the faults of a kind on certain frames, those that are still to come, too."""
        ended = self._faults.remove(kind, node, identifier, epoch)
        return FaultRefusal.NONE if ended else FaultRefusal.NOT_ACTIVE

    def _epochs(self, milliseconds: int) -> int:
        return round(milliseconds * _NS_PER_MS / self._period_ns)

    def report(self, active: list[Fault], epoch: int, frames: FrameArray, count: int) -> int:
        """Append a report to the first `count` frames of an epoch, if one is due.

        Returns the new count. `active` are the faults that act in the epoch.
        """
        changed = active != self._reported
        if not changed and not self._answers and not (active and epoch >= self._due):
            return count
        answers = self._answers[:ANSWERS] or [(UNASKED, FaultRefusal.NONE)]
        self._answers.clear()
        self._reported = active
        self._due = epoch + self._cycle_epochs
        if count + 2 * len(active) + len(answers) > len(frames):
            return count
        for number, fault in enumerate(active):
            self._put(frames[count], "active", self._active, self._active_word(number, fault))
            self._put(frames[count + 1], "times", self._times, self._times_word(number, fault))
            count += 2
        for counter, refusal in answers:
            word = self._status_word(active, refusal, counter)
            self._put(frames[count], "status", self._status, word)
            count += 1
        return count

    def _put(self, frame: Any, name: str, message: Any, word: Any) -> None:
        fill(frame, message["message"], word, self._sent[name])
        self._sent[name] += 1

    def _active_word(self, number: int, fault: Fault) -> Any:
        parameter = fault.parameter
        if fault.kind == FaultKind.DELAY:
            longest = int(self._active["parameter"]["raw_maximum"])
            parameter = min(longest, round(parameter * self._period_ns / _NS_PER_MS))
        return packed(
            self._active,
            number=number,
            kind=fault.kind,
            node=fault.node,
            identifier=fault.identifier,
            parameter=parameter,
            probability=max(1, to_raw(fault.probability, self._active["probability"])),
        )

    def _times_word(self, number: int, fault: Fault) -> Any:
        duration_ms = 0
        if fault.last_epoch >= 0:
            epochs = fault.last_epoch + 1 - fault.first_epoch
            longest = int(self._times["duration_ms"]["raw_maximum"])
            duration_ms = min(longest, round(epochs * self._period_ns / _NS_PER_MS))
        return packed(
            self._times, number=number, first_epoch=fault.first_epoch, duration_ms=duration_ms
        )

    def _status_word(self, active: list[Fault], refusal: FaultRefusal, answers: int) -> Any:
        kinds = 0
        for fault in active:
            kinds |= 1 << fault.kind
        affected = min(
            int(self._status["affected_frames"]["raw_maximum"]), self._faults.affected_frames
        )
        return packed(
            self._status,
            active_kinds=kinds,
            active_faults=len(active),
            refusal=refusal,
            answers=answers,
            affected_frames=affected,
        )
