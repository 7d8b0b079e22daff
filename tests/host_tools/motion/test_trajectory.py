"""Position, velocity, attitude and increments of a trajectory agree with each other.

What the RIMU feels is integrated in Earth-centred axes with a quaternion, written apart from the
code under test; and the firmware's navigation follows it.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rrins.host_tools.motion.trajectory import knot_ns

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
RATE = 7.292115e-5
GM = 3.986004418e14


def ecef(latitude, longitude, height):
    prime = A / math.sqrt(1 - E2 * math.sin(latitude) ** 2)
    across = (prime + height) * math.cos(latitude)
    return np.array(
        [
            across * math.cos(longitude),
            across * math.sin(longitude),
            (prime * (1 - E2) + height) * math.sin(latitude),
        ]
    )


def geodetic(x, y, z):
    """Return latitude, longitude, height: fixed-point iteration to the last bit."""
    across = math.hypot(x, y)
    latitude = math.atan2(z, across * (1 - E2))
    for _ in range(6):
        prime = A / math.sqrt(1 - E2 * math.sin(latitude) ** 2)
        latitude = math.atan2(z + E2 * prime * math.sin(latitude), across)
    sine, cosine = math.sin(latitude), math.cos(latitude)
    height = across * cosine + z * sine - A * math.sqrt(1 - E2 * sine**2)
    return latitude, math.atan2(y, x), height


def gravity(latitude, height):
    """Somigliana's formula with k, continued upwards to second order."""
    s2 = math.sin(latitude) ** 2
    on_ellipsoid = 9.7803253359 * (1 + 1.931852652458e-3 * s2) / math.sqrt(1 - E2 * s2)
    m = RATE**2 * A**3 * (1 - F) / GM
    return on_ellipsoid * (1 - 2 / A * (1 + F + m - 2 * F * s2) * height + 3 * (height / A) ** 2)


def axes(latitude, longitude):
    """Return C_n_e: columns east, north, up."""
    sp, cp, sl, cl = (
        math.sin(latitude),
        math.cos(latitude),
        math.sin(longitude),
        math.cos(longitude),
    )
    return np.array([[-sl, -sp * cl, cp * cl], [cl, -sp * sl, cp * sl], [0, cp, sp]])


def matrix(q):
    w, x, y, z = q
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def angle_axes(roll, pitch, heading):
    """Return C_b_n, columns: the body's axes in east, north, up; from rotations as scipy has it."""
    return Rotation.from_euler("ZXY", [-heading, pitch, roll]).as_matrix()


def quaternion(C):
    x, y, z, w = Rotation.from_matrix(C).as_quat()
    return np.array([w, x, y, z])


def slope(omega_and_force, state):
    """Return the derivative of position, velocity in e and of the quaternion from b to e."""
    x, y, z, vx, vy, vz, q0, q1, q2, q3 = state.tolist()
    wx, wy, wz, fx, fy, fz = omega_and_force
    latitude, longitude, height = geodetic(x, y, z)
    # C_b_e f
    tx, ty, tz = 2 * (q2 * fz - q3 * fy), 2 * (q3 * fx - q1 * fz), 2 * (q1 * fy - q2 * fx)
    ax = fx + q0 * tx + q2 * tz - q3 * ty
    ay = fy + q0 * ty + q3 * tx - q1 * tz
    az = fz + q0 * tz + q1 * ty - q2 * tx
    g = gravity(latitude, height)
    cp = math.cos(latitude)
    ax += 2 * RATE * vy - g * cp * math.cos(longitude)
    ay += -2 * RATE * vx - g * cp * math.sin(longitude)
    az -= g * math.sin(latitude)
    # q' = ½ (q ⊗ ω_ib^b - ω_ie^e ⊗ q)
    d0 = 0.5 * (-q1 * wx - q2 * wy - q3 * wz + RATE * q3)
    d1 = 0.5 * (q0 * wx + q2 * wz - q3 * wy + RATE * q2)
    d2 = 0.5 * (q0 * wy + q3 * wx - q1 * wz - RATE * q1)
    d3 = 0.5 * (q0 * wz + q1 * wy - q2 * wx - RATE * q0)
    return [vx, vy, vz, ax, ay, az, d0, d1, d2, d3]


def gauss_tableau(stages):
    """Return nodes, matrix and weights of Gauss collocation on [0, 1], of order 2 * stages."""
    nodes, weights = np.polynomial.legendre.leggauss(stages)
    nodes, weights = (nodes + 1) / 2, weights / 2
    powers = np.arange(stages)
    vandermonde = nodes[:, None] ** powers
    integrals = nodes[:, None] ** (powers + 1) / (powers + 1)
    return nodes, integrals @ np.linalg.inv(vandermonde), weights


def navigate(trajectory, end_s, every=40):
    """Integrate the trajectory's rates and forces alone; return times and states.

    A step is a piece, for there the derivatives of higher order jump.
    """
    nodes, matrix_a, weights = gauss_tableau(5)
    step = trajectory.knot_ns * 1e-9
    first = trajectory.at(np.array([0.0]))[0]
    C_n_e = axes(*first[6:8])
    state = np.concatenate(
        [
            ecef(*first[6:9]),
            C_n_e @ first[9:12],
            quaternion(C_n_e @ angle_axes(*first[12:15])),
        ]
    )
    count = min(round(end_s / step), len(trajectory.pieces))
    felt = trajectory.pieces[:count, :6] @ (nodes[:, None] ** np.arange(8)).T  # (n, 6, stages)
    felt = felt.transpose(0, 2, 1).tolist()
    times, states = [0.0], [state]
    slopes = np.zeros((5, 10))
    for k in range(count):
        for _ in range(9):
            guess = state + step * (matrix_a @ slopes)
            slopes_before, slopes = slopes, np.array(list(map(slope, felt[k], guess)))
            if np.abs(slopes - slopes_before).max() < 1e-15:
                break
        state = state + step * (weights @ slopes)
        if (k + 1) % every == 0:
            times.append((k + 1) * step)
            states.append(state)
    return np.array(times), np.array(states)


def differences(trajectory, times, states):
    """Return largest position (m), velocity (m/s) and attitude (rad) difference."""
    largest = np.zeros(3)
    for expected, state in zip(trajectory.at(times), states, strict=True):
        C_n_e = axes(expected[6], expected[7])
        C_b_e = C_n_e @ angle_axes(*expected[12:15])
        off = matrix(state[6:] / np.linalg.norm(state[6:])) - C_b_e
        found = [
            np.linalg.norm(state[:3] - ecef(*expected[6:9])),
            np.linalg.norm(state[3:6] - C_n_e @ expected[9:12]),
            np.abs(off).max(),
        ]
        largest = np.maximum(largest, found)
    return largest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drive", "sway", "recorded"])
def test_rates_and_forces_integrate_to_position_velocity_and_attitude(name, request):
    trajectory = request.getfixturevalue(name)
    position, velocity, attitude = differences(
        trajectory, *navigate(trajectory, trajectory.duration_s)
    )
    assert position < 1e-4
    assert velocity < 1e-6
    assert attitude < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drive", "sway", "recorded"])
def test_an_ideal_navigator_follows(name, request, followed):
    trajectory = request.getfixturevalue(name)
    off = np.abs(followed(trajectory)).max(axis=0)
    assert off[:2].max() < 0.005
    assert off[2] < 0.05  # unaided, the vertical channel grows by e every 570 s


@pytest.mark.parametrize("name", ["drive", "sway", "recorded"])
def test_it_begins_exactly_at_rest_and_nothing_jumps(name, request):
    trajectory = request.getfixturevalue(name)
    pieces = trajectory.pieces
    assert not pieces[:4, :, 1:].any()
    assert not pieces[:4, 9:12].any()
    ends = pieces.sum(axis=2)
    following = pieces[1:, :, 0]
    jumps = np.abs(ends[:-1] - following).max(axis=0)
    assert jumps[:3].max() < 1e-10  # rad/s
    assert jumps[3:6].max() < 1e-8  # m/s²
    assert jumps[6:8].max() < 1e-15
    assert jumps[8:].max() < 1e-12


@pytest.mark.parametrize("name", ["drive", "recorded"])
def test_it_ends_at_rest_and_stays(name, request):
    trajectory = request.getfixturevalue(name)
    assert trajectory.loop_from is None
    assert not trajectory.pieces[-4:, :, 1:].any()
    end, later = trajectory.at(trajectory.duration_s + np.array([0.0, 1000.0]))
    assert not end[9:12].any()
    assert (end == later).all()


@pytest.mark.parametrize("rate_hz", [50, 64, 100, 125, 128, 200, 250, 400, 500, 1000])
def test_a_piece_is_a_whole_number_of_epochs(rate_hz):
    period = 1_000_000_000 // rate_hz
    assert knot_ns(period) % period == 0
    assert knot_ns(period) == pytest.approx(250_000_000, rel=0.05)


def test_a_trajectory_cannot_be_changed(drive):
    with pytest.raises(ValueError, match="read-only"):
        drive.pieces[0, 0, 0] = 1.0
    with pytest.raises(AttributeError):
        drive.knot_ns = 1
