"""The unit that is calibrated where none is named: prototype sensors with errors that are drawn."""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.calibration.estimation import Unit
from rrins.host_tools.calibration.model import Axes, Site
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.hardware.units import ARCSEC, in_si
from rrins.host_tools.runs.set_up.data_sheets import data_sheets_of
from rrins.host_tools.runs.set_up.settings import given_pose
from rrins.host_tools.scenario.scenario import Scenario, parse

LARGEST_BIAS_DPH, LARGEST_BIAS_UG = 10.0, 3000.0
SCALE_PPM, INSTALLATION_ARCSEC = 50.0, 30.0
TILT_ARCSEC, HEADING_DEG = 412.5, 1.0
"""By how much the base stands otherwise than the computer is told: 2 mrad and 1°."""

SQUARE_ARCSEC = 30.0
"""By how much the axes are out of square."""

_CONSTANTS = (
    "bias",
    "scale_error",
    "asymmetric_scale_error",
    "installation_u",
    "installation_v",
)
_STREAM = 14


def drawn_unit(seed: int = 1, rimu: JsonObject | None = None, noise: float = 1.0) -> Scenario:
    """Return a unit with the prototype's white noise, and errors that are drawn.

    Biases are uniform up to 10 °/h and 3 mg; scale factors, both, have a standard deviation of
    50 ppm, installation angles of 30″. The base is tilted by 2 mrad and turned by 1° from what the
    computer is given, and the axes are 30″ out of square. The prototype's in-run instability, which
    no calibration removes, is left out.

    Parameters
    ----------
    seed : int
        Of the errors and of the noise.
    rimu : dict, optional
        The table `[rimu]` of a scenario; the tetrahedron by default.
    noise : float
        Times the prototype's.
    """
    table: JsonObject = {
        "title": "a unit with prototype noise and drawn errors",
        "duration_s": 10_800.0,
        "seed": seed,
        "site": {"latitude_deg": 40.3554, "longitude_deg": 116.668, "height_m": 40.0},
        "rimu": rimu or {"geometry": "tetrahedron"},
        "turntable": {"non_orthogonality_arcsec": SQUARE_ARCSEC},
        "firmware": {
            "roll_error_arcsec": TILT_ARCSEC * math.sqrt(0.5),
            "pitch_error_arcsec": -TILT_ARCSEC * math.sqrt(0.5),
            "heading_error_arcsec": 3600.0 * HEADING_DEG,
        },
    }
    bare = parse(table, "drawn unit")
    rng = np.random.default_rng([seed, _STREAM])
    gyros, accelerometers = len(bare.rimu.gyros), len(bare.rimu.accelerometers)
    table["gyros"] = {
        "bias_dph": rng.uniform(-1, 1, gyros) * LARGEST_BIAS_DPH,
        **_drawn(rng, gyros),
        "angle_random_walk_deg_per_sqrt_h": 0.005 * noise,
    }
    table["accelerometers"] = {
        "bias_ug": rng.uniform(-1, 1, accelerometers) * LARGEST_BIAS_UG,
        **_drawn(rng, accelerometers),
        "white_noise_ug_per_sqrt_hz": 10.0 * noise,
    }
    for kind in ("gyros", "accelerometers"):
        table[kind] = {
            key: tuple(value.tolist()) if isinstance(value, np.ndarray) else value
            for key, value in table[kind].items()
        }
    return parse(table, "drawn unit")


def _drawn(rng: np.random.Generator, count: int) -> dict[str, Floats]:
    return {
        "scale_error_ppm": rng.normal(0.0, SCALE_PPM, count),
        "asymmetric_scale_error_ppm": rng.normal(0.0, SCALE_PPM, count),
        "installation_u_arcsec": rng.normal(0.0, INSTALLATION_ARCSEC, count),
        "installation_v_arcsec": rng.normal(0.0, INSTALLATION_ARCSEC, count),
    }


def unit_of(scenario: Scenario) -> Unit:
    """Return what the computer of a scenario is told about its unit."""
    pose = given_pose(scenario)
    attitude = (math.radians(a) for a in (pose.roll_deg, pose.pitch_deg, pose.heading_deg))
    return Unit(
        gyros=Axes.of(scenario.rimu.gyros),
        accelerometers=Axes.of(scenario.rimu.accelerometers),
        site=Site(math.radians(pose.latitude_deg), pose.height_m),
        C_b_n=body_to_navigation(*attitude),
        sheets=data_sheets_of(scenario),
        wobble=(scenario.turntable.wobble_arcsec * ARCSEC, scenario.turntable.wobble_per_turn),
    )


def true_constants(scenario: Scenario) -> tuple[Floats, Floats]:
    """Return the constants of gyros and accelerometers that a scenario sets, SI units.

    Shapes (m, 5), (k, 5). What a run draws on top is not in them.
    """
    found = []
    for table, axes in (
        (scenario.gyros, scenario.rimu.gyros),
        (scenario.accelerometers, scenario.rimu.accelerometers),
    ):
        values = in_si(table)
        found.append(
            np.column_stack([np.broadcast_to(values[name], len(axes)) for name in _CONSTANTS])
        )
    return found[0], found[1]
