"""Whether the constants of a calibration were constant: each sensor's residuals over the record.

A sensor whose bias, scale factor or installation changes at some time has residuals in proportion
to the derivative by that constant, from then on; one that drifts, in proportion to the time. Such a
term is fitted besides the sensor's own constants, one at a time, and compared with the standard
deviation that noise and the wandering of its bias, as the data sheet states it, would give it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.data_sheet import DataSheet
from rrins.host_tools.calibration.estimation import (
    ACCELEROMETER_UNITS,
    GYRO_UNITS,
    Estimate,
    SensorsEstimate,
    Unit,
)
from rrins.host_tools.calibration.model import Axes, Inputs, derivatives, inputs

_SIGMAS = 5.0
"""Of one of some 130 terms: a sound calibration is refused once in 10,000."""

_SHARES = (0.25, 0.5, 0.75)  # of the record, after which a change is looked for
_LEAST = 3e-3  # °/h, µg, ppm, ″: below, the model itself is not exact
_OWN = 1e-6  # share of a term that the constants must leave
_ALIKE = 0.5  # of the largest ratio: a second sensor with as much means that the base moved
_BATCH = 20  # seconds over which a wandering bias is the same
_HOUR = 3600.0

_NAMES = ("bias", "scale factor", "asymmetric scale factor", "installation", "installation")
_SYMBOLS = {
    "gyro": ("°/h", "ppm", "ppm", "″", "″"),
    "accelerometer": ("µg", "ppm", "ppm", "″", "″"),
}
_UNITS = {"gyro": GYRO_UNITS, "accelerometer": ACCELEROMETER_UNITS}


@dataclass(frozen=True)
class _Change:
    """A term of a sensor's residuals: how large, over its standard deviation."""

    ratio: float
    words: str


def unsteady(unit: Unit, found: Estimate) -> str | None:
    """Return in words which sensor's constants were none, if any; without data sheets, None."""
    if unit.sheets is None:
        return None
    given = inputs(found.seconds, unit.site, found.C_b_n, found.epsilon)
    T = found.seconds.duration_s
    kinds = (
        ("gyro", found.gyros, unit.gyros, unit.sheets[0], given[0], _of_gyros(*given, T)),
        ("accelerometer", found.accelerometers, unit.accelerometers, unit.sheets[1], given[1],
            _of_accelerometers(given[1], given[0], T)),
    )  # fmt: skip
    for kind, one, axes, sheet, inputs_of, others in kinds:
        worst = [
            max(_changes(kind, one, axes, sheet, inputs_of, others, found, k),
                key=lambda change: change.ratio)
            for k in range(len(axes))
        ]  # fmt: skip
        order = sorted(range(len(worst)), key=lambda k: -worst[k].ratio)
        first, second = worst[order[0]].ratio, worst[order[1]].ratio
        if first < _SIGMAS:
            continue
        if second > max(_SIGMAS, _ALIKE * first):
            return (
                f"{kind}s {order[0] + 1} and {order[1] + 1} were not constant, by {first:.0f} and "
                f"{second:.0f} σ: the base moved, or the temperature has not settled"
            )
        return (
            f"{kind} {order[0] + 1} was not constant: {worst[order[0]].words}, {first:.0f} σ; let "
            "it warm up, or replace it"
        )
    return None


def _changes_of(given: Inputs, duration_s: Floats) -> Floats:
    """Return by how much an input changes within each second: what a sensor that lags lacks."""
    T = duration_s[:, None]
    mean = given.x / T
    between = (mean[:-1] * T[1:] + mean[1:] * T[:-1]) / (T[:-1] + T[1:])
    changes: Floats = np.diff(np.vstack([mean[:1], between, mean[-1:]]), axis=0)
    return changes


def _of_gyros(own: Inputs, force: Inputs, duration_s: Floats) -> Floats:
    """Return what gyros feel besides their constants' terms: specific force, and with a lag."""
    return np.hstack([force.x, _changes_of(own, duration_s)])


def _of_accelerometers(own: Inputs, turn: Inputs, duration_s: Floats) -> Floats:
    """Return the same of accelerometers: centripetal away from the reference point, and a lag."""
    x, y, z = turn.x.T / np.sqrt(duration_s)
    squares = np.column_stack([x * x, y * y, z * z, x * y, y * z, z * x])
    return np.hstack([squares, _changes_of(own, duration_s)])


def _changes(
    kind: str, one: SensorsEstimate, axes: Axes, sheet: DataSheet, given: Inputs,
    others: Floats, found: Estimate, sensor: int,
) -> Iterator[_Change]:  # fmt: skip
    """Yield each term of a sensor, with its ratio."""
    T = found.seconds.duration_s
    usable = np.isfinite(one.after[:, sensor])
    times = np.cumsum(T)
    weight = np.where(usable, 1.0 / (one.noise[sensor] * np.sqrt(T)), 0.0)
    residual = np.where(usable, one.after[:, sensor], 0.0) * T * weight
    own, base = derivatives(axes, one.constants, given, T, sensor)
    known = np.hstack([own, base, others]) * weight[:, None]
    basis, size, _ = np.linalg.svd(known / np.linalg.norm(known, axis=0).clip(1e-300), False)
    basis = basis[:, size > 1e-9 * size[0]]
    symbols, units = _SYMBOLS[kind], _UNITS[kind]
    later = [(times > share * times[-1], share * times[-1]) for share in _SHARES]
    terms = [
        (
            own[:, c] * after,
            units[c],
            f"its {_NAMES[c]} changed by {{:.2g}} {symbols[c]} at {at:.0f} s",
        )
        for c in range(own.shape[1])
        for after, at in later
    ]
    drift = T * (times - 0.5 * times[-1]) / _HOUR
    terms.append((drift, units[0], f"its bias drifted by {{:.2g}} {symbols[0]} in an hour"))
    for column, unit, words in terms:
        scaled = column * weight
        free = scaled - basis @ (basis.T @ scaled)
        square = float(free @ free)
        if square <= _OWN * float(scaled @ scaled):
            continue
        size_found = float(free @ residual) / square
        shares = free * T * weight / square
        variance = (_LEAST * unit) ** 2 + 1.0 / square + _by_wandering(sheet, sensor, shares, times)
        yield _Change(abs(size_found) / variance**0.5, words.format(size_found / unit))


def _by_wandering(sheet: DataSheet, sensor: int, shares: Floats, times: Floats) -> float:
    """Return the variance of a sum of the bias times `shares`, which add up to zero.

    Minus half the sum of the shares' products times the variance of the bias' change between two
    times: of bias instability, ``B² ln(1 + π t) / π`` (IEEE Std 952-1997, annex C), of its random
    walk, and of the warm-up.
    """
    first = np.arange(0, len(times), _BATCH)
    sums, middle = np.add.reduceat(shares, first), times[first]
    lag = np.abs(middle[:, None] - middle)
    change = sheet.bias_instability[sensor] ** 2 / np.pi * np.log1p(np.pi * lag)
    change += sheet.rate_random_walk[sensor] ** 2 * lag
    warm = sheet.temperature_drift[sensor] * (1.0 - np.exp(-lag / sheet.temperature_s))
    return max(0.0, -0.5 * float(sums @ (change + warm**2) @ sums))
