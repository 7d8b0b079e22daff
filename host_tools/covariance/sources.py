"""The error sources of a scenario, for its covariance analysis: how large, and of which kind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.memory import FLICKER_POLES
from rrins.host_tools.hardware.settings import FLICKER_RATIO, FLICKER_SHORTEST_S
from rrins.host_tools.hardware.units import (
    ARCSEC,
    DEG_PER_SQRT_H,
    DPH,
    PPM,
    SQRT_H,
    STANDARD_GRAVITY,
    UG,
)
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.tables import each

Effect = Literal["bias", "scale", "asymmetry", "delta_u", "delta_v", "force"]
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
    "accelerometers.bias_ug": ("bias", UG),
    "accelerometers.bias_repeatability_ug": ("bias", UG),
    "accelerometers.scale_error_ppm": ("scale", PPM),
    "accelerometers.scale_repeatability_ppm": ("scale", PPM),
    "accelerometers.asymmetric_scale_error_ppm": ("asymmetry", PPM),
    "accelerometers.installation_u_arcsec": ("delta_u", ARCSEC),
    "accelerometers.installation_v_arcsec": ("delta_v", ARCSEC),
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
    "firmware.roll_error_arcsec": 0,
    "firmware.pitch_error_arcsec": 1,
    "firmware.heading_error_arcsec": 2,
}
"""Errors of the given attitude, and which angle they are of."""


class Varied(NamedTuple):
    """A key of the scenario that varies from run to run."""

    key: str
    sensor: int | None
    """From 1; None: the value is that of all."""
    moments: tuple[float, float]
    """Mean and standard deviation."""
    correlation: float
    """Between the values of two sensors."""


@dataclass(frozen=True)
class Constant:
    """A constant error of the sensors of a kind.

    Attributes
    ----------
    name, kind : str
    """

    name: str
    kind: str
    effect: Effect
    mean: Floats  #: shape (m,); sI units
    covariance: Floats  #: shape (m, m)


@dataclass(frozen=True)
class Process:
    """A first-order Gauss-Markov process added to each sensor of a kind; a sum of several.

    Attributes
    ----------
    name, kind : str
    """

    name: str
    kind: str
    decay_s: tuple[float, ...]  #: time constants; infinity for a random walk
    drive: Floats  #: shape (processes, m); square root of the density of what drives each, SI units


@dataclass(frozen=True)
class White:
    """White noise of the sensors of a kind: density of each, SI units."""

    name: str
    kind: str
    density: Floats


@dataclass
class Sources:
    """All error sources of a scenario that the analysis knows.

    Attributes
    ----------
    constants, processes, whites : list
    """

    constants: list[Constant] = field(default_factory=list)
    processes: list[Process] = field(default_factory=list)
    whites: list[White] = field(default_factory=list)
    #: errors of the given roll, pitch and heading: mean and variance, rad, by name
    attitude: dict[str, tuple[Floats, Floats]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)  #: what varies or errs and is not considered


def sources_of(scenario: Scenario, varied: Sequence[Varied] = ()) -> Sources:
    """Return the error sources of a scenario of which some keys vary from run to run."""
    by_key: dict[str, list[Varied]] = {}
    for one in varied:
        by_key.setdefault(one.key, []).append(one)
    sources = Sources()
    for key, (effect, unit) in _CONSTANTS.items():
        found = _constant(scenario, key, effect, unit, by_key.pop(key, []))
        if found is not None:
            sources.constants.append(found)
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
    _add_attitude(sources, scenario, by_key)
    sources.left_out += [f"{key} (varied)" for key in by_key]
    sources.left_out += _left_out(scenario)
    return sources


def draws(key: str) -> bool:
    """Return whether the value of a key of `TOLERANCES` is itself a σ: a run draws the error."""
    return key not in _CONSTANTS or any(word in key for word in _DRAWN)


def _kind(key: str) -> str:
    return key.partition(".")[0]


def _values(scenario: Scenario, key: str) -> Floats:
    """Return a key's value for each sensor."""
    kind, name = key.split(".")
    count = len(getattr(scenario.rimu, kind))
    return np.array(each(getattr(getattr(scenario, kind), name), count), float)


def _constant(
    scenario: Scenario, key: str, effect: Effect, unit: float, inputs: list[Varied]
) -> Constant | None:
    values = _values(scenario, key) * unit
    count = len(values)
    is_drawn = draws(key)
    mean = np.zeros(count) if is_drawn else values
    covariance = np.diag(values**2) if is_drawn else np.zeros((count, count))
    for one in inputs:
        if is_drawn:
            continue
        centre, spread = (moment * unit for moment in one.moments)
        at = slice(None) if one.sensor is None else slice(one.sensor - 1, one.sensor)
        mean[at] = centre
        covariance[at, at] = spread**2
    for one in inputs:  # the same distribution: correlated as it says
        for other in inputs:
            if one.sensor and other.sensor and one != other and not is_drawn:
                a, b = one.sensor - 1, other.sensor - 1
                both = math.sqrt(covariance[a, a] * covariance[b, b])
                covariance[a, b] = one.correlation * both
    if not mean.any() and not covariance.any():
        return None
    return Constant(key, _kind(key), effect, mean, covariance)


def _instability(key: str, spread: Floats) -> Process:
    """Return the processes of bias instability, as the hardware has them."""
    decay_s = tuple(FLICKER_SHORTEST_S * FLICKER_RATIO**k for k in range(FLICKER_POLES))
    variance = math.log(FLICKER_RATIO) / math.pi
    drive = np.array([spread * math.sqrt(2.0 * variance / decay) for decay in decay_s])
    return Process(key, _kind(key), decay_s, drive)


def _add_attitude(sources: Sources, scenario: Scenario, by_key: dict[str, list[Varied]]) -> None:
    """Add the errors of the attitude that the firmware is given."""
    firmware = scenario.firmware
    if firmware.initial_attitude != "given":
        return
    level, heading = firmware.level_error_sigma_arcsec, firmware.heading_error_sigma_arcsec
    sigmas = np.array([level, level, heading]) * ARCSEC
    mean = np.zeros(3)
    varied = np.zeros(3)
    for key, angle in _ATTITUDE.items():
        mean[angle] = getattr(firmware, key.partition(".")[2]) * ARCSEC
        for one in by_key.pop(key, []):
            centre, spread = one.moments
            mean[angle], varied[angle] = centre * ARCSEC, spread * ARCSEC
    if mean.any() or sigmas.any() or varied.any():
        sources.attitude["firmware: given attitude"] = (mean, np.diag(sigmas**2 + varied**2))


def _left_out(scenario: Scenario) -> list[str]:
    """Return what errs in a scenario and is not considered."""
    found = []
    if scenario.faults:
        found.append("faults")
    if scenario.firmware.calibration is not None:
        found.append("firmware.calibration")
    thermal = scenario.thermal
    if thermal.ambient_offset_k or thermal.warm_up_k:
        found.append("thermal")
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
