"""The odometer's wheel: its way by the navigation, beside which its distances are compared.

A vehicle on wheels moves along its forward axis: the way to the right of it and above it is slip.
Groves (2nd ed., 2013), sections 15.3, 15.4.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths.attitude import multiply_transposed, rotate
from rrins.firmware_py.core.modes import modes
from rrins.firmware_py.core.records.memory import WHEEL_EPOCHS, Odometer, Ram, Wheel

RIGHT_AXIS, FORWARD_AXIS, UP_AXIS = 0, 1, 2
"""Axes of the body."""

WAY, ATTITUDE_B, TURNED_B, LEVER_WAY = 0, 3, 12, 13
"""First column of each in a row of `Wheel.track`."""

SCALE_SIGMA = 0.01
"""Of the odometer's scale: tyres wear, and warm up."""

SCALE_WALK = 2e-3
"""1/√s, of the scale: a wheel that drives or brakes slips by some percent of its way."""

MOUNTING_SIGMA = math.radians(1.0)
"""rad, of each angle between y of the body and the vehicle's forward axis: mounted by eye."""

SLIP_SIGMA = 0.05
"""m/s, of the velocity across the forward axis: what tyres and springs let through."""

PIVOT_SIGMA, PIVOT_WANDERS = 2.0, 0.3
"""m, along the vehicle: how far from the wheel the point is that does not move sideways in a turn,
and by how much it is another one in each second. Steered wheels do, and tyres that turn fast."""

STANDING_SLIP = 0.005
"""m/s, across the forward axis, of a vehicle whose wheels stand: it sways on its springs."""

LONGEST_S = 2.5
"""A stretch between two counts that is longer has lost its odometer in between."""

_STANDS_BELOW = 0.3
"""m/s, of the navigation, with which a wheel that stands is one of a vehicle that stands."""


@compiled
def follow(state: Ram) -> None:
    """Add this epoch to the way of the wheel, where the strapdown runs."""
    wheel = state.wheel
    if state.odometer.interval_epochs == 0 or not modes.is_inertial(state):
        return
    if wheel.last + 1 != state.epoch or state.ins.first:
        _begin(state)
    else:
        _add(state, state.parameters.period_ns * 1e-9)
    wheel.last = state.epoch
    row = wheel.track[state.epoch % WHEEL_EPOCHS]
    for i in range(3):
        row[WAY + i] = wheel.way_b[i]
        row[LEVER_WAY + i] = wheel.lever_way_b[i]
        for k in range(3):
            row[ATTITUDE_B + 3 * i + k] = wheel.attitude_b[i, k]
    row[TURNED_B] = wheel.turned_b


@compiled
def _begin(state: Ram) -> None:
    wheel = state.wheel
    wheel.first = state.epoch
    wheel.turned_b = 0.0
    turn_lever(state)
    for i in range(3):
        wheel.way_b[i] = 0.0
        wheel.lever_way_b[i] = 0.0
        for k in range(3):
            wheel.attitude_b[i, k] = 0.0


@compiled
def turn_lever(state: Ram) -> None:
    """Write the body's attitude, and the lever arm in n; also where the attitude is corrected.

    The wheel has not moved by what a correction turns the lever arm.
    """
    wheel = state.wheel
    multiply_transposed(wheel.C_b_n, state.ins.C_s_n, state.C_s_b)
    rotate(wheel.lever_n, wheel.C_b_n, state.odometer.lever_arm_b)


@compiled
def _add(state: Ram, dt: float) -> None:
    wheel, ins = state.wheel, state.ins
    for i in range(3):
        wheel.moved_n[i] = -wheel.lever_n[i]
        wheel.right_n[i] = wheel.C_b_n[i, RIGHT_AXIS]
    turn_lever(state)
    C_b_n = wheel.C_b_n
    for i in range(3):
        wheel.moved_n[i] += wheel.lever_n[i]
        wheel.turned_b += wheel.right_n[i] * C_b_n[i, FORWARD_AXIS]
    _add_along(wheel.lever_way_b, C_b_n, wheel.moved_n)
    for i in range(3):
        middle = ins.velocity_n[i] - 0.5 * ins.velocity_change_n[i]
        wheel.moved_n[i] += middle * dt
        for k in range(3):
            wheel.attitude_b[i, k] += C_b_n[i, k] * dt
    _add_along(wheel.way_b, C_b_n, wheel.moved_n)


@compiled
def _add_along(way_b: Floats, C_b_n: Floats, moved_n: Floats) -> None:
    for k in range(3):
        way_b[k] += C_b_n[0, k] * moved_n[0] + C_b_n[1, k] * moved_n[1] + C_b_n[2, k] * moved_n[2]


@compiled
def is_known(wheel: Wheel, epoch: int) -> bool:
    """Return whether the way up to the end of an epoch is known."""
    oldest = max(int(wheel.first), int(wheel.last) - WHEEL_EPOCHS + 1)
    return bool(oldest <= epoch <= wheel.last)


@compiled
def stands(travelled_m: float, way_b: Floats, seconds: float) -> bool:
    """Return whether the wheel did not turn over a stretch, and is not merely locked."""
    way = math.sqrt(way_b[0] ** 2 + way_b[1] ** 2 + way_b[2] ** 2)
    return bool(travelled_m == 0.0 and way < _STANDS_BELOW * seconds)


@compiled
def slip_sigma(travelled_m: float, way_b: Floats, turned: float, seconds: float) -> float:
    """Return the noise of a stretch's way across, m; `turned` is its turn about up, rad."""
    if stands(travelled_m, way_b, seconds):
        return STANDING_SLIP * seconds
    return math.sqrt((SLIP_SIGMA * seconds) ** 2 + (PIVOT_SIGMA * turned) ** 2)


@compiled
def distance_sigma(odometer: Odometer, dt: float, seconds: float) -> float:
    """Return the noise of a stretch's distance, m: of each interval, and of its last pulse."""
    interval = odometer.interval_epochs * dt
    noise = odometer.noise * math.sqrt(interval * seconds)
    return math.sqrt(noise * noise + odometer.metres_per_pulse**2 / 6.0)


@compiled
def fill_row(
    row: Floats,
    attitude: int,
    velocity: int,
    C_b_n: Floats,
    way_b: Floats,
    seconds: float,
    axis: int,
) -> None:
    """Write what errors of attitude and velocity do to the way along an axis of the body.

    ``C_n_b velocity`` and ``[way_b x] C_n_b attitude``: a body that is turned takes another part of
    the velocity for its own.

    Parameters
    ----------
    row : array, shape (at least the states,)
    attitude, velocity : int
        First state of each: a turn of the body about the axes of n (rad), velocity_n (m/s).
    C_b_n : array, shape (3, 3)
    way_b : array, shape (3,)
        By the navigated velocity, m: an error of the attitude does not change how the lever arm
        turns in the body.
    seconds : float
        Length of the stretch.
    axis : int
        Of the body.
    """
    one, two = (axis + 1) % 3, (axis + 2) % 3
    for i in range(3):
        row[velocity + i] = C_b_n[i, axis] * seconds
        row[attitude + i] = way_b[one] * C_b_n[i, two] - way_b[two] * C_b_n[i, one]
