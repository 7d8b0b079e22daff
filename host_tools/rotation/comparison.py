"""Schemes side by side: what each leaves of every error, its time and the travel of its axes."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.files import JsonObject
from rrins.host_tools.rotation.analysis import Integrals, Variation, analyse
from rrins.host_tools.rotation.errors import ERRORS
from rrins.host_tools.rotation.inputs import NamedRimu, NamedScheme
from rrins.host_tools.rotation.merit import VelocityError, velocity_error
from rrins.host_tools.rotation.travel import Travel, travel_of


def compared(
    named: NamedScheme, rimu: NamedRimu, earth_latitude_deg: float | None = None
) -> JsonObject:
    """Return one scheme of a comparison, as `comparison_object` describes it."""
    both = (rimu.rimu.gyros, rimu.rimu.accelerometers)
    variation = analyse(named.scheme, *both, earth_latitude_deg=earth_latitude_deg)
    return comparison_object(named, variation, velocity_error(named.scheme, rimu.rimu))


def comparison_object(
    named: NamedScheme, variation: Variation, velocity: VelocityError
) -> JsonObject:
    """Return one scheme of a comparison for JSON.

    `residual` is the root of the sum of squares over sensors and axes, `excursion` the largest on
    any axis of any sensor, per kind of sensor and error.
    """
    errors: JsonObject = {}
    for integrals in (variation.gyros, variation.accelerometers):
        left = magnitudes_left(integrals)
        errors[integrals.sensors.kind] = {
            error: {
                "unit": integrals.sensors.unit,
                "residual": float(np.linalg.norm(left[:, k])),
                "excursion": float(integrals.excursion[:, k].max()),
                "axes_left": [axis for j, axis in enumerate("xyz") if np.any(left[:, k, j] > 0)],
            }
            for k, error in enumerate(ERRORS)
        }
    return {
        "scheme": scheme_object(named),
        "errors": errors,
        "travel": travel_object(travel_of(named.scheme)),
        "velocity_error_rms_mps": velocity.rms_mps,
        "velocity_error_growth_mps_per_h": velocity.growth_mps_per_h,
    }


def scheme_object(named: NamedScheme) -> JsonObject:
    """Return a scheme for JSON."""
    scheme = named.scheme
    return {
        "name": named.name,
        "turns": [turn.model_dump() for turn in scheme.turns],
        "turn_rate_dps": scheme.turn_rate_dps,
        "stand_s": scheme.stand_s,
        "cycle_s": scheme.cycle_s,
    }


def travel_object(travel: Travel) -> JsonObject:
    """Return the travel of both axes for JSON, deg."""
    return asdict(travel) | {"returns": travel.returns}


def magnitudes_left(integrals: Integrals) -> Floats:
    """Return the magnitudes of the residuals, 0 where they are negligible."""
    left: Floats = np.where(integrals.vanishes, 0.0, np.abs(integrals.residual))
    return left
