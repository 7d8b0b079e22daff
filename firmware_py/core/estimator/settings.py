"""Set-up of the estimator: what is known of the sensors and of the beginning, in SI units.

Every default has its reason beside it. What a data sheet says is taken from there.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from rrins.firmware_py.core.aiding.wheel import (
    MOUNTING_SIGMA,
    PIVOT_SIGMA,
    SCALE_SIGMA,
    SLIP_SIGMA,
)
from rrins.firmware_py.core.estimator import receiver, sway
from rrins.firmware_py.core.estimator.propagation import HOUR_S, LEAST_WALK
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.records.estimator_records import (
    BIASES,
    NEVER,
    ODOMETER_STATES,
    SENSOR_CONSTANTS,
    STATE_CAPACITY,
    SWAY_STATES,
)
from rrins.firmware_py.core.records.initial_attitude import (
    LEAST_HEADING,
    LEAST_LEVEL,
    InitialAttitude,
)
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.sensors.calibration import transverse
from rrins.firmware_py.core.sensors.data_sheet import DataSheet

_LEAST_SLOPE = 1e-7
"""Of scale factors and installation, where they are states: what they change by as it turns."""

Axes = tuple[tuple[float, float], ...]
"""Design directions of the input axes, °, as in `rrins.firmware_py.core.settings.Settings`."""


class EstimatorSettings(BaseModel):
    """Set-up of the estimator.

    Attributes
    ----------
    gyros, accelerometers : DataSheet
    constants : bool
        Whether scale factor, asymmetry and installation errors of each sensor are states.
    fine_alignment_s : float
        Length of the fine alignment; 0: none.
    heading_sigma_enough : float
        rad; the fine alignment ends before its time once the heading is known this well; 0: never.
    zero_velocity_sigma : float
        m/s, of each component while the vehicle stands. 2 mm/s: nobody moves in it, no wind.
    detects_standing : bool
        Whether the sensors may find themselves that the vehicle stands. Off: a unit that is tried
        at rest would never be without aid.
    position_sigma : float
        m, of each component of the position where navigation begins. 2 cm: it does not move.
    gate : float
        Standard deviations beyond which an innovation is not used. 5: once in 1.7 million.
    level_sigma, heading_sigma : float
        rad, of a given attitude.
    odometer_scale_sigma : float
        Of the odometer's scale. 1 %: tyres wear, and warm up.
    mounting_sigma : float
        rad, of each angle between y of the body and the vehicle's forward axis. 1°: by eye.
    slip_sigma : float
        m/s, of the velocity across the forward axis. 5 cm/s: what tyres and springs let through.
    altimeter_sigma : float
        m, of each height of the altimeter.
    altimeter_bias_sigma : float
        m, of its bias at the beginning. 10 m: by an air pressure that is not that of the day.
    altimeter_walk : float
        m/√s, of the bias. 1/60: a metre in an hour, by the weather.
    receiver_sigma : float
        m, of what of each component of the receiver's position error lasts; 0: all is noise.
    receiver_s : float
        Its time constant, s.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    gyros: DataSheet
    accelerometers: DataSheet
    constants: bool = False
    fine_alignment_s: float = Field(default=0.0, ge=0)
    heading_sigma_enough: float = Field(default=0.0, ge=0)
    zero_velocity_sigma: float = Field(default=0.002, gt=0)
    detects_standing: bool = False
    position_sigma: float = Field(default=0.02, gt=0)
    gate: float = Field(default=5.0, gt=1)
    level_sigma: float = Field(default=0.0, ge=0)
    heading_sigma: float = Field(default=0.0, ge=0)
    odometer_scale_sigma: float = Field(default=SCALE_SIGMA, gt=0)
    mounting_sigma: float = Field(default=MOUNTING_SIGMA, gt=0)
    slip_sigma: float = Field(default=SLIP_SIGMA, gt=0)
    altimeter_sigma: float = Field(default=0.5, ge=0)
    altimeter_bias_sigma: float = Field(default=10.0, gt=0)
    altimeter_walk: float = Field(default=1 / 60, gt=0)
    receiver_sigma: float = Field(default=0.0, ge=0)
    receiver_s: float = Field(default=60.0, gt=0)


def _bias_sigma(sheet: DataSheet) -> float:
    return sheet.bias_limit / 3 if sheet.bias_sigma is None else sheet.bias_sigma


def _fused(fusion: Fusion) -> float:
    """Return how much of one sensor's error a component of the fused vector has, at most."""
    gain = np.linalg.pinv(fusion.H[: int(fusion.count)])
    return float(np.sqrt(np.max(np.sum(gain**2, axis=1))))


def take_altimeter(state: Ram) -> None:
    """Let the filter measure by the altimeter what a damped height channel would follow.

    Beside the filter, that channel turns biases of a milli-g into metres that no measurement of the
    filter explains.
    """
    if state.parameters.height_channel != strapdown.HEIGHT_HELD:
        state.parameters.height_channel = strapdown.HEIGHT_FREE
        state.estimator.altimeter = True


def set_up(
    state: Ram, settings: EstimatorSettings, rate_hz: int, axes_deg: tuple[Axes, Axes]
) -> None:
    """Fill in the estimator of a RAM image whose parameters and sensors are filled in.

    `axes_deg` are those of gyros and of accelerometers.
    """
    estimator, parameters = state.estimator, state.parameters
    estimator.enabled = True
    estimator.aligned_epoch = NEVER
    estimator.fine_epochs = round(settings.fine_alignment_s * rate_hz)
    estimator.heading_sigma_enough = settings.heading_sigma_enough
    estimator.second_epochs = rate_hz
    estimator.states = BIASES + int(state.gyros.count) + int(state.accelerometers.count)
    if state.odometer.interval_epochs > 0:
        estimator.states += ODOMETER_STATES
    mounting = settings.mounting_sigma, settings.mounting_sigma, PIVOT_SIGMA
    estimator.odometer_sigma[:] = settings.odometer_scale_sigma, *mounting
    estimator.slip_sigma = settings.slip_sigma
    if estimator.altimeter:
        estimator.altimeter_state = estimator.states
        estimator.states += 1
    if parameters.initial_attitude == InitialAttitude.SELF_ALIGNED_SWAYING:
        estimator.sway = True
        estimator.sway_state = estimator.states
        estimator.states += SWAY_STATES
        sway.set_up(estimator)
    if settings.receiver_sigma > 0.0:
        receiver.set_up(estimator, settings.receiver_sigma, settings.receiver_s)
    estimator.detects_standing = settings.detects_standing
    estimator.altimeter_sigma = settings.altimeter_sigma
    estimator.altimeter_bias_sigma = settings.altimeter_bias_sigma
    estimator.altimeter_walk_variance = settings.altimeter_walk**2
    estimator.vertical = parameters.height_channel == strapdown.HEIGHT_FREE
    estimator.zero_velocity_sigma = settings.zero_velocity_sigma
    estimator.velocity_sigma = settings.zero_velocity_sigma
    estimator.start_sigma = settings.position_sigma
    estimator.position_sigma = settings.position_sigma
    estimator.gate = settings.gate
    for kind, sheet in enumerate((settings.gyros, settings.accelerometers)):
        sigma = _bias_sigma(sheet)
        estimator.bias_sigma[kind] = sigma
        estimator.slope_variance[kind] = sheet.slope_sigma**2
        count = len(sheet.white_noise)
        estimator.white_variance[kind, :count] = np.square(sheet.white_noise)
        walk = np.array(sheet.walk_variance)
        estimator.walk_variance[kind, :count] = walk + (LEAST_WALK * sigma) ** 2 / HOUR_S
    estimator.turn_variance[0] = settings.gyros.turn_variance(True)
    estimator.turn_variance[1] = settings.accelerometers.turn_variance(False)
    if settings.constants:
        estimator.turn_variance[1] = 0.0
        _set_up_constants(state, settings, axes_deg)
    estimator.attitude_sigma[:] = _attitude_sigma(state, settings)


def _set_up_constants(state: Ram, settings: EstimatorSettings, axes_deg: tuple[Axes, Axes]) -> None:
    """Make scale factors and installation errors states."""
    estimator = state.estimator
    estimator.constants = True
    estimator.constants_state = estimator.states
    counts = int(state.gyros.count) + int(state.accelerometers.count)
    estimator.states += SENSOR_CONSTANTS * counts
    assert estimator.states <= STATE_CAPACITY
    for kind, sheet in enumerate((settings.gyros, settings.accelerometers)):
        U, V = transverse(axes_deg[kind])
        estimator.transverse[kind, : len(U), 0] = U
        estimator.transverse[kind, : len(V), 1] = V
        first = SENSOR_CONSTANTS * kind
        estimator.constant_sigma[first : first + SENSOR_CONSTANTS] = (
            sheet.scale_sigma,
            sheet.asymmetry_sigma,
            sheet.installation_sigma,
            sheet.installation_sigma,
        )
        estimator.slope_variance[kind] = _LEAST_SLOPE**2


def _attitude_sigma(state: Ram, settings: EstimatorSettings) -> tuple[float, float, float]:
    """Return the standard deviations of the attitude at the beginning, in n.

    A self-aligned attitude has the errors of the sensors' biases and noise: the level as
    accelerometers by gravity, the heading as gyros by the Earth's horizontal rate. Of one that
    moves, the alignment itself finds what gyros and motion leave of the heading.
    """
    parameters = state.parameters
    if parameters.initial_attitude in (InitialAttitude.GIVEN, InitialAttitude.TRANSFERRED):
        level = max(settings.level_sigma, LEAST_LEVEL)
        return level, level, max(settings.heading_sigma, LEAST_HEADING)
    seconds = parameters.alignment_epochs * parameters.period_ns * 1e-9
    gravity = earth.gravity(float(parameters.latitude), float(parameters.height))
    horizontal = earth.RATE * math.cos(parameters.latitude)
    askew, turned = 0.0, 0.0
    if settings.constants:
        askew = gravity * settings.accelerometers.installation_sigma
        turned = earth.RATE * math.hypot(
            settings.gyros.installation_sigma, settings.gyros.scale_sigma
        )
    force = math.hypot(_bias_sigma(settings.accelerometers), askew)
    force *= _fused(state.accelerometers)
    force_noise = max(settings.accelerometers.white_noise, default=0.0) / math.sqrt(seconds)
    level = max(math.hypot(force, force_noise) / gravity, LEAST_LEVEL)
    if parameters.initial_attitude != InitialAttitude.SELF_ALIGNED:
        return level, level, LEAST_HEADING
    rate = math.hypot(_bias_sigma(settings.gyros), turned) * _fused(state.gyros)
    rate_noise = max(settings.gyros.white_noise, default=0.0) / math.sqrt(seconds)
    return level, level, max(math.hypot(rate, rate_noise) / horizontal, LEAST_HEADING)
