"""Injection of hardware faults at run time: commands in, reports out.

A report is sent in answer to each command, when a fault begins or ends, and cyclically while there
are faults; see `rrins.host_tools.hardware.fault_protocol`.
"""

from __future__ import annotations

from collections.abc import Mapping

from rrins.dbc.decimals import from_decimal, to_decimal
from rrins.dbc.frame import FrameArray
from rrins.dbc.values import FaultAction, FaultRefusal
from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault, Part
from rrins.host_tools.hardware.fault_protocol import ANSWERS, ActiveFault, FaultServer, largest_of
from rrins.host_tools.hardware.faults import ALWAYS, NEVER, cycle_of, put, remove
from rrins.host_tools.hardware.memory import FAULT_CAPACITY, Plant

REPORT_CAPACITY = 3 * FAULT_CAPACITY + ANSWERS
"""Number of frames in the longest report."""

_NS_PER_S = 1_000_000_000


class HardwareFaultServer(FaultServer):
    """Injects faults into running hardware, removes them, and reports which are active.

    Parameters
    ----------
    plant : Plant
        Its faults are changed in place.
    """

    def __init__(self, plant: Plant) -> None:
        super().__init__("hardware_fault", int(plant.period_ns))
        self._plant = plant
        self._faults = plant.faults
        self._cycles: dict[tuple[int, int], tuple[int, int]] = {}
        self._due = self._next_change(-1)

    def inject(
        self,
        kind: int,
        target: int,
        value: float = 0.0,
        duration_epochs: int = 0,
        cycle: tuple[int, int] = ALWAYS,
    ) -> FaultRefusal:
        """Inject a fault that begins in the next epoch.

        Parameters
        ----------
        kind : int
            A `HardwareFault`.
        target : int
            Index of an axis, a sensor or a direction; `EVERY` for all sensors of the kind, and for
            what is one thing.
        value : float
            In the unit used in scenarios.
        duration_epochs : int
            0 if it lasts until removed.
        cycle : tuple of int
            Of an intermittent fault, as `rrins.host_tools.hardware.faults.cycle_of` returns it.

        Returns
        -------
        FaultRefusal
            NONE if the fault was injected; it replaces one of the same kind and target.
        """
        refusal = self._refusal_of_target(kind, target)
        if refusal == FaultRefusal.NONE:
            refusal = self._refusal_of_value(kind, value)
        if refusal != FaultRefusal.NONE:
            return refusal
        epoch = int(self._plant.epoch)
        for k in self._active_rows(epoch):
            if (self._faults.kind[k], self._faults.target[k]) == (kind, target):
                self._faults.last_epoch[k] = epoch - 1
        last = epoch + duration_epochs - 1 if duration_epochs else -1
        parameter = HardwareFault(kind).parameter
        si = 0.0 if parameter is None else value * parameter.si
        self._due = 0
        if put(self._plant, kind, target, epoch, last, si, cycle):
            return FaultRefusal.NONE
        return FaultRefusal.NO_ROOM

    def _refusal_of_target(self, kind: int, target: int) -> FaultRefusal:
        if kind not in set(HardwareFault):
            return FaultRefusal.UNKNOWN
        part, key = HardwareFault(kind).part, HardwareFault(kind).target
        plant = self._plant
        sensors = {Part.GYRO: plant.gyros, Part.ACCELEROMETER: plant.accelerometers}.get(part)
        if sensors is not None:
            is_there = EVERY <= target < sensors.count
        else:
            is_fitted = not part.aid or bool(getattr(plant, part.aid).fitted)
            is_there = is_fitted and target in (range(len(key.names)) if key else (EVERY,))
        return FaultRefusal.NONE if is_there else FaultRefusal.NO_SUCH_TARGET

    @staticmethod
    def _refusal_of_value(kind: int, value: float) -> FaultRefusal:
        limits = HardwareFault(kind).parameter
        is_possible = limits is None or limits.minimum <= value <= limits.maximum
        return FaultRefusal.NONE if is_possible else FaultRefusal.OUT_OF_RANGE

    def remove(self, kind: int, target: int) -> FaultRefusal:
        """Remove the faults of a kind and target, including planned ones."""
        self._due = 0
        return FaultRefusal.NONE if remove(self._plant, kind, target) else FaultRefusal.NOT_ACTIVE

    def clear(self) -> None:
        """Remove all faults, including planned ones."""
        self._due = 0
        remove(self._plant)

    def receive(self, frames: FrameArray, count: int) -> None:
        """Execute the commands among the received frames."""
        wrong = self._take_commands(frames, count, self._obey)
        if wrong:
            self._plant.counters.crc_errors += wrong

    def _obey(self, raws: Mapping[str, int]) -> FaultRefusal:
        action, kind, target = raws["action"], raws["kind"], raws["target"] - 1
        if action == FaultAction.INJECT:
            value = from_decimal(raws["value"], raws["exponent"])
            duration_ms = raws["duration_ms"]
            epochs = self._epochs(duration_ms) if duration_ms else 0
            cycle = self._cycles.pop((kind, target), ALWAYS)
            return self.inject(kind, target, value, epochs, cycle)
        if action == FaultAction.CYCLE:
            duty = from_decimal(raws["value"], raws["exponent"])
            return self._keep_cycle(kind, target, raws["duration_ms"] / 1000, duty)
        if action == FaultAction.REMOVE:
            return self.remove(kind, target)
        if action == FaultAction.CLEAR:
            self.clear()
        elif action != FaultAction.REPORT:
            return FaultRefusal.UNKNOWN
        return FaultRefusal.NONE

    def _keep_cycle(self, kind: int, target: int, period_s: float, duty: float) -> FaultRefusal:
        """Keep the cycle for the next injection of a fault."""
        refusal = self._refusal_of_target(kind, target)
        if refusal != FaultRefusal.NONE:
            return refusal
        if not (period_s > 0 and 0 < duty < 1):
            return FaultRefusal.OUT_OF_RANGE
        self._cycles[kind, target] = cycle_of(period_s, duty, self._period_ns)
        return FaultRefusal.NONE

    def _active_rows(self, epoch: int) -> list[int]:
        faults = self._faults
        return [
            k for k in range(faults.count) if faults.first_epoch[k] <= epoch <= faults.last_epoch[k]
        ]

    def _next_change(self, epoch: int) -> int:
        """Return the first epoch after `epoch` in which a fault begins or ends."""
        faults = self._faults
        changes = [NEVER]
        for k in range(faults.count):
            first, last = int(faults.first_epoch[k]), int(faults.last_epoch[k])
            changes += [at for at in (first, last + 1) if at > epoch and first <= last]
        return min(changes)

    @property
    def report_epoch(self) -> int:
        """The first epoch in which `report` has something to say."""
        return 0 if self._answers else self._due

    def report(self, epoch: int, frames: FrameArray, count: int) -> int:
        """Append a report to the first `count` frames of an epoch, if one is due.

        Returns the new count.
        """
        if epoch < self._due and not self._answers:
            return count
        rows = self._active_rows(epoch)
        self._due = self._next_change(epoch)
        if rows:
            self._due = min(self._due, epoch + self._cycle_epochs)
        active = [self._told(row) for row in rows]
        rate = _NS_PER_S // self._period_ns
        return self._append_report(frames, count, active, epoch=epoch, rate=rate)

    def _told(self, row: int) -> ActiveFault:
        faults = self._faults
        kind = HardwareFault(int(faults.kind[row]))
        digits, exponent = 0, 0
        if kind.parameter is not None:
            value = float(faults.value[row]) / kind.parameter.si
            digits, exponent = to_decimal(value, self._active.value, self._active.exponent)
        period, on = int(faults.period_epochs[row]), int(faults.on_epochs[row])
        raws = {
            "kind": int(kind),
            "target": int(faults.target[row]) + 1,
            "exponent": exponent,
            "value": digits,
            "intermittent": int(period > 0),
        }
        cycle = {}
        if period > 0:
            longest = largest_of(self._cycle, "period_ms")
            cycle = {
                "period_ms": min(longest, self._milliseconds(period)),
                "on_ms": min(longest, self._milliseconds(on)),
            }
        last = int(faults.last_epoch[row])
        is_for_ever = last >= NEVER - 1
        return ActiveFault(raws, int(faults.first_epoch[row]), None if is_for_ever else last, cycle)
