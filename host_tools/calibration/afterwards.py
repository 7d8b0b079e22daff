"""Benefit of a calibration: drawn units navigate uncalibrated, calibrated, and ideally calibrated.

The attitude is given and the axes are square: what is left is the constants' and the noise's.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import Calibration
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import ACCELEROMETER_UNITS, GYRO_UNITS, estimate
from rrins.host_tools.calibration.file import KEYS
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import drawn_unit, true_constants, unit_of
from rrins.host_tools.files import JsonObject
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.results.results import compare
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario, load
from rrins.host_tools.scenario.tables import Redundancy

RATE_HZ = 50
_SAMPLE_S = 10.0
_THREADS = 2

_ISOLATED = ", isolated"

CASES = {
    "rotating": ("rimu_rotating",),
    "drive": ("drive_strapdown", "drive_rotating", f"drive_rotating{_ISOLATED}"),
}
"""Scenarios that are navigated: three hours on the turning table; the paper's drive, 4.5, also with
the vehicle's heading isolated by the inner axis."""

VARIANTS = ("uncalibrated", "calibrated", "perfect constants", "calibrated, no noise")

_NOISE = ("angle_random_walk_deg_per_sqrt_h", "white_noise_ug_per_sqrt_hz")


@dataclass(frozen=True)
class Afterwards:
    """Navigation errors of n units in a scenario.

    Attributes
    ----------
    largest_m, end_m : array, shape (n, 4)
        Largest and last horizontal position error, by `VARIANTS`.
    """

    scenario: str
    largest_m: Floats
    end_m: Floats

    @property
    def over_floor(self) -> Floats:
        """Largest error calibrated over that with perfect constants, of each unit."""
        ratio: Floats = self.largest_m[:, 1] / self.largest_m[:, 2]
        return ratio


def calibration_of(gyros: Floats, accelerometers: Floats) -> Calibration:
    """Return a calibration of constants in SI units, shapes (m, 5), (k, 5)."""
    tables = {
        name: {
            key: tuple((constants[:, k] / units[k]).tolist()) for k, key in enumerate(KEYS[name])
        }
        for name, constants, units in (
            ("gyros", gyros, GYRO_UNITS),
            ("accelerometers", accelerometers, ACCELEROMETER_UNITS),
        )
    }
    return Calibration.model_validate(tables)


def _navigated(scenario: Scenario, calibration: Calibration) -> tuple[float, float]:
    """Return the largest and the last horizontal position error, m."""
    settings = firmware_settings(scenario).model_copy(update={"calibration": calibration})
    every = round(_SAMPLE_S * scenario.rate_hz)
    both = FastRun.of(settings, hardware_settings(scenario), every)
    track = both.run(scenario.epochs)
    errors = compare(track.navigation, track.truth, scenario.rate_hz)
    off = np.hypot(errors.position_east_m, errors.position_north_m)
    return float(off.max()), float(off[-1])


def _scenario(name: str, unit: Scenario, seed: int, duration_s: float | None) -> Scenario:
    keys: JsonObject = {
        "rate_hz": RATE_HZ,
        "seed": seed + 1000,
        "rimu": unit.rimu.model_dump(exclude_defaults=True),
        "gyros": unit.gyros.model_dump(exclude_defaults=True),
        "accelerometers": unit.accelerometers.model_dump(exclude_defaults=True),
        "redundancy": Redundancy(enabled=False).model_dump(),
    }
    if name.startswith("drive"):
        keys["motion__seed"] = seed
    if duration_s is not None:
        keys["duration_s"] = duration_s
    if name.endswith(_ISOLATED):
        keys["firmware__isolate_heading"] = True
    return load(name.removesuffix(_ISOLATED)).varied(**keys)


def _silent(scenario: Scenario) -> Scenario:
    return scenario.varied(**{f"gyros__{_NOISE[0]}": 0.0, f"accelerometers__{_NOISE[1]}": 0.0})


def navigate(
    case: str,
    scheme: Scheme,
    seeds: Sequence[int],
    duration_s: float | None = None,
    on_done: Callable[[], None] = lambda: None,
    stop: threading.Event | None = None,
) -> tuple[Afterwards, ...]:
    """Calibrate a drawn unit for each seed and navigate with it; return an entry per scenario.

    Parameters
    ----------
    case : str
        One of `CASES`.
    scheme : Scheme
        Of the calibration.
    seeds : sequence of int
        Of the units' errors; in a drive also of the route.
    duration_s : float, optional
        Other than the scenario's.
    on_done : callable
        Called after each unit.
    stop : Event, optional
        Ends the work early.

    Raises
    ------
    CalibrationRecordError
        When the scheme does not show all constants.
    KeyboardInterrupt
        When it was stopped.
    """

    def one(seed: int) -> Floats:
        unit = drawn_unit(seed)
        found = estimate(unit_of(unit), record(unit, scheme))
        calibrations = (
            Calibration(),
            calibration_of(found.gyros.constants, found.accelerometers.constants),
            calibration_of(*true_constants(unit)),
        )
        rows = []
        for name in CASES[case]:
            if stop is not None and stop.is_set():
                raise KeyboardInterrupt
            scenario = _scenario(name, unit, seed, duration_s)
            row = [_navigated(scenario, calibration) for calibration in calibrations]
            row.append(_navigated(_silent(scenario), calibrations[1]))
            rows.append(row)
        on_done()
        return np.array(rows)

    with ThreadPoolExecutor(_THREADS) as threads:
        results = np.array(list(threads.map(one, seeds)))
    return tuple(
        Afterwards(name, results[:, k, :, 0], results[:, k, :, 1])
        for k, name in enumerate(CASES[case])
    )
