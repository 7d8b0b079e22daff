"""The scenario of a recording: what the firmware is to know of the vehicle and its sensors."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools import files
from rrins.host_tools.errors import ScenarioError
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.scenario import Scenario, parse
from rrins.host_tools.scenario.tables import Rimu
from rrins.host_tools.vehicle.beginning import State
from rrins.host_tools.vehicle.checks import located
from rrins.host_tools.vehicle.errors import VehicleError
from rrins.host_tools.vehicle.recording import Noise, VehicleRecording

_DPH = math.radians(1.0) / 3600.0
_UG = 9.80665e-6
_ARCSEC = math.radians(1.0) / 3600.0
_SQRT_H = 60.0
_LARGEST_SIGMA_ARCSEC = 36_000.0

_GATE = 100.0
"""Wide open, as in the programs whose data these are: an attitude that begins far off would make
the first fixes look wrong."""

NAVIGATE_AT_S = 1.0
"""When navigation is asked for: the firmware's self-test takes half a second."""


def own_keys(path: Path | None) -> dict[str, Any]:
    """Return the keys of a scenario's file that go on top of what a recording says.

    Raises
    ------
    ScenarioError
    """
    if path is None:
        return {}
    try:
        return tomllib.loads(files.text_of(path))
    except OSError as error:
        raise ScenarioError(f"scenario {path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ScenarioError(f"scenario {path}: not TOML: {error}") from error


def axes_of(recording: VehicleRecording, keys: dict[str, Any]) -> tuple[Floats, Floats] | None:
    """Return the input axes in b, shape (n, 3) each; None where they are those of the body.

    Raises
    ------
    VehicleError
        If the scenario's `[rimu]` does not have the recording's number of sensors.
    """
    if recording.axes_are_body and "rimu" not in keys:
        return None
    if "rimu" not in keys:
        raise located(
            recording.files[0],
            "its sensors are not along the body's axes: say in [rimu] of a --scenario where they "
            "point",
        )
    try:
        rimu = Rimu.model_validate(keys["rimu"])
    except ValueError as error:
        raise ScenarioError(f"rimu: {error}") from error
    found = []
    counts = (recording.increments.dtheta.shape[1], recording.increments.dv.shape[1])
    for name, axes, count in zip(
        ("gyros", "accelerometers"), (rimu.gyros, rimu.accelerometers), counts, strict=True
    ):
        if len(axes) != count:
            raise VehicleError(f"import: {count} {name} in the recording, {len(axes)} in [rimu]")
        found.append(directions(axes))
    return found[0], found[1]


def directions(axes_deg: AxesDeg) -> Floats:
    """Return unit vectors, shape (n, 3), from polar angles and azimuths in degrees."""
    alpha, beta = np.radians(np.array(axes_deg)).T
    return np.column_stack(
        [np.sin(alpha) * np.cos(beta), np.sin(alpha) * np.sin(beta), np.cos(alpha)]
    )


def _sheet(noise: Noise | None, keys: tuple[str, str, str], units: tuple[float, ...]) -> Any:
    if noise is None:
        return {}
    white, bias, walk = keys
    return {
        white: noise.white / units[0],
        bias: noise.bias_sigma / units[1],
        walk: noise.bias_walk / units[2],
        "scale_repeatability_ppm": noise.scale_sigma * 1e6,
    }


def scenario_of(
    recording: VehicleRecording,
    state: State,
    rate_hz: int,
    duration_s: float,
    keys: dict[str, Any],
    folder: Path,
) -> Scenario:
    """Return the scenario of a recording.

    Parameters
    ----------
    recording : VehicleRecording
    state : State
        Where navigation begins.
    rate_hz : int
    duration_s : float
        Of the navigation.
    keys : dict
        Go on top, key by key.
    folder : Path
        What files that they name are relative to.

    Raises
    ------
    ScenarioError
    """
    roll, pitch, heading = (math.degrees(angle) for angle in state.attitude)
    table: dict[str, Any] = {
        "title": f"{recording.name}, recorded by a vehicle",
        "mode": "strapdown",
        "duration_s": duration_s,
        "rate_hz": rate_hz,
        "navigate_at_s": NAVIGATE_AT_S,
        "site": {
            "latitude_deg": math.degrees(state.place[0]),
            "longitude_deg": math.degrees(_wrapped(float(state.place[1]))),
            "height_m": float(state.place[2]),
        },
        "body": {
            "roll_deg": roll,
            "pitch_deg": pitch,
            "heading_deg": math.degrees(_wrapped(math.radians(heading))),
        },
        "rimu": {"geometry": "orthogonal"},
        "gyros": _sheet(
            recording.gyros,
            (
                "angle_random_walk_deg_per_sqrt_h",
                "bias_repeatability_dph",
                "rate_random_walk_dph_per_sqrt_h",
            ),
            (math.radians(1.0) / _SQRT_H, _DPH, _DPH / _SQRT_H),
        ),
        "accelerometers": _sheet(
            recording.accelerometers,
            ("white_noise_ug_per_sqrt_hz", "bias_repeatability_ug", "random_walk_ug_per_sqrt_h"),
            (_UG, _UG, _UG / _SQRT_H),
        ),
        "firmware": {
            "initial_attitude": "given",
            "alignment_s": 1.0 / rate_hz,
            "height_channel": "free",
        },
        "estimator": {
            "enabled": recording.fixes is not None,
            "gate": _GATE,
            "zero_velocity_sigma_mps": state.velocity_sigma,
            "position_sigma_m": max(0.02, state.place_sigma),
            "level_sigma_arcsec": min(_LARGEST_SIGMA_ARCSEC, state.level_sigma / _ARCSEC),
            "heading_sigma_arcsec": min(_LARGEST_SIGMA_ARCSEC, state.heading_sigma / _ARCSEC),
        },
    }
    if recording.fixes is not None:
        table["gnss"] = _receiver(recording)
    for name, value in keys.items():
        both = isinstance(value, dict) and isinstance(table.get(name), dict)
        table[name] = table[name] | value if both and name != "rimu" else value
    return parse(table, f"of {recording.name}", folder)


def _receiver(recording: VehicleRecording) -> dict[str, Any]:
    fixes = recording.fixes
    assert fixes is not None
    interval_s = float(np.median(np.diff(fixes.time_s))) if len(fixes.time_s) > 1 else 1.0
    found: dict[str, Any] = {
        "rate_hz": min(10, max(1, round(1.0 / interval_s))),
        "position_noise_m": min(40.0, float(np.median(fixes.place_sigma))),
        "latency_s": 0.0,
        "lever_arm_m": [float(metres) for metres in fixes.lever_arm_b],
    }
    if fixes.velocity_sigma is not None:
        found["velocity_noise_mps"] = min(10.0, float(np.median(fixes.velocity_sigma)))
    return found


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi
