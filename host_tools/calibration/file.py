"""The calibration file of an estimate: TOML as the firmware loads it, with σ, date, temperature."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import ARCSEC, Origin
from rrins.host_tools.calibration.estimation import (
    ACCELEROMETER_UNITS,
    GYRO_UNITS,
    Estimate,
    SensorsEstimate,
)
from rrins.host_tools.rounding import kept, rounded
from rrins.host_tools.runs.results.sensor_errors import CONSTANTS, KINDS

KEYS = {name: (bias.key, *(one.key for one in CONSTANTS)) for name, bias in KINDS.items()}
"""Keys of a calibration file, in the order of the constants."""


def both(found: Estimate) -> Iterator[tuple[str, SensorsEstimate, Floats]]:
    """Yield name, estimate and units of gyros and of accelerometers."""
    yield "gyros", found.gyros, GYRO_UNITS
    yield "accelerometers", found.accelerometers, ACCELEROMETER_UNITS


UNKNOWN = Origin()


def to_toml(found: Estimate, how: Sequence[str], origin: Origin = UNKNOWN) -> str:
    """Return the file.

    Parameters
    ----------
    how : sequence of str
        How it was obtained, a comment each.
    origin : Origin
        When, and how warm the sensors were.
    """
    lines = (*(f"# {line}" for line in how), *_notes(found), *_calibrated(origin), *_tables(found))
    return "\n".join(lines) + "\n"


def _calibrated(origin: Origin) -> Iterator[str]:
    yield "\n[calibrated]"
    if origin.date_utc is not None:
        yield f"date_utc = {origin.date_utc:%Y-%m-%dT%H:%M:%SZ}"
    if origin.temperature_c is not None:
        yield f"temperature_c = {origin.temperature_c!r}"


def _notes(found: Estimate) -> Iterator[str]:
    heading = found.base_sigma[2] / ARCSEC
    squareness, sigma_of_it = found.epsilon / ARCSEC, found.epsilon_sigma / ARCSEC
    yield f"# axes out of square by {squareness:.2f}″ (σ {sigma_of_it:.2f}″)"
    yield f"# base's azimuth known to {heading:.0f}″"


def _tables(found: Estimate) -> Iterator[str]:
    for name, one, units in both(found):
        yield f"\n[{name}]"
        for k, key in enumerate(KEYS[name]):
            values = ", ".join(f"{value:.6g}" for value in one.constants[:, k] / units[k])
            yield f"{key} = [{values}]"
        yield f"\n[{name}.sigma]"
        for k, key in enumerate(KEYS[name]):
            each = ", ".join(str(kept(value, 3)) for value in one.sigma[:, k] / units[k])
            rms = np.sqrt((one.sigma[:, k] ** 2).mean()) / units[k]
            yield f"{key} = [{each}]  # rms {rounded(rms, 2)}"
