"""Strapdown navigation in the east-north-up frame on WGS-84, one epoch of increments at a time.

References
----------
Savage, "Strapdown Inertial Navigation Integration Algorithm Design", parts 1 and 2, *Journal of
Guidance, Control, and Dynamics* 21 (1998); Titterton and Weston, *Strapdown Inertial Navigation
Technology* (2nd ed., 2004), chapters 3 and 11; Siouris, *Aerospace Avionics Systems* (1993),
section 5.4, for the damped height channel.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Records
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.angles import Angle, turn_to
from rrins.firmware_py.core.maths.attitude import (
    cross,
    matrix_of_quaternion,
    multiply,
    normalise,
    quaternion_of_matrix,
    quaternion_of_vector,
    rotate,
)
from rrins.firmware_py.core.records.memory import Ins

HEIGHT_HELD = 0
HEIGHT_DAMPED = 1
HEIGHT_FREE = 2

_DAMPING_TIME = 100.0  # s, the triple real pole of the damped height channel
_LONGEST_INTERVAL = 1.0  # s: a reference after a longer gap has no more weight


@compiled
def initialise(ins: Ins, C_s_n: Floats, latitude: float, longitude: float, height: float) -> None:
    """Initialise the navigation at rest, at a given position and attitude.

    Parameters
    ----------
    ins : Ins
    C_s_n : array, shape (3, 3)
    latitude, longitude : float
        In rad.
    height : float
        In m; also the reference of a held or damped height channel.
    """
    quaternion_of_matrix(ins.q_s_n, C_s_n)
    matrix_of_quaternion(ins.C_s_n, ins.q_s_n)
    ins.latitude = latitude
    ins.longitude = longitude
    ins.height = height
    ins.reference_height = height
    ins.reference_interval = 0.0
    ins.height_error_integral = 0.0
    ins.latitude_carry = 0.0
    ins.longitude_carry = 0.0
    ins.first = True
    for i in range(3):
        ins.velocity_n[i] = 0.0
        ins.velocity_change_n[i] = 0.0


@compiled
def parallel(ins: Ins) -> Angle:
    """Return the latitude with its cosine and sine."""
    turn_to(ins.parallel, ins.latitude)
    return ins.parallel


@compiled
def rotation_vector(phi: Floats, dtheta_s: Floats, dtheta_s_previous: Floats) -> None:
    """Write the rotation vector of an epoch: its increment and the coning correction.

    Exact for an angular rate that changes linearly. Savage (1998), part 1, with one previous
    increment: ``phi = dtheta + dtheta_previous x dtheta / 12``.
    """
    cross(phi, dtheta_s_previous, dtheta_s)
    for i in range(3):
        phi[i] = dtheta_s[i] + phi[i] / 12.0


@compiled
def velocity_in_start_frame(ins: Ins, out: Floats, dtheta_s: Floats, dv_s: Floats) -> None:
    """Write the epoch's velocity change in the sensor frame at the epoch's start.

    Rotation compensation to second order and sculling compensation, Savage (1998), part 2::

        dv + dtheta x dv / 2 + dtheta x (dtheta x dv) / 6
           + (dtheta_previous x dv + dv_previous x dtheta) / 12
    """
    once, twice = ins.work[0], ins.work[1]
    cross(once, dtheta_s, dv_s)
    cross(twice, dtheta_s, once)
    for i in range(3):
        out[i] = dv_s[i] + once[i] / 2.0 + twice[i] / 6.0
    cross(once, ins.dtheta_s_previous, dv_s)
    cross(twice, ins.dv_s_previous, dtheta_s)
    for i in range(3):
        out[i] += (once[i] + twice[i]) / 12.0


@compiled
def _transport_rates(
    ins: Ins, omega_ie_n: Floats, omega_en_n: Floats
) -> tuple[float, float, float]:
    """Write the Earth's and the transport rate at mid-epoch; return radii and cos(lat)."""
    cosine, sine = ins.parallel.cosine, ins.parallel.sine
    meridian, prime_vertical = earth.radii_at(sine)
    east = ins.velocity_n[0] + 0.5 * ins.velocity_change_n[0]
    north = ins.velocity_n[1] + 0.5 * ins.velocity_change_n[1]
    omega_ie_n[0], omega_ie_n[1], omega_ie_n[2] = 0.0, earth.RATE * cosine, earth.RATE * sine
    rate_e = east / (prime_vertical + ins.height)
    omega_en_n[0] = -north / (meridian + ins.height)
    omega_en_n[1] = rate_e
    omega_en_n[2] = rate_e * sine / cosine
    return meridian, prime_vertical, cosine


@compiled
def _update_attitude(ins: Ins, phi_s: Floats, zeta_n: Floats) -> None:
    """Rotate ``q_s_n`` by the sensors' rotation and against that of the navigation frame."""
    turn, product = ins.work_q[0], ins.work_q[1]
    quaternion_of_vector(turn, phi_s)
    multiply(product, ins.q_s_n, turn)
    for i in range(3):
        zeta_n[i] = -zeta_n[i]
    quaternion_of_vector(turn, zeta_n)
    multiply(ins.q_s_n, turn, product)
    normalise(ins.q_s_n)
    matrix_of_quaternion(ins.C_s_n, ins.q_s_n)


@compiled
def turn(ins: Ins, phi_n: Floats) -> None:
    """Turn the attitude by a rotation vector in n, rad."""
    rotation, product = ins.work_q[0], ins.work_q[1]
    quaternion_of_vector(rotation, phi_n)
    multiply(product, rotation, ins.q_s_n)
    for i in range(4):
        ins.q_s_n[i] = product[i]
    normalise(ins.q_s_n)
    matrix_of_quaternion(ins.C_s_n, ins.q_s_n)


@compiled
def _add_to_position(ins: Ins, dlatitude: float, dlongitude: float) -> None:
    """Add to latitude and longitude, carrying what rounding loses (Kahan's summation).

    An epoch at 1e-7 m/s moves less than half the spacing of floats, which would be lost.
    """
    step = dlatitude + ins.latitude_carry
    latitude = ins.latitude + step
    ins.latitude_carry = step - (latitude - ins.latitude)
    ins.latitude = latitude
    step = dlongitude + ins.longitude_carry
    longitude = ins.longitude + step
    ins.longitude_carry = step - (longitude - ins.longitude)
    ins.longitude = earth.wrapped(longitude)


@compiled
def _hold_height(ins: Ins, height_channel: int) -> None:
    """Bring the vertical channel back to its reference, according to the setting."""
    if height_channel == HEIGHT_HELD:
        ins.velocity_n[2] = 0.0
        ins.height = ins.reference_height
    elif height_channel == HEIGHT_DAMPED:
        dt = min(ins.reference_interval, _LONGEST_INTERVAL)
        if dt == 0.0:
            return
        error = ins.height - ins.reference_height
        ins.height_error_integral += error * dt
        stiffness = 3.0 / _DAMPING_TIME**2 + 2.0 * earth.GRAVITY_EQUATOR / earth.SEMI_MAJOR_AXIS
        ins.height -= 3.0 / _DAMPING_TIME * error * dt
        ins.velocity_n[2] -= (stiffness * error + ins.height_error_integral / _DAMPING_TIME**3) * dt


@compiled
def update(ins: Ins, dtheta_s: Floats, dv_s: Floats, dt: float, height_channel: int) -> None:
    """Navigate over one epoch.

    Parameters
    ----------
    ins : Ins
        Changed in place.
    dtheta_s, dv_s : array, shape (3,)
        Angle (rad) and velocity (m/s) increments of the epoch.
    dt : float
        Length of the epoch, s.
    height_channel : int
        `HEIGHT_HELD` (height and vertical velocity keep their initial values), `HEIGHT_DAMPED`
        (third order, towards `ins.reference_height` in every epoch whose `ins.reference_interval`,
        the seconds since the previous reference, is not 0) or `HEIGHT_FREE` (diverges, as an
        unaided channel does).
    """
    if ins.first:  # no previous increment: use the first one, exact for a constant rate
        ins.first = False
        for i in range(3):
            ins.dtheta_s_previous[i] = dtheta_s[i]
            ins.dv_s_previous[i] = dv_s[i]
    omega_ie_n, omega_en_n, zeta_n, dv_n = ins.work[2], ins.work[3], ins.work[4], ins.work[5]
    phi_s, dv_start_s, acceleration_n = ins.work[6], ins.work[7], ins.work[8]

    sine = parallel(ins).sine
    meridian, prime_vertical, cosine = _transport_rates(ins, omega_ie_n, omega_en_n)
    for i in range(3):
        zeta_n[i] = (omega_ie_n[i] + omega_en_n[i]) * dt
        omega_ie_n[i] = 2.0 * omega_ie_n[i] + omega_en_n[i]
        acceleration_n[i] = ins.velocity_n[i] + 0.5 * ins.velocity_change_n[i]

    # Velocity: Titterton and Weston (3.25), specific force turned into n at mid-epoch.
    velocity_in_start_frame(ins, dv_start_s, dtheta_s, dv_s)
    rotate(dv_n, ins.C_s_n, dv_start_s)
    cross(ins.work[0], zeta_n, dv_n)
    cross(ins.work[1], omega_ie_n, acceleration_n)
    for i in range(3):
        ins.velocity_change_n[i] = dv_n[i] - 0.5 * ins.work[0][i] - ins.work[1][i] * dt
    ins.velocity_change_n[2] -= earth.gravity_at(sine, ins.height) * dt
    if height_channel == HEIGHT_HELD:
        ins.velocity_change_n[2] = 0.0

    # Position: trapezoid of the velocity.
    half = 0.5 * dt
    latitude_rate = 1.0 / (meridian + ins.height)
    north = 2.0 * ins.velocity_n[1] + ins.velocity_change_n[1]
    east = 2.0 * ins.velocity_n[0] + ins.velocity_change_n[0]
    dlatitude = half * north * latitude_rate
    # cos(latitude) at mid-epoch, to first order in the step
    cosine -= sine * 0.5 * dlatitude
    dlongitude = half * east / ((prime_vertical + ins.height) * cosine)
    _add_to_position(ins, dlatitude, dlongitude)
    ins.height += half * (2.0 * ins.velocity_n[2] + ins.velocity_change_n[2])
    for i in range(3):
        ins.velocity_n[i] += ins.velocity_change_n[i]
    _hold_height(ins, height_channel)

    rotation_vector(phi_s, dtheta_s, ins.dtheta_s_previous)
    _update_attitude(ins, phi_s, zeta_n)
    for i in range(3):
        ins.dtheta_s_previous[i] = dtheta_s[i]
        ins.dv_s_previous[i] = dv_s[i]


@compiled
def update_array(
    array: Records[Ins], dtheta_s: Floats, dv_s: Floats, dt: float, height_channel: int
) -> None:
    """Navigate over one epoch, as `update` does, for a caller in Python.

    `array` has one record; an array is passed much faster than its record.
    """
    update(array[0], dtheta_s, dv_s, dt, height_channel)
