"""Set-up of the integrity: the risk that is allowed, how often parts fail, and the alert limits."""

from __future__ import annotations

import math
from statistics import NormalDist

from pydantic import BaseModel, ConfigDict, Field

from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.estimator.fault_effects import FIRST_AID
from rrins.firmware_py.core.integrity.weights import LONGEST_S
from rrins.firmware_py.core.records.integrity_records import (
    ACCELEROMETERS_SHIFT,
    AGES,
    ALL_GYROS,
    ALTIMETER_DRIFT,
    ALTIMETER_FAULT,
    FAULT_CAPACITY,
    GNSS_STEP,
    GYROS_SHIFT,
    ODOMETER_FAULT,
    RUNGS,
    Fault,
    IntegrityStatus,
)
from rrins.firmware_py.core.records.memory import Ram

_HOUR_S = 3600.0
_DECORRELATION_S = 100.0
"""After which an error counts as a new one: an aided filter forgets in tens of seconds, a free one
in hours."""

LEAST_RATE = 1e-11
"""1/h, of what is not expected at all: once it shows, it counts."""

_UNLEARNED_S = 16.0
"""In which the parity has not learned yet what sound sensors put there."""

_COMMON_SCALE = 0.003
"""Standard deviation of a change of scale that all sensors of a kind have alike."""

_COMMON_SHIFT = 10.0
"""Standard deviation of a change of bias that they have alike, in those of a sensor's own bias."""

_DRIFT_SHARE = 1e-3
"""Of the altimeter's faults, drifts that last: a receiver shows one within minutes."""

_FAULTLESS_SHARE, _YOUNG_SHARE = 0.25, 0.25
"""Of the risk: of no fault; of sensors' faults that began a moment ago, where no parity shows them.
The rest is that of all other faults, in equal parts."""

_RARE_SHARE = 0.1
"""Of the risk per hour: with that probability all of a kind may fail alike unseen. They do so for
the whole hour, or not at all: it is no more probable for all the errors in an hour than for one."""


class IntegritySettings(BaseModel):
    """Bounds of the error for a stated risk, and how often parts are assumed to fail."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    risk_per_h: float = Field(default=1e-5, ge=1e-9, le=0.1)
    """Probability per hour of an error beyond its bound."""
    horizontal_alert_m: float = Field(default=556.0, gt=0, le=1e7)
    """A larger bound makes the navigation not available. 556 m: 0.3 miles, as of RNP 0.3."""
    vertical_alert_m: float = Field(default=50.0, gt=0, le=1e5)
    """The same of the height, where the filter estimates it. 50 m: as of APV-I."""
    heading_alert_deg: float = Field(default=1.0, gt=0, le=180)
    """The same of the heading."""
    gyro_faults_per_h: float = Field(default=1e-5, ge=0, le=1)
    """Of each gyro."""
    accelerometer_faults_per_h: float = Field(default=1e-5, ge=0, le=1)
    """Of each accelerometer."""
    gnss_faults_per_h: float = Field(default=0.0, ge=0, le=1)
    """Wrong fixes that the receiver does not notice. Below 1e-11 only what the innovations show
    counts; 1e-7 also covers what they would not, and makes the bound several times as large."""
    odometer_faults_per_h: float = Field(default=1e-4, ge=0, le=1)
    """Changes of its scale: slip, another tyre."""
    altimeter_faults_per_h: float = Field(default=1e-6, ge=0, le=1)
    """Changes of its bias beyond those of the weather; that it drifts is a thousandth of that."""
    common_faults_per_h: float = Field(default=1e-8, ge=0, le=1)
    """Of the scale of all gyros, or of all accelerometers, alike, and of their biases: by a supply,
    or the temperature. 1e-8: a few hundredths, as of IEC 61508-6, of a sensor's own changes."""


def deviations(risk: float) -> float:
    """Return how many standard deviations an error exceeds, on either side, with a probability."""
    return -NormalDist().inv_cdf(0.5 * risk)


def _spans_s() -> tuple[float, ...]:
    """Return the times within which a fault of each age of the ladder began."""
    return (*(float(2**rung) for rung in range(RUNGS)), LONGEST_S, LONGEST_S, _UNLEARNED_S)


def _set_fault(fault: Fault, sensor: int, present: bool, per_h: float, share: float) -> None:
    fault.sensor = sensor
    fault.present = present
    for age, span_s in enumerate(_spans_s()):
        likely = min(1.0, max(per_h, LEAST_RATE) * span_s / _HOUR_S)
        fault["odds"][age] = 2.0 * math.log(likely / share)


def set_up(state: Ram, settings: IntegritySettings) -> None:
    """Fill in the integrity of a RAM image whose sensors, aids and estimator are filled in."""
    integrity = state.integrity
    integrity.enabled = True
    integrity.status = IntegrityStatus.NOT_AVAILABLE
    integrity.alert[:] = (
        settings.horizontal_alert_m,
        settings.vertical_alert_m,
        math.radians(settings.heading_alert_deg),
    )
    risk = settings.risk_per_h * _DECORRELATION_S / _HOUR_S
    integrity.faultless = deviations(_FAULTLESS_SHARE * risk)
    present = {
        kind * SENSOR_GROUPS + k: (k, rate)
        for kind, (fusion, rate) in enumerate(
            (
                (state.gyros, settings.gyro_faults_per_h),
                (state.accelerometers, settings.accelerometer_faults_per_h),
            )
        )
        for k in range(int(fusion.count))
    }
    for numbers, is_fitted, rate in (
        (range(GNSS_STEP, ODOMETER_FAULT), state.gnss.interval_epochs, settings.gnss_faults_per_h),
        ((ODOMETER_FAULT,), state.odometer.interval_epochs, settings.odometer_faults_per_h),
        ((ALTIMETER_FAULT,), state.estimator.altimeter, settings.altimeter_faults_per_h),
        (
            (ALTIMETER_DRIFT,),
            state.estimator.altimeter,
            _DRIFT_SHARE * settings.altimeter_faults_per_h,
        ),
        (range(ALL_GYROS, ACCELEROMETERS_SHIFT + 1), True, settings.common_faults_per_h),
    ):
        present |= {FIRST_AID + number: (-1, rate) for number in numbers if is_fitted}
    for kind, bias_sigma in enumerate(state.estimator.bias_sigma):
        integrity.faults[FIRST_AID + ALL_GYROS + kind].known = _COMMON_SCALE**-2
        shift = integrity.faults[FIRST_AID + GYROS_SHIFT + kind]
        shift.known = (_COMMON_SHIFT * bias_sigma) ** -2
    left = 1.0 - _FAULTLESS_SHARE - _YOUNG_SHARE - _RARE_SHARE
    share = left * risk / max(1, AGES * len(present))
    integrity.certain = 2.0 * math.log(1.0 / share)
    rare = range(FIRST_AID + ALL_GYROS, FIRST_AID + ACCELEROMETERS_SHIFT + 1)
    more = _RARE_SHARE * settings.risk_per_h / len(rare) / share
    for number in range(FAULT_CAPACITY):
        sensor, rate = present.get(number, (-1, 0.0))
        fault = integrity.faults[number]
        _set_fault(fault, sensor, number in present, rate, share)
        fault.allowed = 2.0 * math.log(more) if number in rare else 0.0
        if sensor >= 0:
            fault.young_s = _YOUNG_SHARE * risk * _HOUR_S / max(rate, LEAST_RATE)
