"""Whole calibrations of drawn units, in threads: errors beside the standard deviations reported."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.calibration.estimation import (
    ACCELEROMETER_UNITS,
    GYRO_UNITS,
    Estimate,
    estimate,
)
from rrins.host_tools.calibration.table import record
from rrins.host_tools.calibration.unit import drawn_unit, true_constants, unit_of
from rrins.host_tools.files import JsonObject
from rrins.host_tools.scenario.scenario import Scenario

_THREADS = 4


@dataclass(frozen=True)
class Errors:
    """Errors that calibrations of n units left in the constants of m sensors of a kind.

    Attributes
    ----------
    error, sigma : array, shape (n, m, 5)
        Estimate less truth, and its reported standard deviation; °/h or µg, ppm, ppm, ″, ″.
    """

    error: Floats
    sigma: Floats

    @property
    def median_rms(self) -> Floats:
        """Median over the units of the root mean square over the sensors, shape (5,)."""
        rms: Floats = np.median(np.sqrt((self.error**2).mean(axis=1)), axis=0)
        return rms

    @property
    def rms(self) -> Floats:
        """Root mean square over units and sensors, shape (5,)."""
        rms: Floats = np.sqrt((self.error**2).mean(axis=(0, 1)))
        return rms

    @property
    def reported(self) -> Floats:
        """Root mean square of the reported standard deviations, shape (5,)."""
        rms: Floats = np.sqrt((self.sigma**2).mean(axis=(0, 1)))
        return rms

    @property
    def normalised(self) -> Floats:
        """Root mean square of error over standard deviation, shape (5,): 1 where they agree."""
        rms: Floats = np.sqrt(((self.error / self.sigma) ** 2).mean(axis=(0, 1)))
        return rms


def errors_of(scenario: Scenario, found: Estimate) -> tuple[Errors, Errors]:
    """Return the errors of one calibration, gyros and accelerometers, n = 1."""
    truth = true_constants(scenario)
    gyros, accelerometers = (
        Errors(((one.constants - true) / unit)[None], (one.sigma / unit)[None])
        for one, true, unit in zip(
            (found.gyros, found.accelerometers),
            truth,
            (GYRO_UNITS, ACCELEROMETER_UNITS),
            strict=True,
        )
    )
    return gyros, accelerometers


def run(
    scheme: Scheme,
    seeds: Sequence[int],
    rimu: JsonObject | None = None,
    on_done: Callable[[], None] = lambda: None,
    stop: threading.Event | None = None,
) -> tuple[Errors, Errors]:
    """Calibrate a drawn unit for each seed; return the errors of gyros and accelerometers.

    Parameters
    ----------
    rimu : dict, optional
        The table `[rimu]` of a scenario.
    on_done : callable
        Called after each calibration.
    stop : Event, optional
        Ends the work early.

    Raises
    ------
    CalibrationRecordError
        When the scheme does not show all constants.
    KeyboardInterrupt
        When it was stopped.
    """

    def one(seed: int) -> tuple[Errors, Errors]:
        if stop is not None and stop.is_set():
            raise KeyboardInterrupt
        scenario = drawn_unit(seed, rimu)
        found = errors_of(scenario, estimate(unit_of(scenario), record(scenario, scheme)))
        on_done()
        return found

    with ThreadPoolExecutor(_THREADS) as threads:
        results = list(threads.map(one, seeds))
    gyros, accelerometers = (
        Errors(
            np.concatenate([result[kind].error for result in results]),
            np.concatenate([result[kind].sigma for result in results]),
        )
        for kind in range(2)
    )
    return gyros, accelerometers
