"""The truth of a vehicle's recording: what somebody else found, at the epochs of the samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from rrins.compiled.record import Floats, Integers, Records
from rrins.firmware_py.core.maths.earth import radii
from rrins.host_tools.hardware.memory import Truth
from rrins.host_tools.logs.epochs import LogSteps
from rrins.host_tools.runs.results.samples import SampleFile
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.vehicle.csv_folder import read_truth
from rrins.host_tools.vehicle.recording import Reference

_radii = getattr(radii, "py_func", radii)  # one call is not worth the compiler's start


class ReferenceTruth:
    """Gives the truth of a recording from a file, as `RecomputedTruth` does by repeating it.

    Parameters
    ----------
    path : Path or None
        CSV file, time by the clock of the bus; None if the recording came without one.
    scenario : Scenario
    file : SampleFile
        Receives the truth when it is closed.
    log_every : int
        Epochs between rows.

    Attributes
    ----------
    why_not : str or None
        Why there is no truth; None if there is one.

    Raises
    ------
    VehicleError
        If the file cannot be used.
    """

    def __init__(
        self, path: Path | None, scenario: Scenario, file: SampleFile, log_every: int
    ) -> None:
        self.why_not = None if path is not None else "the vehicle's recording came without one"
        self._reference = None if path is None else read_truth(path)
        self._period_s = scenario.period_ns * 1e-9
        self._file = file
        self._log_every = log_every
        self._last = -1

    def follow(self, steps: LogSteps) -> None:
        """Note how far the log goes."""
        if len(steps.epochs):
            self._last = max(self._last, int(steps.epochs.max()))

    def close(self) -> None:
        """Write the truth to the file."""
        if self._reference is not None and self._last >= 0:
            epochs = np.arange(0, self._last + 1, self._log_every)
            self._file.append(truth_at(self._reference, epochs, self._period_s))


def truth_at(reference: Reference, epochs: Integers, period_s: float) -> Records[Truth]:
    """Return the truth at the ends of those epochs that the reference covers.

    Positions between two of its rows follow their velocities, if it has any: a cubic. What it does
    not have is not a number; a velocity is then the slope of the positions.
    """
    time_s = epochs * period_s
    covered = (time_s >= reference.time_s[0]) & (time_s <= reference.time_s[-1])
    epochs, time_s = epochs[covered], time_s[covered]
    rows = Truth.zeros(len(epochs))
    place, velocity = _path(reference, time_s)
    rows["epoch"] = epochs
    rows["latitude"], rows["longitude"], rows["height"] = place.T
    rows["velocity_n"] = velocity
    for k, name in enumerate(("roll", "pitch", "heading")):
        rows[name] = np.nan
        if reference.attitude is not None:
            angles = np.unwrap(reference.attitude[:, k])
            rows[name] = np.interp(time_s, reference.time_s, angles)
    return rows


def _path(reference: Reference, time_s: Floats) -> tuple[Floats, Floats]:
    """Return latitude, longitude, height and the velocity east, north, up, shape (n, 3) each."""
    place = reference.place.copy()
    place[:, 1] = np.unwrap(place[:, 1])
    meridian, prime_vertical = _radii(float(np.mean(place[:, 0])))
    height = float(np.mean(place[:, 2]))
    metres = np.array(
        [meridian + height, (prime_vertical + height) * np.cos(np.mean(place[:, 0])), 1.0]
    )
    origin = place[0]
    local = (place - origin) * metres
    if reference.velocity_n is None:
        spline = CubicSpline(reference.time_s, local)
    else:
        spline = CubicHermiteSpline(reference.time_s, local, _slopes(reference, metres, place))
    found = origin + spline(time_s) / metres
    if reference.velocity_n is None:
        return found, spline(time_s, 1)[:, [1, 0, 2]]
    velocity = np.column_stack(
        [np.interp(time_s, reference.time_s, column) for column in reference.velocity_n.T]
    )
    return found, velocity


def _slopes(reference: Reference, metres: Floats, place: Floats) -> Floats:
    """Return velocities as slopes of the local metres, whose scale is that of the mean place."""
    assert reference.velocity_n is not None
    slopes = reference.velocity_n[:, [1, 0, 2]].copy()
    slopes[:, 1] *= np.cos(np.mean(place[:, 0])) / np.cos(place[:, 0])
    return slopes
