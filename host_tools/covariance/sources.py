"""The error sources of a scenario, for its covariance analysis: how large, and of which kind."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, Final, NamedTuple

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.estimator.wheels import FORWARD
from rrins.firmware_py.core.records.estimator_records import PITCH, SCALE, YAW, Aid
from rrins.host_tools.covariance.kinds import (
    AidConstant,
    AidNoise,
    AidProcess,
    Constant,
    Crooked,
    Drawn,
    Effect,
    Process,
    Start,
    White,
)
from rrins.host_tools.covariance.trace import Take
from rrins.host_tools.hardware.memory import FLICKER_POLES
from rrins.host_tools.hardware.settings import FLICKER_RATIO, FLICKER_SHORTEST_S
from rrins.host_tools.hardware.units import (
    ARCSEC,
    DEG,
    DEG_PER_SQRT_H,
    DPH,
    PPM,
    SQRT_H,
    STANDARD_GRAVITY,
    UG,
)
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each

KINDS: Final = ("gyros", "accelerometers")

_CONSTANTS: Final[dict[str, tuple[Effect, float]]] = {
    "gyros.bias_dph": ("bias", DPH),
    "gyros.bias_repeatability_dph": ("bias", DPH),
    "gyros.scale_error_ppm": ("scale", PPM),
    "gyros.scale_repeatability_ppm": ("scale", PPM),
    "gyros.asymmetric_scale_error_ppm": ("asymmetry", PPM),
    "gyros.installation_u_arcsec": ("delta_u", ARCSEC),
    "gyros.installation_v_arcsec": ("delta_v", ARCSEC),
    "gyros.g_sensitivity_dph_per_g": ("force", DPH / STANDARD_GRAVITY),
    "gyros.bias_temperature_dph_per_k": ("warm_bias", DPH),
    "gyros.scale_temperature_ppm_per_k": ("warm_scale", PPM),
    "accelerometers.bias_ug": ("bias", UG),
    "accelerometers.bias_repeatability_ug": ("bias", UG),
    "accelerometers.scale_error_ppm": ("scale", PPM),
    "accelerometers.scale_repeatability_ppm": ("scale", PPM),
    "accelerometers.asymmetric_scale_error_ppm": ("asymmetry", PPM),
    "accelerometers.installation_u_arcsec": ("delta_u", ARCSEC),
    "accelerometers.installation_v_arcsec": ("delta_v", ARCSEC),
    "accelerometers.bias_temperature_ug_per_k": ("warm_bias", UG),
    "accelerometers.scale_temperature_ppm_per_k": ("warm_scale", PPM),
}
"""Keys of constants, what they do to a sensor, and their units."""

_DRAWN: Final = ("repeatability",)
"""In the name of keys whose value is the standard deviation of what a run draws."""

_WHITE: Final = {
    "gyros.angle_random_walk_deg_per_sqrt_h": DEG_PER_SQRT_H,
    "accelerometers.white_noise_ug_per_sqrt_hz": UG,
}
_INSTABILITY: Final = {"gyros.bias_instability_dph": DPH, "accelerometers.bias_instability_ug": UG}
_WALK: Final = {
    "gyros.rate_random_walk_dph_per_sqrt_h": DPH / SQRT_H,
    "accelerometers.random_walk_ug_per_sqrt_h": UG / SQRT_H,
}
TOLERANCES: Final = (*_CONSTANTS, *_WHITE, *_INSTABILITY, *_WALK)
"""Keys of the sensors whose σ scales what the analysis says of them."""

_ATTITUDE: Final = {
    "firmware.roll_error_arcsec": 6,
    "firmware.pitch_error_arcsec": 7,
    "firmware.heading_error_arcsec": 8,
}
"""Errors of the given attitude, and where they are among those of the start."""

_AID_CONSTANTS: Final = {
    "odometer.scale_error_ppm": (SCALE, -PPM),
    "odometer.mounting_heading_deg": (YAW, DEG),
    "odometer.mounting_pitch_deg": (PITCH, DEG),
    "altimeter.bias_m": (0, 1.0),
}
"""Constants of the aids: which state of the aid's the filter has for it, and in which unit."""


_CROOKED: Final = {
    "turntable.non_orthogonality_arcsec": ARCSEC,
    "turntable.wobble_arcsec": ARCSEC,
    "turntable.inner.encoder_offset_deg": DEG,
    "turntable.outer.encoder_offset_deg": DEG,
}
"""Imperfections of the table that turn a given attitude, which is carried through it."""


class Varied(NamedTuple):
    """A key of the scenario that varies from run to run, one of the n inputs of a campaign."""

    key: str
    sensor: int | None
    """From 1; None: the value is that of all."""
    moments: tuple[float, float]
    """Mean and standard deviation."""
    correlation: tuple[float, ...]
    """With each of the inputs, in their order."""


@dataclass
class Sources:
    """All error sources of a scenario that the analysis knows.

    Attributes
    ----------
    drawn, processes, whites, aid_noises, aid_processes : list
    """

    drawn: list[Drawn] = field(default_factory=list)
    processes: list[Process] = field(default_factory=list)
    whites: list[White] = field(default_factory=list)
    aid_noises: list[AidNoise] = field(default_factory=list)
    aid_processes: list[AidProcess] = field(default_factory=list)
    correlation: Floats = field(default_factory=lambda: np.zeros((0, 0)))  #: of the inputs, (n, n)
    left_out: list[str] = field(default_factory=list)  #: what varies or errs and is not considered


class _Inputs:
    """The inputs of a campaign, by key, until somebody takes them."""

    def __init__(self, varied: Sequence[Varied]) -> None:
        self.left: dict[str, list[tuple[int, Varied]]] = {}
        for number, one in enumerate(varied):
            self.left.setdefault(one.key, []).append((number, one))
        self.correlation = np.array([one.correlation for one in varied]).reshape(2 * (len(varied),))

    def take(self, key: str, unit: float, mean: Floats) -> Floats:
        """Return the loading (m, n) of a key's m values; write the means of those that vary."""
        loading = np.zeros((len(mean), len(self.correlation)))
        for number, one in self.left.pop(key, []):
            centre, spread = (moment * unit for moment in one.moments)
            at = slice(None) if one.sensor is None else slice(one.sensor - 1, one.sensor)
            mean[at] = centre
            loading[at, number] = spread
        return loading

    def spread(self, loading: Floats) -> Floats:
        """Return the covariance that a loading gives, (m, m)."""
        return np.asarray(loading @ self.correlation @ loading.T)


def sources_of(scenario: Scenario, varied: Sequence[Varied] = ()) -> Sources:
    """Return the error sources of a scenario of which some keys vary from run to run."""
    inputs = _Inputs(varied)
    sources = Sources(correlation=inputs.correlation)
    is_warm = scenario.thermal.ambient_offset_k != 0 or scenario.thermal.warm_up_k != 0
    for key, (effect, unit) in _CONSTANTS.items():
        if effect not in ("warm_bias", "warm_scale") or is_warm:
            sources.drawn.append(_constant(scenario, key, effect, unit, inputs))
    for key, unit in _WHITE.items():
        density = _values(scenario, key) * unit
        if density.any():
            sources.whites.append(White(key, _kind(key), density))
    for key, unit in _INSTABILITY.items():
        spread = _values(scenario, key) * unit
        if spread.any():
            sources.processes.append(_instability(key, spread))
    for key, unit in _WALK.items():
        drive = _values(scenario, key) * unit
        if drive.any():
            sources.processes.append(Process(key, _kind(key), (math.inf,), drive[None, :]))
    if scenario.firmware.initial_attitude in ("given", "transferred"):
        sources.drawn += [_start(scenario, inputs), *_crooked(scenario, inputs)]
    if scenario.estimator.enabled:
        _add_aids(sources, scenario, inputs)
    sources.drawn = [one for one in sources.drawn if one.mean.any() or one.covariance.any()]
    sources.left_out += [f"{key} (varied)" for key in inputs.left]
    sources.left_out += _left_out(scenario)
    return sources


def draws(key: str) -> bool:
    """Return whether the value of a key of `TOLERANCES` is itself a σ: a run draws the error."""
    return key not in _CONSTANTS or any(word in key for word in _DRAWN)


def _kind(key: str) -> str:
    return key.partition(".")[0]


def _value(scenario: Scenario, key: str) -> Any:
    """Return the value of a key with its tables."""
    return reduce(getattr, key.split("."), scenario)


def _values(scenario: Scenario, key: str) -> Floats:
    """Return a key's value for each sensor."""
    count = len(getattr(scenario.rimu, _kind(key)))
    return np.array(each(_value(scenario, key), count), float)


def _constant(
    scenario: Scenario, key: str, effect: Effect, unit: float, inputs: _Inputs
) -> Constant:
    values = _values(scenario, key) * unit
    if draws(key):
        none = np.zeros((len(values), len(inputs.correlation)))
        return Constant(key, 0.0 * values, np.diag(values**2), none, _kind(key), effect)
    loading = inputs.take(key, unit, values)
    return Constant(key, values, inputs.spread(loading), loading, _kind(key), effect)


def _instability(key: str, spread: Floats) -> Process:
    """Return the processes of bias instability, as the hardware has them."""
    decay_s = tuple(FLICKER_SHORTEST_S * FLICKER_RATIO**k for k in range(FLICKER_POLES))
    variance = math.log(FLICKER_RATIO) / math.pi
    drive = np.array([spread * math.sqrt(2.0 * variance / decay) for decay in decay_s])
    return Process(key, _kind(key), decay_s, drive)


def _start(scenario: Scenario, inputs: _Inputs) -> Start:
    """Return the errors of what the firmware is given, or what the master unit transfers."""
    firmware = scenario.firmware
    level, heading = firmware.level_error_sigma_arcsec, firmware.heading_error_sigma_arcsec
    sigmas, mean = np.zeros(9), np.zeros(9)
    sigmas[6:] = np.array([level, level, heading]) * ARCSEC
    sigmas[:3], sigmas[3:6] = firmware.position_error_sigma_m, firmware.velocity_error_sigma_mps
    loading = np.zeros((9, len(inputs.correlation)))
    for key, angle in _ATTITUDE.items():
        mean[angle] = getattr(firmware, key.partition(".")[2]) * ARCSEC
        at = slice(angle, angle + 1)
        loading[at] = inputs.take(key, ARCSEC, mean[at])
    name = f"firmware: {firmware.initial_attitude} attitude"
    return Start(name, mean, np.diag(sigmas**2) + inputs.spread(loading), loading)


def _crooked(scenario: Scenario, inputs: _Inputs) -> Iterator[Crooked]:
    """Yield what of the turntable tilts the attitude that is given through it."""
    periods = scenario.turntable.wobble_per_turn
    for key, unit in _CROOKED.items():
        mean = np.array([_value(scenario, key) * unit])
        loading = inputs.take(key, unit, mean)
        yield Crooked(key, mean, inputs.spread(loading), loading, periods)


def _add_aids(sources: Sources, scenario: Scenario, inputs: _Inputs) -> None:
    """Add the errors of receiver, odometer and altimeter."""
    gnss, odometer, altimeter = scenario.gnss, scenario.odometer, scenario.altimeter
    noises = sources.aid_noises
    if gnss is not None:
        position, velocity = gnss.position_noise_m**2, gnss.velocity_noise_mps**2
        noises.append(AidNoise("gnss.position_noise_m", Aid.GNSS_POSITION, lambda _: position))
        noises.append(AidNoise("gnss.velocity_noise_mps", Aid.GNSS_VELOCITY, lambda _: velocity))
        if sigma := gnss.position_correlated_noise_m:
            name, decay_s = "gnss.position_correlated_noise_m", gnss.position_correlation_s
            sources.aid_processes.append(AidProcess(name, Aid.GNSS_POSITION, sigma, decay_s))
    if odometer is not None:
        density = odometer.noise_mps**2 / odometer.rate_hz
        pulse = 2.0 * (odometer.pulse_mm * 1e-3) ** 2 / 12.0  # at both ends of a stretch

        def way(take: Take) -> float:
            rolls = take.component == FORWARD and take.stretch_m != 0.0
            return density * take.stretch_s + pulse if rolls else 0.0

        noises.append(AidNoise("odometer.noise_mps", Aid.ODOMETER, way))
    if altimeter is not None:
        height = altimeter.noise_m**2
        noises.append(
            AidNoise("altimeter.noise_m", Aid.ALTIMETER, lambda take: height / take.heights)
        )
        if walk := altimeter.random_walk_m_per_sqrt_h:
            name, walk = "altimeter.random_walk_m_per_sqrt_h", walk / SQRT_H
            sources.aid_processes.append(AidProcess(name, Aid.ALTIMETER, 0.0, math.inf, walk))
    for key, (state, unit) in _AID_CONSTANTS.items():
        part = _kind(key)
        if getattr(scenario, part) is None:
            continue
        mean = np.array([_value(scenario, key) * unit])
        loading = inputs.take(key, unit, mean)
        spread = inputs.spread(loading)
        sources.drawn.append(AidConstant(key, mean, spread, loading, part, state))


def _left_out(scenario: Scenario) -> list[str]:
    """Return what errs in a scenario and is not considered."""
    found = []
    if scenario.faults:
        found.append("faults")
    if scenario.firmware.calibration is not None:
        found.append("firmware.calibration")
    for kind in KINDS:
        table = getattr(scenario, kind)
        names = (
            "bandwidth_hz",
            "latency_ms",
            *(n for n in type(table).model_fields if "dead" in n),
        )
        names += tuple(
            n for n in type(table).model_fields if n.startswith(("resolution", "position"))
        )
        errs = (name for name in names if np.any(np.asarray(getattr(table, name) or 0.0)))
        found += [f"{kind}.{name}" for name in errs]
    return found
