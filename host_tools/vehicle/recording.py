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
    """Increments of the sensors; each row covers the time from the row before to its own."""

    time_s: Floats  #: shape (n,); end of each interval, increasing
    dtheta: Floats  #: shape (n, gyros); along the input axes, rad
    dv: Floats  #: shape (n, accelerometers); along the input axes, m/s

    @property
    def interval_s(self) -> float:
        """Usual time between two rows."""
        return float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True)
class Fixes:
    """Fixes of a GNSS receiver.

    Attributes
    ----------
    velocity_n, velocity_sigma : array, shape (n, 3), or None
        East, north, up, m/s; None where the receiver tells none.
    """

    time_s: Floats  #: shape (n,); of validity, increasing
    place: Floats  #: shape (n, 3); latitude, longitude (rad), height (m)
    place_sigma: Floats  #: shape (n, 3); standard deviations east, north, up, m
    velocity_n: Floats | None = None
    velocity_sigma: Floats | None = None
    #: shape (3,); from the sensors to the antenna, m
    lever_arm_b: Floats = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Reference:
    """Truth from another source."""

    time_s: Floats  #: shape (n,)
    place: Floats  #: shape (n, 3); latitude, longitude (rad), height (m)
    velocity_n: Floats | None = None  #: east, north, up, m/s
    attitude: Floats | None = None  #: roll, pitch, heading, rad


@dataclass(frozen=True)
class Noise:
    """A sensor's data sheet, in SI units; None where the recording says nothing."""

    white: float  #: rad/√s or (m/s)/√s
    bias_sigma: float  #: standard deviation of the bias, rad/s or m/s²
    bias_walk: float = 0.0  #: of the bias: rad/s/√s or m/s²/√s
    scale_sigma: float = 0.0  #: of the scale factor, a share of 1


@dataclass(frozen=True)
class Beginning:
    """Initial state of the navigation in a recording; None where it has none.

    Attributes
    ----------
    level_sigma, heading_sigma : float or None
        rad.
    """

    time_s: float | None = None
    place: Floats | None = None  #: latitude, longitude (rad), height (m)
    place_sigma: float | None = None  #: m
    velocity_n: Floats | None = None  #: m/s
    velocity_sigma: float | None = None  #: m/s
    attitude: Floats | None = None  #: roll, pitch, heading, rad
    level_sigma: float | None = None
    heading_sigma: float | None = None


@dataclass(frozen=True)
class VehicleRecording:
    """A recording of a vehicle, whatever its format.

    Attributes
    ----------
    gyros, accelerometers : Noise or None
    """

    name: str  #: what a person calls it
    kind: str  #: its format: ``csv``, ``kf-gins`` or ``navego``
    files: tuple[Path, ...]  #: where it was read
    increments: Increments
    fixes: Fixes | None
    reference: Reference | None
    beginning: Beginning
    gyros: Noise | None = None
    accelerometers: Noise | None = None
    #: whether there are three sensors of each kind, along right, forward, up of the body; else a
    #: scenario's `[rimu]` says where they point
    axes_are_body: bool = True
    ends_s: float | None = None  #: until when it is to be navigated; None: to the end
