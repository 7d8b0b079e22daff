"""By how much a given initial attitude is off, as the sensors have it.

The firmware is given the attitude of the body and takes that of the sensors from it, through the
angles that the encoders read. Errors of what it is given, encoder offsets, and a tilt or wobble of
the inner axis, which it does not know, make its attitude of the sensors wrong.
"""

from __future__ import annotations

import math
from typing import TypedDict

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.hardware.units import ARCSEC
from rrins.host_tools.rounding import rounded
from rrins.host_tools.runs.set_up.settings import Pose, first_pose, given_pose
from rrins.host_tools.scenario.scenario import Scenario

_ZERO = 1e-6  # ″, rounding


class EastNorthUp(TypedDict):
    """Components of a vector in n."""

    east: float
    north: float
    up: float


def _attitude(pose: Pose) -> Floats:
    angles = (math.radians(a) for a in (pose.roll_deg, pose.pitch_deg, pose.heading_deg))
    return body_to_navigation(*angles)


def _turn(x: float, y: float, z: float) -> Floats:
    """Return the matrix of a rotation vector, rad. Rodrigues."""
    angle = math.hypot(x, y, z)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sinc(angle / math.pi) * K + np.sinc(angle / math.tau) ** 2 / 2 * K @ K


def _rotation_vector(C: Floats) -> Floats:
    """Return the rotation vector of a matrix, rad. Bar-Itzhack, J. Guidance 23 (2000), 1085."""
    K = np.zeros((4, 4))
    K[0, 0] = C.trace()
    K[0, 1:] = K[1:, 0] = C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]
    K[1:, 1:] = C + C.T - C.trace() * np.eye(3)
    q = np.linalg.eigh(K)[1][:, -1]
    sine = np.linalg.norm(q[1:])
    if sine == 0:
        return np.zeros(3)
    return q[1:] * (2 * math.atan2(sine, abs(q[0])) / math.copysign(sine, q[0]))


def _sensors_to_body(scenario: Scenario) -> tuple[Floats, Floats]:
    """Return C_s_b with the axes at zero: as the encoders have it, and as it is."""
    table = scenario.turntable
    inner, outer = (math.radians(axis.encoder_offset_deg) for axis in (table.inner, table.outer))
    read = _turn(outer, 0.0, 0.0) @ _turn(0.0, 0.0, inner)
    return read, _turn(table.wobble_arcsec * ARCSEC, table.non_orthogonality_arcsec * ARCSEC, 0.0)


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
    given = _attitude(given_pose(scenario)) @ read
    off = _rotation_vector(given @ (_attitude(first_pose(scenario)) @ true).T) / ARCSEC
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
