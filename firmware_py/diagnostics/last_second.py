"""Values of the table that are what the last second of a history came to."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrins.firmware_py.core.records.estimator_records import PITCH, SCALE, SENSOR_CONSTANTS, YAW
from rrins.firmware_py.core.records.redundancy_records import SensorKind
from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.firmware_py.diagnostics.codecs import Value
from rrins.firmware_py.diagnostics.estimator_identifiers import CONSTANTS
from rrins.firmware_py.diagnostics.reader import view_of

_DEGREE = math.radians(1.0)
_GYROS, _ACCELEROMETERS, _ESTIMATOR = "redundancy.gyros", "redundancy.accelerometers", "estimator"
_MOUNTING = slice(YAW, PITCH + 1)


@dataclass(frozen=True)
class LastSecond:
    """Where a value stands in the RAM image."""

    record: str  #: path of a record with a history
    name: str  #: in the history's rows
    unit: float  #: in SI units; the value in memory is divided by it
    part: int | slice | None = None  #: of an array in a row: that of a kind, or of an error

    def seconds(self, ram: NDArray[np.void]) -> NDArray[Any]:
        """Return the value's view in an array of one memory, by second in the second dimension."""
        seconds: NDArray[Any] = view_of(ram, f"{self.record}.history.{self.name}")
        return seconds if self.part is None else seconds[:, :, self.part]

    def reader(self, ram: NDArray[np.void]) -> Callable[[], Value]:
        """Return what reads it from an array of one memory."""
        count = view_of(ram, f"{self.record}.history_count")
        seconds, unit = self.seconds(ram), self.unit
        capacity = seconds.shape[1]

        def read() -> Value:
            values = (seconds[0, (count.item() - 1) % capacity] / unit).tolist()
            return tuple(values) if isinstance(values, list) else values

        return read


def _constants() -> dict[str, LastSecond]:
    """Return the constants that are estimated of each sensor."""
    found = {}
    for kind in SensorKind:
        for error, (name, unit) in enumerate(CONSTANTS):
            row, whose = SENSOR_CONSTANTS * kind + error, kind.name.lower()
            found[f"{whose}_{name}"] = LastSecond(_ESTIMATOR, "constant", unit, row)
            found[f"{whose}_{name}_sigma"] = LastSecond(_ESTIMATOR, "constant_sigma", unit, row)
    return found


LAST_SECOND = {
    "parity_residual_dph": LastSecond(_GYROS, "residual", DPH),
    "parity_threshold_dph": LastSecond(_GYROS, "threshold", DPH),
    "parity_residual_ug": LastSecond(_ACCELEROMETERS, "residual", UG),
    "parity_threshold_ug": LastSecond(_ACCELEROMETERS, "threshold", UG),
    "attitude_sigma_arcsec": LastSecond(_ESTIMATOR, "attitude_sigma", ARCSEC),
    "velocity_sigma_mps": LastSecond(_ESTIMATOR, "velocity_sigma", 1.0),
    "position_sigma_m": LastSecond(_ESTIMATOR, "position_sigma", 1.0),
    "estimated_bias_dph": LastSecond(_ESTIMATOR, "bias", DPH, SensorKind.GYRO),
    "estimated_bias_sigma_dph": LastSecond(_ESTIMATOR, "bias_sigma", DPH, SensorKind.GYRO),
    "estimated_bias_ug": LastSecond(_ESTIMATOR, "bias", UG, SensorKind.ACCELEROMETER),
    "estimated_bias_sigma_ug": LastSecond(_ESTIMATOR, "bias_sigma", UG, SensorKind.ACCELEROMETER),
    **_constants(),
    "odometer_scale_ppm": LastSecond(_ESTIMATOR, "odometer", PPM, SCALE),
    "odometer_scale_sigma_ppm": LastSecond(_ESTIMATOR, "odometer_sigma", PPM, SCALE),
    "mounting_deg": LastSecond(_ESTIMATOR, "odometer", _DEGREE, _MOUNTING),
    "mounting_sigma_deg": LastSecond(_ESTIMATOR, "odometer_sigma", _DEGREE, _MOUNTING),
    "altimeter_bias_m": LastSecond(_ESTIMATOR, "altimeter_bias", 1.0),
    "altimeter_bias_sigma_m": LastSecond(_ESTIMATOR, "altimeter_bias_sigma", 1.0),
}
"""By the field's name."""
