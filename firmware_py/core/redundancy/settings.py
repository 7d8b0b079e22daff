"""Set-up of the redundancy: the sensors' data sheet and the promise on false alarms.

The thresholds follow from both. A sum over a window of w seconds exceeds u standard deviations,
in one of the windows that end in an hour, about ``3600 Σ min(1, u²/w) 2 Q(u)`` times: windows that
overlap are nearly one (Leadbetter, Lindgren and Rootzén, *Extremes and Related Properties of
Random Sequences and Processes*, 1983, chapter 12).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from rrins.firmware_py.core.records.diagnostic_records import Repetition
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ABSOLUTE,
    ACCELEROMETERS,
    NOISE_S,
    OUTER_TURN,
    WINDOWS_S,
    Learner,
    Parity,
    Redundancy,
)
from rrins.firmware_py.core.sensors.calibration import DPH, STANDARD_GRAVITY
from rrins.firmware_py.core.sensors.data_sheet import FLICKER_S, DataSheet

_SECONDS_PER_1000_H = 3.6e6
_KINDS = 2
SECONDS_SHARE, EPOCHS_SHARE, NOISE_SHARE = 0.8, 0.1, 0.1
"""Shares of a kind's half of the promise: small faults take long windows, and need most of it."""

REPETITION_SHARE = 0.01
"""Of the same, for equal counts in a row: one count more allows a hundredth of the false alarms."""

_TOO_ALIKE = 0.4
"""Probability of equal counts beyond which they tell little: the noise is less than two counts, and
counts that alternate without any look the same."""

_PROMISED = 0.5
"""Share of the noise in the data sheet that is in every sensor's counts."""

_EXPECTED_GYRO = 0.02 * DPH
_EXPECTED_ACCELEROMETER = 1.5e-4 * STANDARD_GRAVITY
_STANDING_DPS = 0.02
_STANDING_MPS2 = 0.05
"""Errors of the expectation at standstill: attitude of 5', tilt of 30"; and what is motion."""


class RedundancySettings(BaseModel):
    """Set-up of the redundancy."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    false_alarms_per_1000_h: float = Field(default=0.05, gt=0, le=1000)
    non_orthogonality_limit: float = Field(default=0.0, ge=0)
    """By how much the table's axes may deviate from a right angle, rad."""
    wobble_limit: float = Field(default=0.0, ge=0)
    """By how much the inner axis may wobble, rad."""
    gyro_lag_s: float = Field(default=0.0, ge=0)
    """By how much the gyros lag behind the encoders: their bandwidth and latency."""
    gyros: DataSheet
    accelerometers: DataSheet


def factor_of(rate: Callable[[float], float], allowed: float) -> float:
    """Return the number of standard deviations at which false alarms come at the allowed rate."""
    low, high = 1.0, 12.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rate(middle) > allowed else (low, middle)
    return high


def _beyond(u: float) -> float:
    """Return the probability of more than u standard deviations, on either side."""
    return 2.0 * NormalDist().cdf(-u)


@cache
def second_factor(allowed: float, directions: int) -> float:
    """Return the threshold of windows from 1 to 1024 s, in standard deviations."""

    def rate(u: float) -> float:
        windows = sum(min(1.0, u * u / window_s) for window_s in WINDOWS_S)
        return _SECONDS_PER_1000_H * windows * directions * _beyond(u)

    return factor_of(rate, allowed)


@cache
def epoch_factor(allowed: float, directions: int, rate_hz: int) -> float:
    """Return the threshold of shorter windows, which do not overlap, in standard deviations."""
    return factor_of(lambda u: _SECONDS_PER_1000_H * 2 * rate_hz * directions * _beyond(u), allowed)


def noise_limit(allowed: float, directions: int) -> float:
    """Return the threshold of the mean of `NOISE_S` normalised squares.

    Of chi-square by Wilson and Hilferty, Proc. Nat. Acad. Sci. 17 (1931).
    """
    tests = _SECONDS_PER_1000_H * directions
    z = -NormalDist().inv_cdf(allowed / tests)
    third = 2.0 / (9.0 * NOISE_S)
    return float((1.0 - third + z * math.sqrt(third)) ** 3)


@cache
def equal_counts(allowed: float, noise: float, rate_hz: int) -> int:
    """Return how many epochs in a row repeat a sensor's counts only if it is stuck; 0: none do.

    `noise` is its standard deviation in counts. An epoch has the same counts as the last with a
    probability of ``erf(1 / (sqrt(8) noise))`` at most, whatever the sensor measures.
    """
    if noise <= 0.0:
        return 0
    alike = math.erf(1.0 / (math.sqrt(8.0) * _PROMISED * noise))
    if alike > _TOO_ALIKE:
        return 0
    return math.ceil(math.log(allowed / (_SECONDS_PER_1000_H * rate_hz)) / math.log(alike))


def _drift_variance(sheet: DataSheet, sensor: int) -> NDArray[np.float64]:
    """Return the variance of the drift's sum over each window.

    Bias instability by its Allan variance and the logarithm of the time since it was learned;
    IEEE Std 952-1997, annex C.
    """
    w = np.array(WINDOWS_S, dtype=float)
    instability = (2.0 / math.pi) * sheet.bias_instability[sensor] ** 2
    flicker = instability * (np.log(np.maximum(FLICKER_S / w, 1.0)) + 1.5)
    walk = sheet.rate_random_walk[sensor] ** 2 * (w / 3.0 + FLICKER_S / 4)
    warm = sheet.temperature_drift[sensor] * np.minimum(1.0, 2.0 * w / sheet.temperature_s)
    return np.asarray((flicker + walk + warm**2) * w * w)


def _set_learner(learner: Learner, sheet: DataSheet, has_force: bool) -> None:
    prior, walk = learner["prior"], learner["walk"]
    slope = sheet.scale_limit**2 + sheet.installation_limit**2
    prior[0] = sheet.bias_limit**2
    prior[1:4] = slope
    prior[4:OUTER_TURN] = sheet.force_limit**2 if has_force else 0.0
    prior[ABSOLUTE:] = sheet.asymmetry_limit**2
    usual = learner["usual"]
    usual[0] = prior[0]
    usual[1:4] = sheet.scale_sigma**2 + sheet.installation_sigma**2
    usual[4:OUTER_TURN] = sheet.force_sigma**2 if has_force else 0.0
    usual[ABSOLUTE:] = sheet.asymmetry_sigma**2
    usual[:] = np.minimum(usual, prior)
    walk[:] = prior * 1e-9
    walk[0] = max(walk[0] * 1e-3, *sheet.walk_variance)


def _set_parity(
    parity: Parity,
    sheet: DataSheet,
    count: int,
    resolution: float,
    repetition: Repetition,
    settings: RedundancySettings,
    rate_hz: int,
    expected: float,
    standing: float,
    has_force: bool,
) -> None:
    allowed = settings.false_alarms_per_1000_h / _KINDS
    directions = max(1, count - 3)
    resolution = math.hypot(resolution, sheet.resolution)
    counts = resolution**2 / 6.0  # of a sum; as noise, too, for what is learned is not exact
    for k in range(count):
        parity["white_variance"][k] = sheet.white_noise[k] ** 2 + counts
        parity["drift_variance"][k] = _drift_variance(sheet, k)
        parity["instability_variance"][k] = sheet.bias_instability[k] ** 2
        parity["standing_limit"][k] = standing + 6.0 * (sheet.white_noise[k] + resolution)
        noise = sheet.white_noise[k] / math.sqrt(rate_hz) / resolution
        repetition["promised"][k] = _PROMISED * 2.0 / math.sqrt(math.pi) * noise * resolution
        repetition["enough"][k] = equal_counts(REPETITION_SHARE * allowed / count, noise, rate_hz)
    repetition["resolution"] = resolution
    parity["quantisation_variance"] = counts
    bias = sheet.bias_limit / 3.0 if sheet.bias_sigma is None else sheet.bias_sigma
    parity["bias_variance"] = bias**2
    parity["slope_variance"] = sheet.slope_sigma**2
    parity["turn_variance"] = sheet.turn_variance(has_force)
    lengths_s = np.array(WINDOWS_S, dtype=float)
    parity["expected_variance"][:] = (expected * lengths_s) ** 2
    parity["second_factor"] = second_factor(SECONDS_SHARE * allowed, directions)
    parity["epoch_factor"] = epoch_factor(EPOCHS_SHARE * allowed, directions, rate_hz)
    parity["noise_limit"] = noise_limit(NOISE_SHARE * allowed, directions)
    parity["kept"]["unit"] = 1.0
    for learner in (parity["parity"], parity["ahead"], parity["expected"]):
        _set_learner(learner, sheet, has_force)


def _set_table(parity: Parity, settings: RedundancySettings, step: float, rate: float) -> None:
    """Set up what the table makes of the rotation that is expected of the gyros.

    A wobble once a turn tilts the inner axis in the sensor frame: as an error of installation.
    While the table turns at its `rate` (rad/s), gyros that lag are off by an angle.
    """
    parity["wobble"] = settings.wobble_limit
    parity["encoder_variance"] = step**2 / 12.0 + (settings.gyro_lag_s * rate) ** 2
    prior = parity["expected"]["prior"]
    prior[1:4] += settings.wobble_limit**2
    prior[OUTER_TURN] = settings.non_orthogonality_limit**2 + settings.wobble_limit**2


def blank(state: Ram) -> None:
    """Note that nothing has happened to any sensor yet."""
    for parity in (state.redundancy.gyros, state.redundancy.accelerometers):
        parity["suspect"] = -1
        parity["isolated"] = -1
        parity["repaired_epoch"] = -1
        parity["readmitted"] = -1


def set_up(
    state: Ram, settings: RedundancySettings, rate_hz: int, resolutions: tuple[float, float]
) -> None:
    """Set up the redundancy of the RAM image; `resolutions` of the frames are in rad and m/s."""
    redundancy: Redundancy = state["redundancy"]
    redundancy["enabled"] = True
    redundancy["second_epochs"] = rate_hz
    gyros, accelerometers = redundancy["gyros"], redundancy["accelerometers"]
    _set_parity(
        gyros,
        settings.gyros,
        int(state.gyros.count),
        resolutions[0],
        state.diagnostics.gyro_repetition,
        settings,
        rate_hz,
        _EXPECTED_GYRO,
        math.radians(_STANDING_DPS),
        True,
    )
    rate = math.radians(state.parameters.turn_rate_dps)
    _set_table(gyros, settings, math.radians(state.encoders.step_deg), rate)
    accelerometers["kind"] = ACCELEROMETERS
    _set_parity(
        accelerometers,
        settings.accelerometers,
        int(state.accelerometers.count),
        resolutions[1],
        state.diagnostics.accelerometer_repetition,
        settings,
        rate_hz,
        _EXPECTED_ACCELEROMETER,
        _STANDING_MPS2,
        False,
    )
    redundancy["readmission"]["gyros"] = gyros
    redundancy["readmission"]["accelerometers"] = accelerometers
