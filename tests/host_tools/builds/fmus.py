"""The FMUs of a build, coupled in FMPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from rrins.firmware_py.core.records.memory import NavigationOutput

_BYTES = "base.lo", "base.hi", "size"
_NAVIGATION = [
    f"{member.name}[{k + 1}]" if member.shape else member.name
    for member in NavigationOutput.members()
    for k in range(member.shape[0] if member.shape else 1)
]


class Unit:
    """An FMU, set up with values for some of its parameters."""

    def __init__(self, path: Path, folder: Path, parameters: Mapping[str, float]) -> None:
        described = fmpy.read_model_description(str(path))
        self._is_3 = described.fmiVersion.startswith("3")
        self._variables = {v.name: v for v in described.modelVariables}
        self._period_s = float(described.defaultExperiment.stepSize)
        self._steps = 0
        kind = FMU3Slave if self._is_3 else FMU2Slave
        self._unit: Any = kind(
            guid=described.guid,
            unzipDirectory=fmpy.extract(str(path), str(folder / path.stem)),
            modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self._unit.instantiate()
        if not self._is_3:
            self._unit.setupExperiment(startTime=0.0)
        for name, value in parameters.items():
            self._call("set", [name], [value])
        self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()
        self.save, self.restore = (
            (self._unit.getFMUState, self._unit.setFMUState)
            if self._is_3
            else (self._unit.getFMUstate, self._unit.setFMUstate)
        )

    def step(self) -> None:
        self._unit.doStep(self._steps * self._period_s, self._period_s)
        self._steps += 1

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the values of variables of one type."""
        return list(self._call("get", names))

    def frames(self) -> Any:
        """Return the frames of the last step, as `receive` takes them."""
        return self._call("get", self._bytes("can.Tx_Data"))

    def receive(self, frames: Any) -> None:
        self._call("set", self._bytes("can.Rx_Data"), frames)

    def _bytes(self, name: str) -> list[str]:
        return [name] if self._is_3 else [f"{name}.{part}" for part in _BYTES]

    def _call(self, what: str, names: Sequence[str], *values: Any) -> Any:
        variables = [self._variables[name] for name in names]
        function = getattr(self._unit, what + variables[0].type)
        return function([v.valueReference for v in variables], *values)


class Coupled:
    """Hardware and firmware; parallel: each gets what the other sent in the step before."""

    def __init__(
        self,
        fmus: Mapping[str, Path],
        version: int,
        folder: Path,
        is_parallel: bool = False,
        hardware: Mapping[str, float] | None = None,
    ) -> None:
        self._hardware = Unit(fmus[f"hardware.fmi{version}"], folder, hardware or {})
        self._firmware = Unit(fmus[f"firmware.fmi{version}"], folder, {})
        self._is_parallel = is_parallel
        self._last = 0.0

    def run(self, epochs: int) -> np.ndarray[Any, Any]:
        """Return the navigation of those of the next epochs that were navigated."""
        rows = NavigationOutput.zeros(epochs)
        count = 0
        for _ in range(epochs + self._is_parallel):
            self._hardware.step()
            up = self._hardware.frames()
            if not self._is_parallel:
                self._firmware.receive(up)
            self._firmware.step()
            self._hardware.receive(self._firmware.frames())
            if self._is_parallel:
                self._firmware.receive(up)
            integers, numbers = (
                self._firmware.get([f"navigation.{name}" for name in names])
                for names in (_NAVIGATION[:2], _NAVIGATION[2:])
            )
            if integers[0] != self._last:
                self._last = integers[0]
                velocity, attitude = numbers[3:6], numbers[6:]
                rows[count] = (*integers, *numbers[:3], velocity, *attitude)
                count += 1
        return rows[:count]

    def save(self) -> tuple[Any, Any, float]:
        return self._hardware.save(), self._firmware.save(), self._last

    def restore(self, state: tuple[Any, Any, float]) -> None:
        self._hardware.restore(state[0])
        self._firmware.restore(state[1])
        self._last = state[2]
