"""How far a unit is off in a vehicle that turns, by rotation scheme: linear, without runs.

The route is that of the paper's drive (4.5); the table moves as the scheme says, without ramps.
With an isolated heading the inner axis takes the vehicle's turn out besides: whenever the outer
axis is at 0° or 180°, the sensors point as they would in a vehicle that keeps its heading.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import ACCELEROMETER_UNITS, GYRO_UNITS
from rrins.host_tools.calibration.file import KEYS
from rrins.host_tools.calibration.observability import LIMITS
from rrins.host_tools.covariance.kinds import Constant, Effect, White
from rrins.host_tools.covariance.path import INTERVAL_S, path_along
from rrins.host_tools.covariance.unaided import Unaided
from rrins.host_tools.files import JsonObject
from rrins.host_tools.hardware.memory import INNER, OUTER, Truth
from rrins.host_tools.hardware.units import DEG_PER_SQRT_H, UG
from rrins.host_tools.rotation.kinematics import legs_of
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.geometry import AxesDeg
from rrins.host_tools.scenario.scenario import Scenario, load
from rrins.host_tools.scenario.tables import each

_RATE_HZ = 50
_EFFECTS: tuple[Effect, ...] = ("bias", "scale", "asymmetry", "delta_u", "delta_v")
_NOISE = (0.005 * DEG_PER_SQRT_H, 10.0 * UG)
"""White noise of the prototype."""

_ACROSS = 0.05  # of the cosine of the outer angle: the inner axis is level, its turns are free


@dataclass(frozen=True)
class Turning:
    """σ of the position at the end of n routes, m, shape (n,)."""

    name: str
    constants: Floats  #: that the constants give which a table of errors has as σ
    calibrated: Floats  #: that the constants give which a calibration is to leave, `LIMITS`
    noise: Floats  #: that the prototype's white noise gives

    def values(self) -> JsonObject:
        """Return the root mean squares over the routes, m."""
        together = np.hypot(self.calibrated, self.noise)
        columns = {
            "constants_m": self.constants,
            "calibrated_m": self.calibrated,
            "noise_m": self.noise,
            "calibrated_with_noise_m": together,
        }
        return {"scheme": self.name} | {
            name: float(np.sqrt((column**2).mean())) for name, column in columns.items()
        }


def angles_of(scheme: Scheme, times_s: Floats) -> Floats:
    """Return inner and outer angle at some times, rad, shape (n, 2); cycle follows cycle."""
    legs = legs_of(scheme)
    ends = np.cumsum([leg.duration_s for leg in legs])
    knots = np.concatenate([[0.0], ends])
    angles = np.radians([legs[0].start_deg, *(leg.end_deg for leg in legs)])
    cycle, within = np.divmod(times_s, knots[-1])
    columns = [
        np.interp(within, knots, column) + cycle * (column[-1] - column[0]) for column in angles.T
    ]
    return np.column_stack(columns)


def isolated(angles: Floats, heading: Floats) -> Floats:
    """Return the table's angles, with the vehicle's turn taken out by the inner axis.

    The inner axis is turned against the heading's change about the vertical, times the cosine of
    the outer angle. Whole turns are dropped where the inner axis is level.
    """
    turned = -(np.unwrap(heading) - heading[0])  # about the vertical, upwards
    cosine = np.cos(angles[:, OUTER])
    whole = np.zeros(len(turned))
    for k in range(1, len(turned)):
        crosses = abs(cosine[k]) < _ACROSS or cosine[k] * cosine[k - 1] < 0.0
        whole[k] = np.round(turned[k] / (2.0 * np.pi)) if crosses else whole[k - 1]
    taken = angles.copy()
    taken[:, INNER] -= (turned - 2.0 * np.pi * whole) * cosine
    return taken


@lru_cache(maxsize=32)
def _route(seed: int) -> tuple[Scenario, Records[Truth]]:
    scenario = load("drive_strapdown").varied(rate_hz=_RATE_HZ, motion__seed=seed)
    every = round(INTERVAL_S * _RATE_HZ)
    both = FastRun.of(firmware_settings(scenario), hardware_settings(scenario), every)
    return scenario, both.run(scenario.epochs).truth


def _constants(sigmas: tuple[Floats, Floats]) -> list[Constant]:
    """Return the error sources; σ of shapes (m, 5) and (k, 5), SI units."""
    return [
        Constant(
            f"{kind}, {effect}",
            np.zeros(len(one)),
            np.diag(one[:, k] ** 2),
            np.zeros((len(one), 0)),
            kind,
            effect,
        )
        for kind, one in zip(KEYS, sigmas, strict=True)
        for k, effect in enumerate(_EFFECTS)
    ]


def _sigmas(errors: JsonObject, axes: tuple[AxesDeg, AxesDeg]) -> tuple[Floats, Floats]:
    found = [
        np.column_stack(
            [
                np.multiply(each(errors.get(kind, {}).get(key, 0.0), len(of)), unit)
                for key, unit in zip(KEYS[kind], units, strict=True)
            ]
        )
        for kind, of, units in zip(KEYS, axes, (GYRO_UNITS, ACCELEROMETER_UNITS), strict=True)
    ]
    return found[0], found[1]


def compare(
    schemes: Sequence[tuple[str, Scheme]],
    axes: tuple[AxesDeg, AxesDeg],
    errors: JsonObject,
    seeds: Sequence[int],
    on_done: Callable[[], None] = lambda: None,
) -> tuple[Turning, ...]:
    """Return how far each scheme is off on some routes: strapdown, then each without and with.

    Parameters
    ----------
    schemes : sequence of (str, Scheme)
    axes : tuple of two
        Input axes of gyros and accelerometers.
    errors : dict
        Tables `gyros` and `accelerometers` of a scenario: σ of each constant.
    seeds : sequence of int
        Routes.
    on_done : callable
        Called after each route.
    """
    limits = tuple(
        np.tile(limit * unit, (len(of), 1))
        for limit, unit, of in zip(LIMITS, (GYRO_UNITS, ACCELEROMETER_UNITS), axes, strict=True)
    )
    sets = _constants(_sigmas(errors, axes)), _constants((limits[0], limits[1]))
    noise = [
        White(kind, kind, np.full(len(of), density))
        for kind, of, density in zip(KEYS, axes, _NOISE, strict=True)
    ]
    names = ["strapdown", *(f"{name}{how}" for name, _ in schemes for how in ("", ", isolated"))]
    rows = np.zeros((len(names), len(seeds), 3))
    for number, seed in enumerate(seeds):
        scenario, truth = _route(seed)
        rimu = {"gyros": axes[0], "accelerometers": axes[1]}
        times_s = np.arange(len(truth), dtype=np.float64) * INTERVAL_S
        tables = [np.zeros((len(truth), 2))]
        for _, scheme in schemes:
            angles = angles_of(scheme, times_s)
            tables += [angles, isolated(angles, truth["heading"])]
        for row, angles in zip(rows, tables, strict=True):
            model = Unaided(scenario, path_along(truth, angles), rimu)
            variances = [
                sum(float(np.trace(model.of_drawn(one).horizontal[-1])) for one in constants)
                for constants in sets
            ]
            variances.append(
                sum(float(np.trace(model.of_white(one).horizontal[-1])) for one in noise)
            )
            row[number] = np.sqrt(variances)
        on_done()
    return tuple(
        Turning(name, *np.moveaxis(row, -1, 0)) for name, row in zip(names, rows, strict=True)
    )
