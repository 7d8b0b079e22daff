"""Checks of a calibration's residuals for faults that would spoil it unnoticed.

Between positions, the mean residual of a sensor is noise if the base rests and the constants are
constant; from second to second it scatters as the data sheet says. A tilt of the base shows in all
accelerometers as a vector does; a sensor that changes, in its own alone; a temperature that has not
settled, as a slope over time.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.host_tools.calibration.estimation import Estimate, SensorsEstimate, Unit
from rrins.host_tools.calibration.model import Axes, Inputs, inputs
from rrins.host_tools.calibration.observability import unseen
from rrins.host_tools.calibration.stability import unsteady, when
from rrins.host_tools.rounding import rounded

_LEAST_SIGMAS = 8.0
_OF_NEIGHBOURS = 12.0
"""Times what means of 20 s differ by from the next: in-run instability wanders that far."""

_WANDERS, _WANDERS_SIGMAS = 2.5, 20.0
"""But no further than so many times `_LEAST`, or the noise."""

_LEAST_BATCHES = 4
_LEAST = (0.5 * DPH, 40.0 * UG)
"""Below this a mean residual is the sensors' in-run instability; rad/s, m/s²."""

_OF_INSTABILITY = 6.0
"""Times the data sheet's bias instability, which wanders over the record by some twice its size."""

_LEAST_SCATTER = (0.3 * DPH, 10.0 * UG)
"""Noise of a second that is never taken as less: counts of the frames."""

_LOUD = 4.0
"""Times its noise that a sensor does not scatter."""

_BATCH_S = 20
_OF_MEDIAN = 1.4826  # standard deviation over the median of the amount, of normal numbers
_EXPLAINED = 0.8
_OFF_SLOPE = 0.3  # of the squares, at most, beside a straight line


def trouble_of(unit: Unit, found: Estimate) -> str | None:
    """Return in words what is wrong with a calibration, if anything is."""
    given = inputs(found.seconds, unit.site, found.C_b_n, found.epsilon)
    kinds = (
        ("accelerometer", found.accelerometers, unit.accelerometers, _LEAST[1], given[1]),
        ("gyro", found.gyros, unit.gyros, _LEAST[0], given[0]),
    )
    for kind, one, *_ in kinds:
        words = _scatters(kind, one, unit, found)
        if words:
            return words
    for kind, one, axes, least, given_of in kinds:
        limit = np.full(len(axes), least)
        if unit.sheets is not None:
            sheet = unit.sheets[0 if kind == "gyro" else 1]
            limit = np.maximum(limit, _OF_INSTABILITY * np.array(sheet.bias_instability))
        words = _changed(kind, one, axes, found, limit, given_of)
        if words:
            return words
    hidden = unseen(unit, found.information)
    if hidden:
        return (
            f"too little time on the table: {found.seconds.total_s:.0f} s do not show the "
            f"{hidden[0].parts[0][0]}; see `rrins scheme observability`"
        )
    return unsteady(unit, found)


def batches(one: SensorsEstimate, found: Estimate) -> tuple[Floats, Floats, Floats]:
    """Return the mean residuals of 20 s, their times (s since the begin), and their noise.

    Shapes (n, m), (n,), (n, m); residuals in rad/s or m/s². The noise is that between neighbouring
    seconds: what changes slowly is not in it.
    """
    count = len(found.seconds) // _BATCH_S
    whole = one.after[: count * _BATCH_S].reshape(count, _BATCH_S, -1)
    times = np.cumsum(found.seconds.duration_s)[_BATCH_S - 1 : count * _BATCH_S : _BATCH_S]
    used = np.isfinite(whole).sum(axis=1)
    sums = np.where(np.isfinite(whole), whole, 0.0).sum(axis=1)
    means = np.where(used > 0, sums / np.maximum(used, 1), 0.0)
    noise = _OF_MEDIAN * np.nanmedian(np.abs(np.diff(one.after, axis=0)), axis=0) / np.sqrt(2.0)
    return means, times, noise / np.sqrt(np.maximum(used, 1))


def _scatters(kind: str, one: SensorsEstimate, unit: Unit, found: Estimate) -> str | None:
    """Return in words that sensors scatter by more than their data sheet says."""
    if unit.sheets is None:
        return None
    is_gyro = kind == "gyro"
    sheet, least = unit.sheets[0 if is_gyro else 1], _LEAST_SCATTER[0 if is_gyro else 1]
    changes = np.abs(np.diff(one.after, axis=0))
    scatter = _OF_MEDIAN * np.nanmedian(changes, axis=0) / np.sqrt(2.0)
    ratio = scatter / np.maximum(np.hypot(sheet.white_noise, sheet.resolution), least)
    k = int(np.argmax(ratio))
    if ratio[k] < _LOUD:
        return None
    size = f"{rounded(scatter[k] / DPH, 2)} °/h" if is_gyro else f"{rounded(scatter[k] / UG, 2)} µg"
    by = f"by {size} from second to second, {ratio[k]:.0f} times their noise"
    if 2 * np.sum(ratio > _LOUD) > len(ratio):
        return f"the base moves: the {kind}s scatter {by}; let it stand still"
    return f"{kind} {k + 1} scatters {by.replace('their', 'its')}; replace it"


def _changed(
    kind: str, one: SensorsEstimate, axes: Axes, found: Estimate, least: Floats, given: Inputs
) -> str | None:
    means, times, noise = batches(one, found)
    if len(means) < _LEAST_BATCHES:
        return None
    neighbours = _OF_MEDIAN * np.median(np.abs(np.diff(means, axis=0)), axis=0) / np.sqrt(2.0)
    wandering = np.minimum(
        _OF_NEIGHBOURS * neighbours, np.maximum(_WANDERS_SIGMAS * noise, _WANDERS * least)
    )
    limit = np.maximum(np.maximum(_LEAST_SIGMAS * noise, wandering), least)
    ratio = np.abs(means) / limit
    k, sensor = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    if ratio[k, sensor] < 1.0:
        return None
    at = f"after {when(one, axes, given, found, int(sensor)):.0f} s"
    worst = means[:, sensor]
    centred = times - times.mean()
    slope = (centred @ worst) / (centred @ centred)
    is_slope = np.sum((worst - slope * centred - worst.mean()) ** 2) < _OFF_SLOPE * np.sum(worst**2)
    if is_slope and 2 * np.sum(ratio.max(axis=0) >= 1.0) >= len(axes):
        return f"the {kind}s drift: their temperature has not settled; wait and begin anew"
    vector = means @ np.linalg.pinv(axes.h).T @ axes.h.T
    loud = ratio.max(axis=1) >= 1.0
    explained = np.sum(vector[loud] ** 2) / np.sum(means[loud] ** 2)
    largest = np.abs(means[loud]).max(axis=0)
    others = np.delete(largest, sensor).max() / largest[sensor]
    if explained > _EXPLAINED and others > 0.3:
        moved = "the base tilted or moved" if kind == "accelerometer" else "the base turned"
        return f"{moved} {at}"
    return f"{kind} {sensor + 1} changed {at}"
