"""Set-up of the comparison with the calibration: what it allows, and the limit."""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.calibration_records import Drift
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.redundancy.settings import RedundancySettings, factor_of
from rrins.firmware_py.core.sensors.calibration import (
    ARCSEC,
    PPM,
    AccelerometerCalibration,
    Calibration,
    GyroCalibration,
    each,
    input_axes,
    transverse,
)
from rrins.firmware_py.core.sensors.data_sheet import FLICKER_S, DataSheet

_LOOKS_IN_1000_H = 3.6e6 / FLICKER_S
"""How often what was learned is another: as often as a bias has walked by its own size."""

_KINDS = 2
_AxesDeg = tuple[tuple[float, float], ...]


def _beyond(distance: float) -> float:
    """Return the probability of a larger distance of three normal components.

    Chi distribution of three degrees of freedom.
    """
    tail = math.erfc(distance / math.sqrt(2.0))
    density = math.sqrt(2.0 / math.pi) * distance * math.exp(-0.5 * distance**2)
    return tail + density


def limit(allowed: float, directions: int) -> float:
    """Return the distance that is exceeded as rarely as allowed in 1000 h, standard deviations."""
    return factor_of(lambda u: _LOOKS_IN_1000_H * directions * _beyond(u), allowed)


def kind_limit(allowed: float, count: int) -> float:
    """Return the limit of one kind of `count` sensors; `allowed` is that of both."""
    return limit(allowed / _KINDS, max(1, count - 3))


def axis_variances(
    axes_deg: _AxesDeg, sensors: GyroCalibration | AccelerometerCalibration, stability: float
) -> Floats | None:
    """Return the covariance of each sensor's h (1 + λ), shape (m, 3, 3).

    None where it is not known how well one of the sensors was calibrated.

    Parameters
    ----------
    sensors : GyroCalibration or AccelerometerCalibration
    stability : float
        1, standard deviation of what a scale factor changes by, of the data sheet.
    """
    if sensors.sigma is None:
        return None
    count = len(axes_deg)
    scale = each(sensors.sigma.scale_error_ppm, count) * PPM
    du = each(sensors.sigma.installation_u_arcsec, count) * ARCSEC
    dv = each(sensors.sigma.installation_v_arcsec, count) * ARCSEC
    if not (scale.all() and du.all() and dv.all()):
        return None
    h = input_axes(axes_deg)
    u, v = transverse(axes_deg)
    found = np.zeros((count, 3, 3))
    # h' = h - δu v - δv u, paper (13)
    for sigma, along in ((np.hypot(scale, stability), h), (du, v), (dv, u)):
        found += (sigma**2)[:, None, None] * along[:, :, None] * along[:, None, :]
    return found


def _set_drift(
    drift: Drift,
    axes_deg: _AxesDeg,
    sensors: GyroCalibration | AccelerometerCalibration,
    sheet: DataSheet,
    allowed: float,
) -> None:
    found = axis_variances(axes_deg, sensors, sheet.scale_stability)
    if found is None:
        return
    drift["known"] = True
    drift["axis_variance"][: len(found)] = found
    drift["limit"] = kind_limit(allowed, len(found))


def set_up(
    state: Ram,
    calibration: Calibration,
    settings: RedundancySettings,
    axes: tuple[_AxesDeg, _AxesDeg],
) -> None:
    """Set up the comparison; `axes` of gyros and of accelerometers, polar angle and azimuth, °.

    False alarms come as rarely as those of the parity, beside them.
    """
    own = state["calibration"]
    allowed = settings.false_alarms_per_1000_h
    _set_drift(own["gyros"], axes[0], calibration.gyros, settings.gyros, allowed)
    _set_drift(
        own["accelerometers"], axes[1], calibration.accelerometers, settings.accelerometers, allowed
    )
