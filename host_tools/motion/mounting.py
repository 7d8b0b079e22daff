"""A body that is mounted askew in its vehicle.

The vehicle moves along its own forward axis; the body frame, that of the turntable's base, is
turned against the vehicle's by a constant rotation. With C_v^b of heading ψ and pitch θ::

    C_b^n = C_v^n C_b^v,   C_v^b = Rz(-ψ) Rx(θ)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rrins.compiled.record import Floats
from rrins.host_tools.hardware.settings import body_to_navigation
from rrins.host_tools.motion.kinematics import NODES, interpolated
from rrins.host_tools.motion.spline import horner
from rrins.host_tools.motion.trajectory import (
    ATTITUDE,
    OMEGA_IB_B,
    SPECIFIC_FORCE_B,
    Trajectory,
)


def mounted(trajectory: Trajectory, heading: float, pitch: float) -> Trajectory:
    """Return the motion of a body in the vehicle that moves along a trajectory.

    Parameters
    ----------
    trajectory : Trajectory
        Of the vehicle.
    heading, pitch : float
        Of the vehicle's forward axis in the body frame, rad.
    """
    C_v_b = body_to_navigation(0.0, pitch, heading)
    pieces = trajectory.pieces.copy()
    for vector in (OMEGA_IB_B, SPECIFIC_FORCE_B):
        pieces[:, vector] = C_v_b @ trajectory.pieces[:, vector]
    angles = horner(trajectory.pieces[:, ATTITUDE, None, :], NODES)  # (n, 3, 8)
    pieces[:, ATTITUDE] = interpolated(_turned(np.moveaxis(angles, 1, 0), C_v_b.T))
    return replace(trajectory, pieces=pieces)


def _turned(angles: Floats, C_b_v: Floats) -> Floats:
    """Return roll, pitch and heading of the body, shape (3, n, 8), from those of the vehicle."""
    (sr, sp, sh), (cr, cp, ch) = np.sin(angles), np.cos(angles)
    C_v_n = np.array(  # Rz(-heading) Rx(pitch) Ry(roll)
        [
            [ch * cr + sh * sp * sr, sh * cp, ch * sr - sh * sp * cr],
            [ch * sp * sr - sh * cr, ch * cp, -sh * sr - ch * sp * cr],
            [-cp * sr, sp, cp * cr],
        ]
    )
    C_b_n = np.einsum("ij...,jk->ik...", C_v_n, C_b_v)
    heading = np.arctan2(C_b_n[0, 1], C_b_n[1, 1])
    return np.array(
        [
            np.arctan2(-C_b_n[2, 0], C_b_n[2, 2]),
            np.arcsin(C_b_n[2, 1]),
            np.unwrap(heading.ravel()).reshape(heading.shape),
        ]
    )
