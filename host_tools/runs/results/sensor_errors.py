"""Sensor errors in the results of a run: key, size and label of each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from rrins.firmware_py.core.sensors.calibration import ARCSEC, DPH, PPM, UG
from rrins.host_tools.files import JsonObject


class SensorError(NamedTuple):
    """An error of a sensor."""

    key: str  #: as a scenario names it; the unit behind its last underscore
    size: float  #: of the unit, SI
    label: str  #: in pictures
    unit: str  #: in pictures


KINDS = {
    "gyros": SensorError("bias_dph", DPH, "bias", "°/h"),
    "accelerometers": SensorError("bias_ug", UG, "bias", "µg"),
}
"""The bias of each kind of sensors."""

CONSTANTS = (
    SensorError("scale_error_ppm", PPM, "scale factor λ", "ppm"),
    SensorError("asymmetric_scale_error_ppm", PPM, "asymmetry μ", "ppm"),
    SensorError("installation_u_arcsec", ARCSEC, "installation δu", "″"),
    SensorError("installation_v_arcsec", ARCSEC, "installation δv", "″"),
)
"""Errors of a sensor that may be estimated besides its bias, in the order of
`rrins.firmware_py.core.records.estimator_records.SCALE_FACTOR` and those after it."""

Estimated = tuple[SensorError, list[float], list[float], list[float] | None]
"""An error, its estimates and their sigmas by sensor, and the true values where they are known."""


def estimated(name: str, kind: JsonObject) -> Iterator[Estimated]:
    """Yield what was estimated of the sensors of a kind.

    Parameters
    ----------
    name : str
        Of `KINDS`.
    kind : dict
        Of the key `estimator.sensors` of a summary.
    """
    key = KINDS[name].key
    yield KINDS[name], kind[key], kind[f"sigma{key[4:]}"], kind[f"true_{key}"]
    for error in CONSTANTS:
        if kind["constants"] is not None:
            found = kind["constants"][error.key]
            yield error, found["estimated"], found["sigma"], found["true"]
