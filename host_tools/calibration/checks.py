"""Checks of a calibration's residuals for faults that would spoil it unnoticed.

Between positions, the mean residual of a sensor is noise if the base rests and the constants are
constant. A tilt of the base shows in all accelerometers as a vector does; a sensor that changes, in
its own alone; a temperature that has not settled, as a slope over time.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.sensors.calibration import DPH, UG
from rrins.host_tools.calibration.estimation import Estimate, SensorsEstimate, Unit
from rrins.host_tools.calibration.model import Axes
from rrins.host_tools.calibration.observability import unseen
from rrins.host_tools.calibration.stability import unsteady

_LEAST_SIGMAS = 8.0
_OF_NEIGHBOURS = 12.0
"""Times what means of 20 s differ by from the next: in-run instability wanders that far."""

_WANDERS, _WANDERS_SIGMAS = 2.5, 20.0
"""But no further than so many times `_LEAST`, or the noise."""

_LEAST_BATCHES = 4
_LEAST = (0.5 * DPH, 40.0 * UG)
"""Below this a mean residual is the sensors' in-run instability; rad/s, m/s²."""

_BATCH_S = 20
_OF_MEDIAN = 1.4826  # standard deviation over the median of the amount, of normal numbers
_EXPLAINED = 0.8
_OFF_SLOPE = 0.3  # of the squares, at most, beside a straight line


def trouble_of(unit: Unit, found: Estimate) -> str | None:
    """Return in words what is wrong with a calibration, if anything is."""
    for kind, one, axes, least in (
        ("accelerometer", found.accelerometers, unit.accelerometers, _LEAST[1]),
        ("gyro", found.gyros, unit.gyros, _LEAST[0]),
    ):
        words = _changed(kind, one, axes, found, least)
        if words:
            return words
    hidden = unseen(unit, np.asarray(np.linalg.inv(found.covariance), dtype=np.float64))
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


def wandering(one: SensorsEstimate, found: Estimate) -> Floats:
    """Return by how much each bias wanders beyond the noise, rms, shape (m,); rad/s or m/s²."""
    means, _, noise = batches(one, found)
    if not len(means):
        return np.zeros(one.constants.shape[0])
    beyond: Floats = np.sqrt(np.maximum(0.0, (means**2).mean(axis=0) - (noise**2).mean(axis=0)))
    return beyond


def _changed(
    kind: str, one: SensorsEstimate, axes: Axes, found: Estimate, least: float
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
    at = f"after {times[k]:.0f} s"
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
