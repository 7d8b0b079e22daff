r"""Model of the sound sensors' sums over a second on a table at rest, with derivatives.

The base is at rest with the attitude ``C_b_n``; ``C_s_b = Rx(αO) E Rz(αI)``, where E = Ry(ε) is by
how much the inner axis is out of square. Over a second

    θ_s = (∫ C_s_bᵀ dt) C_b_nᵀ ω_ie_n + ∫ Rz(-αI) Eᵀ x dαO + z ΔαI
    v_s = (∫ C_s_bᵀ dt) C_b_nᵀ [0, 0, g]

and each sensor, with the paper's (13), (16), (17), sums up to

    N = [1 + λ + μ sign(h x)] h' x + b T,     h' = h - δu v - δv u,     x = θ_s or v_s.

All of it follows from eight integrals of cosines and sines of the axes' angles and four of their
turns, which the firmware sums: exact in any motion of the table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths import earth
from rrins.host_tools.calibration.seconds import Seconds
from rrins.host_tools.scenario.geometry import AxesDeg

CONSTANTS = ("bias", "scale", "asymmetric", "u", "v")
"""Of each sensor, in this order: b, λ, μ, δu, δv; rad/s or m/s², 1, 1, rad, rad."""

BASE = 4
"""Common unknowns behind the sensors': rotation of the base about x, y, z of b, and ε; rad."""


@dataclass(frozen=True)
class Axes:
    """Design directions of m sensors, and their transverse directions; rows, paper (8), (11)."""

    h: Floats
    u: Floats
    v: Floats

    @classmethod
    def of(cls, axes_deg: AxesDeg) -> Axes:
        """Return the directions for polar angles and azimuths."""
        alpha, beta = np.radians(np.asarray(axes_deg, dtype=float)).T
        ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
        zero = np.zeros_like(beta)
        return cls(
            h=np.column_stack([sa * cb, sa * sb, ca]),
            u=np.column_stack([ca * cb, ca * sb, -sa]),
            v=np.column_stack([-sb, cb, zero]),
        )

    def __len__(self) -> int:
        return len(self.h)

    def installed(self, constants: Floats) -> Floats:
        """Return the true input axes for constants of shape (m, 5). Paper, (13)."""
        installed: Floats = self.h - constants[:, 3:4] * self.v - constants[:, 4:5] * self.u
        return installed


@dataclass(frozen=True)
class Site:
    """Where the base stands; rad, m.

    `gravity` in m/s², if it is known better than the normal gravity of the place.
    """

    latitude: float
    height: float
    gravity: float | None = None

    @property
    def rate_n(self) -> Floats:
        """The Earth's rate, east, north, up; rad/s."""
        return earth.RATE * np.array([0.0, np.cos(self.latitude), np.sin(self.latitude)])

    @property
    def force_n(self) -> Floats:
        """The specific force at rest, m/s²."""
        known = self.gravity
        normal = float(earth.gravity(self.latitude, self.height))
        return np.array([0.0, 0.0, normal if known is None else known])


def skew(vector: Floats) -> Floats:
    """Return the matrix of the cross product with a vector."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(vector: Floats) -> Floats:
    """Return the rotation matrix of a rotation vector, rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3) + skew(vector)
    K = skew(vector / angle)
    rotated: Floats = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    return rotated


def _orientation(seconds: Seconds, epsilon: float) -> tuple[Floats, Floats]:
    """Return ``∫ C_s_bᵀ dt`` (n, 3, 3), s, and its derivative by ε."""
    ci, si, co, so, cico, ciso, sico, siso = seconds.orientation.T
    T = seconds.duration_s
    ce, se = np.cos(epsilon), np.sin(epsilon)
    # Rx(-αO) = [1 0 0; 0 co so; 0 -so co]; Eᵀ = [ce 0 -se; 0 1 0; se 0 ce]
    # rows before Rz(-αI): X = [ce, se so, -se co], Y = [0, co, so], Z = [se, -ce so, ce co]
    x = (ce * ci, se * ciso + sico, -se * cico + siso)
    y = (-ce * si, -se * siso + cico, se * sico + ciso)
    z = (se * T, -ce * so, ce * co)
    dx = (-se * ci, ce * ciso, -ce * cico)
    dy = (se * si, -ce * siso, ce * sico)
    dz = (ce * T, se * so, -se * co)
    M = np.array([x, y, z]).transpose(2, 0, 1)
    dM = np.array([dx, dy, dz]).transpose(2, 0, 1)
    return M, dM


def _table_turn(seconds: Seconds, epsilon: float) -> tuple[Floats, Floats]:
    """Return the turn of the table in sensor axes (n, 3), rad, and its derivative by ε."""
    inner, outer, cosine, sine = seconds.turn.T
    ce, se = np.cos(epsilon), np.sin(epsilon)
    turn = np.column_stack([ce * cosine, -ce * sine, se * outer + inner])
    by_epsilon = np.column_stack([-se * cosine, se * sine, ce * outer])
    return turn, by_epsilon


@dataclass(frozen=True)
class Inputs:
    """Inputs of a kind of sensors: n vectors in sensor axes, and derivatives by `BASE`."""

    x: Floats  #: shape (n, 3)
    by_base: Floats  #: shape (n, 3, 4)


def inputs(seconds: Seconds, site: Site, C_b_n: Floats, epsilon: float) -> tuple[Inputs, Inputs]:
    """Return the inputs of the gyros (rad) and of the accelerometers (m/s)."""
    M, dM = _orientation(seconds, epsilon)
    turn, dturn = _table_turn(seconds, epsilon)
    rate_b, force_b = C_b_n.T @ site.rate_n, C_b_n.T @ site.force_n
    found = []
    for vector_b, more, dmore in (
        (rate_b, turn, dturn),
        (force_b, np.zeros_like(turn), np.zeros_like(dturn)),
    ):
        by_base = np.empty((len(turn), 3, BASE))
        # C_b_n exp(ψ): (C_b_n exp(ψ))ᵀ w = w_b - ψ x w_b
        by_base[:, :, :3] = M @ skew(vector_b)
        by_base[:, :, 3] = dM @ vector_b + dmore
        found.append(Inputs(M @ vector_b + more, by_base))
    return found[0], found[1]


def predicted(axes: Axes, constants: Floats, given: Inputs, duration_s: Floats) -> Floats:
    """Return what the sensors sum up to, shape (n, m)."""
    along = given.x @ axes.installed(constants).T
    signs = np.sign(given.x @ axes.h.T)
    scale = 1.0 + constants[:, 1] + constants[:, 2] * signs
    sums: Floats = scale * along + constants[:, 0] * duration_s[:, None]
    return sums


def derivatives(
    axes: Axes, constants: Floats, given: Inputs, duration_s: Floats, sensor: int
) -> tuple[Floats, Floats]:
    """Return the derivatives of a sensor's sums by its constants (n, 5) and by `BASE` (n, 4)."""
    installed = axes.installed(constants)[sensor]
    along = given.x @ installed
    signs = np.sign(given.x @ axes.h[sensor])
    scale = 1.0 + constants[sensor, 1] + constants[sensor, 2] * signs
    by_constants = np.column_stack(
        [
            duration_s,
            along,
            signs * along,
            -scale * (given.x @ axes.v[sensor]),
            -scale * (given.x @ axes.u[sensor]),
        ]
    )
    by_base: Floats = scale[:, None] * np.einsum("j,njk->nk", installed, given.by_base)
    return by_constants, by_base


def wobble_inputs(
    seconds: Seconds, site: Site, C_b_n: Floats, per_turn: float
) -> tuple[Floats, Floats]:
    """Return what a wobble of the inner axis adds to the inputs, for a rad of either phase.

    The small rotation ``(cos nα, sin nα, 0)`` of the inner axis, n periods a turn, and the same a
    quarter of a period later. Within a second by Simpson's rule.

    Returns
    -------
    gyros, accelerometers : array, shape (n, 3, 2)
    """
    ends = np.radians(seconds.angles_deg)
    begins = np.vstack([ends[:1], ends[:-1]])
    inner_turn, outer_turn = seconds.turn[:, 0], seconds.turn[:, 1]
    rate_b, force_b = C_b_n.T @ site.rate_n, C_b_n.T @ site.force_n
    gyros, accelerometers = np.zeros((2, len(ends), 3, 2))
    for share, weight in ((0.0, 1.0 / 6.0), (0.5, 4.0 / 6.0), (1.0, 1.0 / 6.0)):
        inner, outer = (begins + share * (ends - begins)).T
        for phase in range(2):
            at = per_turn * inner + phase * 0.5 * np.pi
            zero = np.zeros_like(at)
            rho = np.column_stack([np.cos(at), np.sin(at), zero])
            turned = np.column_stack([-np.sin(at), np.cos(at), zero]) * per_turn
            rate, force = (_about_x(vector, outer) for vector in (rate_b, force_b))
            by_turn = turned * inner_turn[:, None]
            by_turn -= np.cross(rho, [1.0, 0.0, 0.0]) * outer_turn[:, None]
            T = weight * seconds.duration_s[:, None]
            gyros[:, :, phase] += _about_z(weight * by_turn - T * np.cross(rho, rate), inner)
            accelerometers[:, :, phase] -= _about_z(T * np.cross(rho, force), inner)
    return gyros, accelerometers


def _about_x(vector: Floats, angle: Floats) -> Floats:
    """Return a vector in axes that are turned about x by each angle, shape (n, 3)."""
    x, y, z = vector
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([np.full_like(c, x), c * y + s * z, c * z - s * y])


def _about_z(vectors: Floats, angle: Floats) -> Floats:
    """Return vectors, shape (n, 3), in axes that are turned about z by each angle."""
    x, y, z = vectors.T
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x + s * y, c * y - s * x, z])
