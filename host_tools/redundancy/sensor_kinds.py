"""The two kinds of sensors: their names, units and faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from rrins.host_tools.hardware.fault_kinds import HardwareFault
from rrins.host_tools.hardware.units import DPH, UG


@dataclass(frozen=True)
class Kind:
    """A kind of sensors."""

    name: str  #: in the RAM image and in scenarios
    unit: str  #: of a fault
    si: float  #: that unit, rad/s or m/s²
    fault: HardwareFault  #: a step of the bias

    @property
    def one(self) -> str:
        """A single sensor of the kind."""
        return self.name.removesuffix("s")

    def parity(self, state: Any) -> Any:
        """Return the parity of the kind, of a firmware's RAM image."""
        return state.redundancy[self.name]

    def fusion(self, state: Any) -> Any:
        """Return the fusion of the kind, of a firmware's RAM image."""
        return state[self.name]


KINDS: Final = (
    Kind("gyros", "°/h", DPH, HardwareFault.GYRO_BIAS),
    Kind("accelerometers", "µg", UG, HardwareFault.ACCELEROMETER_BIAS),
)
