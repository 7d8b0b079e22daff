"""The value of a hardware fault: name, unit and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rrins.host_tools.hardware.faults import HardwareFault
from rrins.host_tools.hardware.units import ARCSEC, DEG_PER_SQRT_H, DPH, PPM, UG


@dataclass(frozen=True)
class FaultValue:
    """The value of a kind of fault.

    Attributes
    ----------
    key : str
        Its name in a scenario, with the unit.
    unit : float
        That unit in the unit of `rrins.host_tools.hardware.faults`.
    minimum, maximum : float
        In the unit of the key.
    """

    key: str
    unit: float
    minimum: float
    maximum: float


_SCALE = FaultValue("scale_ppm", PPM, -1e6, 1e6)
_SHIFT = FaultValue("shift_arcsec", ARCSEC, -3600, 3600)

VALUES = {
    HardwareFault.AXIS_RUNAWAY: FaultValue("rate_dps", math.radians(1), -60, 60),
    HardwareFault.ENCODER_OFFSET: FaultValue("offset_deg", 1.0, -180, 180),
    HardwareFault.ENCODER_SLIP: FaultValue("slip_percent", 0.01, -100, 100),
    HardwareFault.ODOMETER_SLIP: FaultValue("slip_percent", 0.01, -100, 1000),
    HardwareFault.GNSS_JUMP: FaultValue("jump_m", 1.0, -1e5, 1e5),
    HardwareFault.GNSS_PULL: FaultValue("pull_mps", 1.0, -100, 100),
    HardwareFault.GYRO_BIAS: FaultValue("bias_dph", DPH, -1e6, 1e6),
    HardwareFault.GYRO_NOISE: FaultValue(
        "angle_random_walk_deg_per_sqrt_h", DEG_PER_SQRT_H, 0, 1e4
    ),
    HardwareFault.ACCELEROMETER_BIAS: FaultValue("bias_ug", UG, -1e7, 1e7),
    HardwareFault.ACCELEROMETER_NOISE: FaultValue("white_noise_ug_per_sqrt_hz", UG, 0, 1e6),
    HardwareFault.GYRO_RAMP: FaultValue("bias_dph_per_min", DPH / 60, -1e6, 1e6),
    HardwareFault.GYRO_SCALE: _SCALE,
    HardwareFault.GYRO_SHIFT_U: _SHIFT,
    HardwareFault.GYRO_SHIFT_V: _SHIFT,
    HardwareFault.ACCELEROMETER_RAMP: FaultValue("bias_ug_per_min", UG / 60, -1e7, 1e7),
    HardwareFault.ACCELEROMETER_SCALE: _SCALE,
    HardwareFault.ACCELEROMETER_SHIFT_U: _SHIFT,
    HardwareFault.ACCELEROMETER_SHIFT_V: _SHIFT,
}
"""The kinds that have a value."""
