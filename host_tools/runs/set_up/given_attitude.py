"""By how much a given initial attitude is off, as the sensors have it.

The firmware is given the attitude of the body and takes that of the sensors from it, through the
angles that the encoders read. Errors of what it is given, encoder offsets, and a tilt or wobble of
the inner axis, which it does not know, make its attitude of the sensors wrong.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.hardware.units import ARCSEC
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.set_up.settings import Pose, first_pose, given_pose
from rrins.host_tools.scenario.scenario import Scenario

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

_ZERO = 1e-6  # ″, rounding


class EastNorthUp(TypedDict):
    """Components of a vector in n."""

    east: float
    north: float
    up: float


def _attitude(pose: Pose) -> Rotation:
    from scipy.spatial.transform import Rotation  # takes long, and is not needed to start a run

    angles = (math.radians(a) for a in (pose.roll_deg, pose.pitch_deg, pose.heading_deg))
    return Rotation.from_matrix(body_to_navigation(*angles))


def _sensors_to_body(scenario: Scenario) -> tuple[Rotation, Rotation]:
    """Return C_s_b with the axes at zero: as the encoders have it, and as it is."""
    from scipy.spatial.transform import Rotation

    table = scenario.turntable
    inner, outer = (math.radians(axis.encoder_offset_deg) for axis in (table.inner, table.outer))
    read = Rotation.from_rotvec([outer, 0, 0]) * Rotation.from_rotvec([0, 0, inner])
    tilt = [table.wobble_arcsec * ARCSEC, table.non_orthogonality_arcsec * ARCSEC, 0]
    return read, Rotation.from_rotvec(tilt)


def error_arcsec(scenario: Scenario) -> EastNorthUp | None:
    """Return the rotation from the true to the given attitude of the sensors, ″ about n's axes.

    At the first alignment, with the axes at zero. None for a self-aligned attitude, and for one
    that is given without error.

    Raises
    ------
    MotionError
        When a recorded motion cannot be used.
    """
    if scenario.firmware.initial_attitude != "given":
        return None
    read, true = _sensors_to_body(scenario)
    given = _attitude(given_pose(scenario)) * read
    off = (given * (_attitude(first_pose(scenario)) * true).inv()).as_rotvec() / ARCSEC
    if np.abs(off).max() < _ZERO:
        return None
    east, north, up = off.tolist()
    return {"east": east, "north": north, "up": up}


def words(error: EastNorthUp) -> str:
    """Return a line about the error: of level and of heading, positive clockwise."""
    level = math.hypot(error["east"], error["north"])
    return (
        f"given attitude, for the sensors: level off by {rounded(level)}″, "
        f"heading by {rounded(-error['up'])}″"
    )
