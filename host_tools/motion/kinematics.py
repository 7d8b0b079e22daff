"""Measurements of an ideal RIMU on a given path, on the full ellipsoid.

Latitude φ, longitude λ, height h, roll, pitch and heading are quintic splines of time. From them,
with the radii of curvature M (meridian) and N (prime vertical)::

    v^n    = [(N + h) cos φ λ', (M + h) φ', h']
    ω_ie^n = Ω [0, cos φ, sin φ],   ω_en^n = [-φ', λ' cos φ, λ' sin φ]
    f^n    = d(v^n)/dt + (2 ω_ie^n + ω_en^n) x v^n + [0, 0, γ(φ, h)]
    ω_ib^b = C_n^b (ω_ie^n + ω_en^n) + ω_nb^b

Titterton and Weston, *Strapdown Inertial Navigation Technology* (2nd ed., 2004), section 3.5, in
east-north-up. Normal gravity γ points down along the ellipsoid's normal; its northward component
above the ellipsoid is neglected, as everywhere in this project.

These functions of time are not polynomials. Each piece interpolates them at eight Chebyshev nodes;
the interpolation error is at rounding level.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from rrins.compiled.record import Floats
from rrins.host_tools.hardware import earth
from rrins.host_tools.motion.spline import derivative, horner, monomials_of
from rrins.host_tools.motion.trajectory import (
    ATTITUDE,
    CHANNELS,
    OMEGA_IB_B,
    PLACE,
    POWERS,
    SPECIFIC_FORCE_B,
    VELOCITY_N,
    Trajectory,
)


@dataclass(frozen=True)
class Path:
    """Position and attitude as quintic splines on one grid."""

    knot_ns: int  #: length of a piece
    #: shape (6,); initial latitude, longitude (rad), height (m), roll, pitch, heading (rad)
    base: Floats
    #: shape (pieces + 5, 6); spline coefficients of the change relative to `base`
    coefficients: Floats


def _interpolation() -> tuple[Floats, Floats]:
    """Return the Chebyshev nodes in [0, 1] and the matrix from values there to monomials."""
    nodes = chebyshev.chebpts1(POWERS)
    # Discrete orthogonality of the Chebyshev polynomials at their nodes.
    to_series = chebyshev.chebvander(nodes, POWERS - 1).T * (2.0 / POWERS)
    to_series[0] /= 2.0
    to_monomials = np.zeros((POWERS, POWERS))
    for k in range(POWERS):
        series = chebyshev.Chebyshev.basis(k, domain=[0.0, 1.0])
        monomials = series.convert(kind=np.polynomial.Polynomial).coef
        to_monomials[: len(monomials), k] = np.round(monomials)  # integers
    return (nodes + 1.0) / 2.0, to_monomials @ to_series


NODES, _TO_MONOMIALS = _interpolation()
"""Instants of a piece, in u, through which functions of time are interpolated."""


def _motion_n(place: Floats, slope: Floats, bend: Floats) -> tuple[Floats, Floats, Floats]:
    """Return v^n, f^n and ω_in^n, each (3, …), of φ, λ, h and their derivatives in s."""
    latitude, _, height = place
    dlatitude, dlongitude, dheight = slope
    ddlatitude, ddlongitude, ddheight = bend
    sine, cosine = np.sin(latitude), np.cos(latitude)
    meridian, prime = earth.curvature_radii(latitude)
    dmeridian, dprime = earth.curvature_slopes(latitude)
    meridian, prime = meridian + height, prime + height

    velocity = np.array([prime * cosine * dlongitude, meridian * dlatitude, dheight])
    acceleration = np.array(
        [
            (dprime * dlatitude + dheight) * cosine * dlongitude
            - prime * sine * dlatitude * dlongitude
            + prime * cosine * ddlongitude,
            (dmeridian * dlatitude + dheight) * dlatitude + meridian * ddlatitude,
            ddheight,
        ]
    )
    omega_ie = earth.ROTATION_RATE * np.array([np.zeros_like(sine), cosine, sine])
    omega_en = np.array([-dlatitude, dlongitude * cosine, dlongitude * sine])
    force = acceleration + np.cross(2 * omega_ie + omega_en, velocity, axis=0)
    force[2] += earth.normal_gravity(latitude, height)
    return velocity, force, omega_ie + omega_en


def _to_body(angles: Floats, vector_n: Floats) -> Floats:
    """Return ``C_n_b @ vector_n`` with ``C_n_b = Ry(-roll) Rx(-pitch) Rz(heading)``."""
    (sr, sp, sh), (cr, cp, ch) = np.sin(angles), np.cos(angles)
    east, north, up = vector_n
    right, ahead = ch * east - sh * north, sh * east + ch * north
    forward, above = cp * ahead + sp * up, cp * up - sp * ahead
    return np.array([cr * right - sr * above, forward, cr * above + sr * right])


def _turn_b(angles: Floats, rates: Floats) -> Floats:
    """Return ω_nb^b of roll, pitch, heading and their rates."""
    (sr, sp, _), (cr, cp, _) = np.sin(angles), np.cos(angles)
    droll, dpitch, dheading = rates
    # -heading' about up, pitch' about the right-hand axis before roll, roll' about forward
    return np.array(
        [
            cr * dpitch + sr * cp * dheading,
            droll - sp * dheading,
            sr * dpitch - cr * cp * dheading,
        ]
    )


def interpolated(values: Floats) -> Floats:
    """Return monomials, shape (n, channels, 8), of values (channels, n, 8) at the nodes."""
    first = values[..., :1]
    monomials = (values - first) @ _TO_MONOMIALS.T
    monomials[..., 0] += first[..., 0]
    return np.moveaxis(monomials, 0, 1)


def trajectory_of(
    path: Path, loop_from: int | None = None, notes: tuple[str, ...] = ()
) -> Trajectory:
    """Return the trajectory along a path: increments, velocity and attitude."""
    monomials = monomials_of(path.coefficients)  # (n, 6, 6)
    still = ~monomials[..., 1:].any(axis=(1, 2))
    monomials[..., 0] += path.base
    step_s = path.knot_ns * 1e-9

    def at_nodes(order: int) -> Floats:
        values = horner(derivative(monomials, order)[:, :, None, :], NODES)
        return np.moveaxis(values, 1, 0) / step_s**order  # (6, n, 8)

    place, slope, bend = at_nodes(0), at_nodes(1), at_nodes(2)
    velocity, force_n, omega_in_n = _motion_n(place[:3], slope[:3], bend[:3])
    omega_b = _to_body(place[3:], omega_in_n) + _turn_b(place[3:], slope[3:])
    pieces = np.zeros((len(monomials), CHANNELS, POWERS))
    pieces[:, OMEGA_IB_B] = interpolated(omega_b)
    pieces[:, SPECIFIC_FORCE_B] = interpolated(_to_body(place[3:], force_n))
    pieces[:, VELOCITY_N] = interpolated(velocity)
    pieces[:, PLACE, : monomials.shape[2]] = monomials[:, :3]
    pieces[:, ATTITUDE, : monomials.shape[2]] = monomials[:, 3:]
    pieces[still, :, 1:] = 0.0
    return Trajectory(path.knot_ns, pieces, loop_from, notes)
