"""How errors of the navigation grow over a second, to first order.

The error equations of a navigation in east-north-up; Groves (2nd ed., 2013), section 14.2.4. An
error is what has to be added to the navigation: attitude, a turn of the sensors about the axes of n
(rad); velocity_n (m/s); latitude and longitude (rad).
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths import earth

ATTITUDE, VELOCITY, TURN, CHANGE, LATITUDE, LONGITUDE = 0, 3, 6, 9, 12, 13
"""First state of each group. `TURN` and `CHANGE` are inputs: a turn (rad) and a velocity change
(m/s) in n, spread evenly over the time. A filter has the biases in their places."""

SIZE = 14
FILTER_SIZE = 12
"""States of a filter: attitude, velocity, gyro and accelerometer biases in s (rad/s, m/s²)."""


@compiled
def fill(
    response: Floats,
    force_n: Floats,
    way_n: Floats,
    dt: float,
    latitude: float,
    height: float,
    vertical: bool,
) -> None:
    """Write how states and inputs respond to those at the beginning.

    Parameters
    ----------
    response : array, shape (14, 14)
    force_n : array, shape (3,)
        Integral of the specific force, m/s.
    way_n : array, shape (3,)
        Integral of the velocity, m.
    dt : float
        Time, s.
    latitude, height : float
        rad, m.
    vertical : bool
        Whether errors of the vertical velocity last; not where the height is held.
    """
    for i in range(SIZE):
        for k in range(SIZE):
            response[i, k] = 1.0 if i == k else 0.0
    meridian, prime_vertical = earth.radii(latitude)
    north_radius, east_radius = meridian + height, prime_vertical + height
    cosine, sine = math.cos(latitude), math.sin(latitude)
    east, north = way_n[0] / dt, way_n[1] / dt
    omega_e = -north / north_radius
    omega_n = earth.RATE * cosine + east / east_radius
    omega_u = earth.RATE * sine + east / east_radius * sine / cosine
    _fill_velocity(response, force_n)
    # Coriolis, with 2 ω_ie + ω_en
    twice_n, twice_u = omega_n + earth.RATE * cosine, omega_u + earth.RATE * sine
    v_e, v_n, v_u = VELOCITY, VELOCITY + 1, VELOCITY + 2
    response[v_e, v_u] -= twice_n * dt
    response[v_e, v_n] += twice_u * dt
    response[v_n, v_e] -= twice_u * dt
    response[v_n, v_u] += omega_e * dt
    response[v_u, v_n] -= omega_e * dt
    response[v_u, v_e] += twice_n * dt
    if not vertical:
        for k in range(SIZE):
            response[v_u, k] = 0.0
    response[0, 2] -= omega_n * dt
    response[0, 1] += omega_u * dt
    response[1, 0] -= omega_u * dt
    response[1, 2] += omega_e * dt
    response[2, 1] -= omega_e * dt
    response[2, 0] += omega_n * dt
    for i in range(3):
        response[ATTITUDE + i, TURN + i] = 1.0
    response[1, LATITUDE] += earth.RATE * sine * dt
    response[2, LATITUDE] -= earth.RATE * cosine * dt
    for k in range(SIZE):  # by the mean velocity
        middle_east = 0.5 * (response[v_e, k] + (1.0 if k == v_e else 0.0)) * dt / east_radius
        middle_north = 0.5 * (response[v_n, k] + (1.0 if k == v_n else 0.0)) * dt / north_radius
        response[0, k] += middle_north
        response[1, k] -= middle_east
        response[2, k] -= middle_east * sine / cosine
        response[LATITUDE, k] += middle_north
        response[LONGITUDE, k] += middle_east / cosine


@compiled
def _fill_velocity(response: Floats, force_n: Floats) -> None:
    """Add the velocity that a wrong attitude makes of the specific force."""
    for half in range(2):
        column, share = ATTITUDE + TURN * half, 1.0 - 0.5 * half
        response[VELOCITY, column + 1] += share * force_n[2]
        response[VELOCITY, column + 2] -= share * force_n[1]
        response[VELOCITY + 1, column + 2] += share * force_n[0]
        response[VELOCITY + 1, column] -= share * force_n[2]
        response[VELOCITY + 2, column] += share * force_n[1]
        response[VELOCITY + 2, column + 1] -= share * force_n[0]
    for i in range(3):
        response[VELOCITY + i, CHANGE + i] += 1.0


@compiled
def of_biases(transition: Floats, response: Floats, attitude_s: Floats) -> None:
    """Write the transition of a filter: the inputs are those of constant biases in s.

    Parameters
    ----------
    transition : array, shape (12, 12)
    response : array, shape (14, 14)
        From `fill`.
    attitude_s : array, shape (3, 3)
        Integral of C_s_n, s.
    """
    for i in range(FILTER_SIZE):
        for k in range(FILTER_SIZE):
            transition[i, k] = response[i, k]
    for i in range(TURN):
        for column in (TURN, CHANGE):
            for k in range(3):
                total = 0.0
                for j in range(3):
                    total += response[i, column + j] * attitude_s[j, k]
                transition[i, column + k] = total
