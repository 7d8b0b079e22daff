"""A recording of a real vehicle: increments of its sensors, fixes of a receiver, a reference.

All angles are in rad, lengths in m. The body frame b has the axes right, forward, up; the
navigation frame n east, north, up. Times are seconds of one clock, whatever its origin.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rrins.compiled.record import Floats

FRD_TO_RFU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Turns axes forward, right, down into right, forward, up, and north, east, down into ENU."""


@dataclass(frozen=True)
class Increments:
    """Increments of the sensors; each row covers the time from the row before to its own.

    Attributes
    ----------
    time_s : array, shape (n,)
        End of each interval, increasing.
    dtheta : array, shape (n, gyros)
        Along the input axes, rad.
    dv : array, shape (n, accelerometers)
        Along the input axes, m/s.
    """

    time_s: Floats
    dtheta: Floats
    dv: Floats

    @property
    def interval_s(self) -> float:
        """Usual time between two rows."""
        return float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True)
class Fixes:
    """Fixes of a GNSS receiver.

    Attributes
    ----------
    time_s : array, shape (n,)
        Of validity, increasing.
    place : array, shape (n, 3)
        Latitude, longitude (rad), height (m).
    place_sigma : array, shape (n, 3)
        Standard deviations east, north, up, m.
    velocity_n, velocity_sigma : array, shape (n, 3), or None
        East, north, up, m/s; None where the receiver tells none.
    lever_arm_b : array, shape (3,)
        From the sensors to the antenna, m.
    """

    time_s: Floats
    place: Floats
    place_sigma: Floats
    velocity_n: Floats | None = None
    velocity_sigma: Floats | None = None
    lever_arm_b: Floats = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Reference:
    """Truth from another source.

    Attributes
    ----------
    time_s : array, shape (n,)
    place : array, shape (n, 3)
        Latitude, longitude (rad), height (m).
    velocity_n : array, shape (n, 3), or None
        East, north, up, m/s.
    attitude : array, shape (n, 3), or None
        Roll, pitch, heading, rad.
    """

    time_s: Floats
    place: Floats
    velocity_n: Floats | None = None
    attitude: Floats | None = None


@dataclass(frozen=True)
class Noise:
    """A sensor's data sheet, in SI units; None where the recording says nothing.

    Attributes
    ----------
    white : float
        rad/√s or (m/s)/√s.
    bias_sigma : float
        Standard deviation of the bias, rad/s or m/s².
    bias_walk : float
        Of the bias: rad/s/√s or m/s²/√s.
    scale_sigma : float
        Of the scale factor, a share of 1.
    """

    white: float
    bias_sigma: float
    bias_walk: float = 0.0
    scale_sigma: float = 0.0


@dataclass(frozen=True)
class Beginning:
    """Initial state of the navigation in a recording; None where it has none.

    Attributes
    ----------
    time_s : float or None
    place : array, shape (3,), or None
        Latitude, longitude (rad), height (m).
    place_sigma : float or None
        m.
    velocity_n : array, shape (3,), or None
        m/s.
    velocity_sigma : float or None
        m/s.
    attitude : array, shape (3,), or None
        Roll, pitch, heading, rad.
    level_sigma, heading_sigma : float or None
        rad.
    """

    time_s: float | None = None
    place: Floats | None = None
    place_sigma: float | None = None
    velocity_n: Floats | None = None
    velocity_sigma: float | None = None
    attitude: Floats | None = None
    level_sigma: float | None = None
    heading_sigma: float | None = None


@dataclass(frozen=True)
class VehicleRecording:
    """A recording of a vehicle, whatever its format.

    Attributes
    ----------
    name : str
        What a person calls it.
    kind : str
        Its format: ``csv``, ``kf-gins`` or ``navego``.
    files : tuple of Path
        Where it was read.
    increments : Increments
    fixes : Fixes or None
    reference : Reference or None
    beginning : Beginning
    gyros, accelerometers : Noise or None
    axes_are_body : bool
        Whether there are three sensors of each kind, along right, forward, up of the body; else a
        scenario's `[rimu]` says where they point.
    ends_s : float or None
        Until when it is to be navigated; None: to the end.
    """

    name: str
    kind: str
    files: tuple[Path, ...]
    increments: Increments
    fixes: Fixes | None
    reference: Reference | None
    beginning: Beginning
    gyros: Noise | None = None
    accelerometers: Noise | None = None
    axes_are_body: bool = True
    ends_s: float | None = None
