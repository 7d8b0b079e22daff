"""Whether the constants of a calibration were constant: each sensor's residuals over the record.

A sensor whose bias, scale factor or installation changes at some time has residuals in proportion
to the derivative by that constant, from then on; one that drifts, in proportion to the time, or to
a temperature that settles. Such a term is fitted besides the sensor's own constants, one at a time,
and compared with the standard deviation that noise and the wandering of its bias, as the data sheet
states it, would give it. A wobble of the inner axis shows in all accelerometers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import ARCSEC
from rrins.firmware_py.core.sensors.data_sheet import DataSheet
from rrins.host_tools.calibration.estimation import (
    ACCELEROMETER_UNITS,
    GYRO_UNITS,
    Estimate,
    SensorsEstimate,
    Unit,
)
from rrins.host_tools.calibration.model import Axes, Inputs, derivatives, inputs, wobble_inputs
from rrins.host_tools.calibration.wandering import first_rows, wander_covariance
from rrins.host_tools.rounding import rounded

_SIGMAS = 5.0
"""Of one of some 130 terms: a sound calibration is refused once in 10,000."""

_EDGE = 4  # batches of the record at either end within which no change is looked for
_LEAST = 3e-3  # °/h, µg, ppm, ″: below, the model itself is not exact
_OWN = 1e-6  # share of a term that the constants must leave
_ALIKE = 0.5  # of the largest ratio: a second sensor with as much means that the base moved
_WOBBLES = (-2.0, -1.0, 2.0, 3.0, 4.0)
"""Periods of a turn; once, in the direction of the axis, is a turn of all sensors."""

_WOBBLES_SIGMAS = 7.0
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
    is_drift: bool = False


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
    wobble = _wobble(unit, found, given[1], kinds[1][-1])
    if wobble:
        return wobble
    changes = {
        kind: [
            list(_changes(kind, one, axes, sheet, inputs_of, others, found, k))
            for k in range(len(axes))
        ]
        for kind, one, axes, sheet, inputs_of, others in kinds
    }
    for kind, terms in changes.items():
        drifts = [max(change.ratio for change in of if change.is_drift) for of in terms]
        if 2 * sum(ratio > _SIGMAS for ratio in drifts) >= len(terms):
            return (
                f"the {kind}s drift, by up to {max(drifts):.0f} σ: their temperature has not "
                "settled; wait and begin anew"
            )
    for kind, terms in changes.items():
        worst = [max(of, key=lambda change: change.ratio) for of in terms]
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


def when(one: SensorsEstimate, axes: Axes, given: Inputs, found: Estimate, sensor: int) -> float:
    """Return the time, s, since which a sensor's bias or the base is another one."""
    T = found.seconds.duration_s
    own, base = derivatives(axes, one.constants, given, T, sensor)
    columns = np.hstack([own[:, :1], base[:, :3]])
    fitted = _Fitted(one, np.hstack([own, base]), T, sensor)
    steps = [fitted.steps(column) for column in columns.T]
    _, at = max((float(np.max(size**2 * square)), int(np.argmax(size**2 * square)))
                for _, size, square in steps)  # fmt: skip
    return float(fitted.times[fitted.grid[at] - 1])


def _wobble(unit: Unit, found: Estimate, given: Inputs, others: Floats) -> str | None:
    """Return in words how the inner axis wobbles, if the accelerometers show that it does."""
    one, axes, T = found.accelerometers, unit.accelerometers, found.seconds.duration_s
    assert unit.sheets is not None
    sheet, largest, words = unit.sheets[1], _WOBBLES_SIGMAS, None
    bases = [
        _Fitted(one, np.hstack([*derivatives(axes, one.constants, given, T, k), others]), T, k)
        for k in range(len(axes))
    ]
    for per_turn in _WOBBLES:
        added = wobble_inputs(found.seconds, unit.site, found.C_b_n, per_turn)[1]
        N, scatter, right = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2)
        for k, fitted in enumerate(bases):
            free = fitted.free(np.einsum("j,njp->np", axes.h[k], added))
            N += free.T @ free
            right += free.T @ fitted.residual
            sums = fitted.in_batches(free)
            scatter += free.T @ free + sums.T @ fitted.wander(sheet) @ sums
        if np.linalg.cond(N) > 1e6 or not N.any():
            continue
        sigmas = float(np.sqrt(right @ np.linalg.solve(scatter, right)))
        size = float(np.linalg.norm(np.linalg.solve(N, right))) / ARCSEC
        if sigmas > largest and size > _LEAST:
            largest = sigmas
            words = (
                f"the inner axis wobbles by {rounded(size, 2)}″, {abs(per_turn):g} times a turn, "
                f"{sigmas:.0f} σ; mend the table, or name it in the scenario's [turntable]"
            )
    return words


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


class _Fitted:
    """The residuals of a sensor, weighed, and what is fitted to them."""

    def __init__(self, one: SensorsEstimate, columns: Floats, T: Floats, sensor: int) -> None:
        usable = np.isfinite(one.after[:, sensor])
        self.sensor, self.duration_s, self.times = sensor, T, np.cumsum(T)
        self.weight = np.where(usable, 1.0 / (one.noise[sensor] * np.sqrt(T)), 0.0)
        self.residual = np.where(usable, one.after[:, sensor], 0.0) * T * self.weight
        known = columns * self.weight[:, None]
        basis, size, _ = np.linalg.svd(known / np.linalg.norm(known, axis=0).clip(1e-300), False)
        self.basis = basis[:, size > 1e-9 * size[0]]
        self.first = first_rows(len(T))
        self.grid = self.first[_EDGE:-_EDGE] if len(self.first) > 2 * _EDGE else self.first[1:2]

    def free(self, columns: Floats) -> Floats:
        """Return columns, weighed, less what is fitted of them."""
        weighed = columns * self.weight[:, None]
        left: Floats = weighed - self.basis @ (self.basis.T @ weighed)
        return left

    def in_batches(self, free: Floats) -> Floats:
        """Return the sums over each batch of what the bias contributes."""
        by_bias = free * (self.duration_s * self.weight)[:, None]
        sums: Floats = np.add.reduceat(by_bias, self.first)
        return sums

    def wander(self, sheet: DataSheet) -> Floats:
        """Return the covariance of the bias, of each batch."""
        k = self.sensor
        return wander_covariance(
            self.times[self.first], sheet.bias_instability[k], sheet.rate_random_walk[k]
        )

    def steps(self, column: Floats) -> tuple[Floats, Floats, Floats]:
        """Return a column from each time of the grid on, free; its sizes, their information."""
        later = np.arange(len(column))[:, None] >= self.grid
        weighed = column[:, None] * later
        free = self.free(weighed)
        square = (free**2).sum(axis=0)
        is_own = square > _OWN * ((weighed * self.weight[:, None]) ** 2).sum(axis=0)
        square = np.where(is_own, square, np.inf)
        return free, (free.T @ self.residual) / square, np.where(is_own, square, 0.0)


def _changes(
    kind: str, one: SensorsEstimate, axes: Axes, sheet: DataSheet, given: Inputs,
    others: Floats, found: Estimate, sensor: int,
) -> Iterator[_Change]:  # fmt: skip
    """Yield each term of a sensor, with its ratio; of changes the likeliest time."""
    T = found.seconds.duration_s
    own, base = derivatives(axes, one.constants, given, T, sensor)
    fitted = _Fitted(one, np.hstack([own, base, others]), T, sensor)
    times, C = fitted.times, fitted.wander(sheet)
    symbols, units = _SYMBOLS[kind], _UNITS[kind]

    def ratios(free: Floats, size: Floats, square: Floats, unit: float) -> Floats:
        information = np.where(square > 0.0, square, np.inf)
        sums = fitted.in_batches(free) / information
        wandering = (sums * (C @ sums)).sum(axis=0)
        found: Floats = np.abs(size) / np.sqrt((_LEAST * unit) ** 2 + 1.0 / information + wandering)
        return found

    for c in range(own.shape[1]):
        free, size, square = fitted.steps(own[:, c])
        ratio = ratios(free, size, square, units[c])
        best = int(np.argmax(ratio))
        at = times[fitted.grid[best] - 1]
        words = f"changed by {rounded(size[best] / units[c], 2)} {symbols[c]} at {at:.0f} s"
        yield _Change(float(ratio[best]), f"its {_NAMES[c]} {words}")
    warming = 1.0 - np.exp(-times / sheet.temperature_s)
    for drift, words in (
        (times - 0.5 * times[-1], f"drifted by {{}} {symbols[0]} in an hour"),
        (warming, f"warmed up by {{}} {symbols[0]}"),
    ):
        free = fitted.free((T * drift)[:, None])
        square = (free**2).sum(axis=0)
        size = (free.T @ fitted.residual) / square
        shown = size[0] / units[0] * (_HOUR if "hour" in words else 1.0)
        ratio = ratios(free, size, square, units[0] * 1.0 / (_HOUR if "hour" in words else 1.0))
        yield _Change(float(ratio[0]), f"its bias {words.format(rounded(shown, 2))}", True)
