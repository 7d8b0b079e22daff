"""Parameters that a tool can change while the computer runs: fields of the RAM image, and limits.

A step reads them in every epoch. Limits are checked at each write, for a step trusts them.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

from rrins.firmware_py.xcp.layout import MemoryField, by_path


@dataclass(frozen=True)
class Characteristic:
    """A field that can be written, and the limits of each of its numbers."""

    path: str
    minimum: float
    maximum: float

    @property
    def field(self) -> MemoryField:
        """Its place in the RAM image."""
        return by_path()[self.path]


_MOST_EPOCHS = 86_400_000  # a day at the highest rate
_BIAS_INCREMENT = 0.05  # rad or m/s in an epoch: 2.5 rad/s, 2.5 m/s² at the lowest rate
_SCALE_ERROR = 0.1

CHARACTERISTICS = (
    Characteristic("parameters.latitude", -math.radians(89.9), math.radians(89.9)),
    Characteristic("parameters.longitude", -math.pi, math.pi),
    Characteristic("parameters.height", -1000.0, 100_000.0),
    Characteristic("parameters.alignment_epochs", 1, _MOST_EPOCHS),
    Characteristic("parameters.bridge_epochs", 0, 10_000),
    Characteristic("parameters.turn_rate_dps", 0.01, 60.0),
    Characteristic("parameters.isolation_rate_dps", 0.01, 60.0),
    Characteristic("parameters.follow_tolerance_deg", 0.001, 180.0),
    Characteristic("parameters.axis_silence_epochs", 1, 60_000),
    Characteristic("parameters.gyro_consistency", 1e-12, 1.0),
    Characteristic("parameters.accelerometer_consistency", 1e-12, 100.0),
    *(
        Characteristic(f"{sensors}.{name}", -limit, limit)
        for sensors in ("gyros", "accelerometers")
        for name, limit in (
            ("bias_increment", _BIAS_INCREMENT),
            ("scale_error", _SCALE_ERROR),
            ("asymmetric_scale_error", _SCALE_ERROR),
        )
    ),
    Characteristic("gyros.calibrated", 0, 1),
    Characteristic("accelerometers.calibrated", 0, 1),
)
"""All parameters that can be changed."""

SEGMENTS = ("parameters", "gyros", "accelerometers")
"""Records of the RAM image that have such fields: the memory segments, by number."""


@functools.cache
def by_segment(segment: str) -> tuple[Characteristic, ...]:
    """Return the parameters in a segment."""
    return tuple(one for one in CHARACTERISTICS if one.path.partition(".")[0] == segment)
