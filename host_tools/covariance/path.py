"""The path of a scenario without errors: what its sensors go through, interval by interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrins.compiled.record import Floats, Records
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.hardware.earth import curvature_radii, normal_gravity, rotation_n
from rrins.host_tools.hardware.memory import INNER, OUTER, Truth
from rrins.host_tools.runs.fast import FastRun
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

INTERVAL_S = 0.5
"""Of a path; a table at 2°/s turns by 1° meanwhile."""


@dataclass(frozen=True)
class Path:
    """Motion of the sensors, in n intervals of `INTERVAL_S`.

    Attributes
    ----------
    velocity_n, rate_n : array, shape (n, 3)
        m/s; rate of the navigation frame against inertial space, rad/s.
    rate_s, force_s, force_n : array, shape (n, 3)
        Mean rate (rad/s) and specific force (m/s²).
    """

    latitude: Floats  #: shape (n,); rad
    #: shape (n, 2); radii of the meridian and the prime vertical, with the height, m
    curvatures: Floats
    velocity_n: Floats
    rate_n: Floats
    earth_n: Floats  #: shape (n, 3); rate of the Earth, rad/s
    C_s_n: Floats  #: shape (n, 3, 3); at the middle of each interval
    rate_s: Floats
    force_s: Floats
    force_n: Floats
    C_begin: Floats  #: shape (3, 3); C_s_n at the beginning, where the table stood until then
    heading: float  #: of the vehicle at the beginning, rad
    inner: float  #: angle of the inner axis at the beginning, rad
    begins_s: float  #: since navigation began

    @property
    def times_s(self) -> Floats:
        """The ends of the intervals since navigation began, shape (n + 1,)."""
        return self.begins_s + np.arange(len(self.latitude) + 1, dtype=np.float64) * INTERVAL_S


def path_of(scenario: Scenario) -> Path:
    """Return the path of a scenario's navigation.

    Raises
    ------
    RehearsalError
        When the scenario does not navigate from its beginning to its end.
    """
    clean = scenario.model_copy(update={"faults": ()})
    every = max(1, round(INTERVAL_S * scenario.rate_hz))
    run = FastRun.of(firmware_settings(clean), hardware_settings(clean), every)
    truth = run.run(clean.epochs).truth
    wanted = int(scenario.duration_s / INTERVAL_S)
    if len(truth) < min(wanted, 4):
        raise RehearsalError("covariance: the scenario does not navigate to its end")
    return path_through(truth)


def path_along(truth: Records[Truth], angles: Floats) -> Path:
    """Return the path of a vehicle's truth, every `INTERVAL_S`, with other angles of the table.

    Parameters
    ----------
    truth : Records[Truth]
    angles : array, shape (n, 2)
        Inner and outer, rad.
    """
    turned = truth.copy()
    turned["axis_angle"] = angles
    return path_through(turned)


def path_through(truth: Records[Truth], begins_s: float = 0.0) -> Path:
    """Return the path through the truth of a run, every `INTERVAL_S`."""
    middle = 0.5 * (truth["latitude"][1:] + truth["latitude"][:-1])
    height = 0.5 * (truth["height"][1:] + truth["height"][:-1])
    velocity = truth["velocity_n"]
    mean_velocity = 0.5 * (velocity[1:] + velocity[:-1])
    radii = np.array([curvature_radii(float(one)) for one in middle]) + height[:, None]
    earth = np.array([rotation_n(float(one)) for one in middle])
    east, north, _ = mean_velocity.T
    transport = np.column_stack(
        [-north / radii[:, 0], east / radii[:, 1], east / radii[:, 1] * np.tan(middle)]
    )
    gravity = np.zeros_like(mean_velocity)
    gravity[:, 2] = [
        -normal_gravity(float(a), float(h)) for a, h in zip(middle, height, strict=True)
    ]
    acceleration = np.diff(velocity, axis=0) / INTERVAL_S
    force_n = acceleration + np.cross(2.0 * earth + transport, mean_velocity) - gravity
    C = _attitudes(truth)
    turn = np.einsum("nji,njk->nik", C[:-1], C[1:])  # from the end of an interval to its beginning
    half = _rotations(0.5 * _vectors(turn))
    C_middle = C[:-1] @ half
    rate_n = earth + transport
    rate_s = _vectors(turn) / INTERVAL_S + np.einsum("nji,nj->ni", C_middle, rate_n)
    force_s = np.einsum("nji,nj->ni", C_middle, force_n)
    return Path(
        latitude=middle,
        curvatures=radii,
        velocity_n=mean_velocity,
        rate_n=rate_n,
        earth_n=earth,
        C_s_n=C_middle,
        rate_s=rate_s,
        force_s=force_s,
        force_n=force_n,
        C_begin=C[0],
        heading=float(truth["heading"][0]),
        inner=float(truth["axis_angle"][0, INNER]),
        begins_s=begins_s,
    )


def _attitudes(truth: Records[Truth]) -> Floats:
    """Return C_s_n: ``Rz(-heading) Rx(pitch) Ry(roll) Rx(outer) Rz(inner)``, shape (n, 3, 3)."""
    angles = truth["axis_angle"]
    C_b_n = _about(2, -truth["heading"]) @ _about(0, truth["pitch"]) @ _about(1, truth["roll"])
    return C_b_n @ _about(0, angles[:, OUTER]) @ _about(2, angles[:, INNER])


def rotation_about_z(angle: float) -> Floats:
    """Return ``Rz(angle)``, shape (3, 3)."""
    return _about(2, np.array([angle]))[0]


def _about(axis: int, angle: Floats) -> Floats:
    """Return rotations about an axis, shape (n, 3, 3)."""
    vectors = np.zeros((len(angle), 3))
    vectors[:, axis] = angle
    return _rotations(vectors)


def _rotations(vectors: Floats) -> Floats:
    """Return the matrices of rotation vectors (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    K = cross_matrices(vectors)
    return np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * K @ K


def _vectors(C: Floats) -> Floats:
    """Return the rotation vectors of matrices that turn by less than 90°."""
    vectors = 0.5 * np.column_stack(
        [C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]]
    )
    sine = np.linalg.norm(vectors, axis=1)[:, None]
    return vectors * np.where(
        sine > 1e-9, np.arcsin(np.clip(sine, 0, 1)) / np.maximum(sine, 1e-12), 1
    )


def cross_matrices(vectors: Floats) -> Floats:
    """Return the matrices of cross products, shape (n, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), -1, 0)
