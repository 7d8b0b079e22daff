"""Injection of wire faults at run time: commands in, reports out.

A report is sent in answer to each command, when a fault begins or ends, and cyclically while there
are faults; see `rrins.host_tools.hardware.fault_protocol`. Neither commands nor reports pass
the wire themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from rrins.dbc.codec import to_raw
from rrins.dbc.frame import FrameArray
from rrins.dbc.values import FaultAction, FaultRefusal
from rrins.host_tools.hardware.fault_protocol import ActiveFault, FaultServer, largest_of
from rrins.host_tools.hardware.faults import NEVER
from rrins.host_tools.wire.effects import ANY_IDENTIFIER, Node
from rrins.host_tools.wire.fault_kinds import FaultKind
from rrins.host_tools.wire.faults import WireFault, WireFaults

SHARE_STEPS = 10_000
"""The parameter of the action SHARE that means all frames."""

_MOST_IDENTIFIERS = 2048

_Frames = tuple[FaultKind, Node, int]


class WireFaultServer(FaultServer):
    """Injects faults on a wire, removes them, and reports which are active.

    Parameters
    ----------
    faults : WireFaults
    period_ns : int
        Length of an epoch.
    """

    def __init__(self, faults: WireFaults, period_ns: int) -> None:
        super().__init__("fault", period_ns)
        self._faults = faults
        self._shares: dict[_Frames, float] = {}
        self._reported: list[WireFault] = []
        self._due = 0

    @property
    def is_awake(self) -> bool:
        """Whether there is something to report, even though no fault acts now."""
        return bool(self._answers or self._reported)

    def quiet_until(self, epoch: int, active: list[WireFault]) -> int:
        """Return the epoch in which a report is due, as long as the same faults act."""
        if self._answers or active != self._reported:
            return epoch
        return self._due if active else NEVER

    def receive(self, frames: FrameArray, count: int, epoch: int) -> None:
        """Execute the commands among the frames received in an epoch."""
        self._take_commands(frames, count, partial(self._obey, epoch=epoch + 1))

    def _obey(self, raws: Mapping[str, int], epoch: int) -> FaultRefusal:
        try:
            action = FaultAction(raws["action"])
        except ValueError:
            return FaultRefusal.UNKNOWN
        if action == FaultAction.CLEAR:
            self._faults.clear()
            return FaultRefusal.NONE
        if action == FaultAction.REPORT:
            return FaultRefusal.NONE
        return self._obey_on_frames(action, raws, epoch)

    def _obey_on_frames(
        self, action: FaultAction, raws: Mapping[str, int], epoch: int
    ) -> FaultRefusal:
        try:
            kind = FaultKind(raws["kind"])
        except ValueError:
            return FaultRefusal.UNKNOWN
        is_out_of_reach = kind == FaultKind.POWER_OFF and not self._faults.can_cut_power
        if action == FaultAction.NONE or is_out_of_reach:
            return FaultRefusal.UNKNOWN
        identifier, parameter = raws["identifier"], raws["parameter"]
        is_there = identifier < _MOST_IDENTIFIERS or identifier == ANY_IDENTIFIER
        if raws["node"] not in set(Node) or not is_there:
            return FaultRefusal.NO_SUCH_TARGET
        meant = (kind, Node(raws["node"]), identifier)
        if action == FaultAction.REMOVE:
            return self.remove(*meant, epoch)
        if action == FaultAction.SHARE:
            if not 1 <= parameter <= SHARE_STEPS:
                return FaultRefusal.OUT_OF_RANGE
            self._shares[meant] = parameter / SHARE_STEPS
            return FaultRefusal.NONE
        return self._obey_inject(meant, parameter, raws["duration_ms"], epoch)

    def _obey_inject(
        self, meant: _Frames, parameter: int, duration_ms: int, epoch: int
    ) -> FaultRefusal:
        probability = self._shares.pop(meant, 1.0)
        limits = meant[0].parameter
        if limits is None:
            parameter = 0
        elif not limits.is_whole:
            parameter = self._epochs(parameter)
        elif parameter > limits.maximum - limits.minimum + 1:
            return FaultRefusal.OUT_OF_RANGE
        last = epoch + self._epochs(duration_ms) - 1 if duration_ms else -1
        return self.inject(WireFault(*meant, epoch, last, probability, parameter))

    def inject(self, fault: WireFault) -> FaultRefusal:
        """Inject a fault that begins at once; it replaces an identical one."""
        return FaultRefusal.NONE if self._faults.renew(fault) else FaultRefusal.NO_ROOM

    def remove(self, kind: FaultKind, node: Node, identifier: int, epoch: int) -> FaultRefusal:
        """Remove the faults of a kind on certain frames, including planned ones."""
        ended = self._faults.remove(kind, node, identifier, epoch)
        return FaultRefusal.NONE if ended else FaultRefusal.NOT_ACTIVE

    def report(self, active: list[WireFault], epoch: int, frames: FrameArray, count: int) -> int:
        """Append a report to the first `count` frames of an epoch, if one is due.

        Returns the new count. `active` are the faults that act in the epoch.
        """
        changed = active != self._reported
        if not changed and not self._answers and not (active and epoch >= self._due):
            return count
        self._reported = active
        self._due = epoch + self._cycle_epochs
        kinds = 0
        for fault in active:
            kinds |= 1 << fault.kind
        return self._append_report(
            frames,
            count,
            [self._told(fault) for fault in active],
            active_kinds=kinds,
            affected_frames=min(
                largest_of(self._status, "affected_frames"), self._faults.affected_frames
            ),
        )

    def _told(self, fault: WireFault) -> ActiveFault:
        parameter = fault.parameter
        if fault.kind.parameter is not None and not fault.kind.parameter.is_whole:
            longest = largest_of(self._active, "parameter")
            parameter = min(longest, self._milliseconds(parameter))
        raws = {
            "kind": int(fault.kind),
            "node": int(fault.node),
            "identifier": fault.identifier,
            "parameter": parameter,
            "probability": max(1, to_raw(fault.probability, self._active.probability)),
        }
        last = fault.last_epoch
        return ActiveFault(raws, fault.first_epoch, None if last < 0 else last)
