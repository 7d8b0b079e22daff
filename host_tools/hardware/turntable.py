"""An axis of the turntable: a drive with limited rate and acceleration, and an encoder.

A turn is a trapezoid of the rate in whole epochs: ramp, cruise, ramp. Its peak rate is chosen so
that the turn ends on the target exactly, never above the limits; so the rate is linear in time
within each epoch, and the truth can be integrated without error. A new command brakes first.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from dbc.values import AxisCommand, AxisState

_ROUNDING = 1e-9  # epochs: a time that is a whole number of epochs but for rounding
_SLOWEST = 1e-9  # rad/s: a rate limit of zero would never arrive


@njit(cache=True)
def command(axis: Any, what: int, target: float, rate: float) -> None:
    """Take a command: `target` in rad, `rate` in rad/s."""
    axis.command = what
    axis.target = target
    axis.commanded_rate = max(rate, _SLOWEST)


@njit(cache=True)
def _plan(axis: Any, dt: float) -> None:
    """Plan the turn from standstill to the target."""
    distance = axis.target - axis.angle
    length = abs(distance)
    rate = min(axis.rate_limit, axis.commanded_rate)
    ramp_s = min(rate / axis.acceleration_limit, math.sqrt(length / axis.acceleration_limit))
    ramp = max(1, math.ceil(ramp_s / dt - _ROUNDING))
    cruise = max(0, math.ceil(length / (rate * dt) - ramp - _ROUNDING))
    axis.profile_start = axis.angle
    axis.profile_end = axis.target
    axis.profile_ramp = ramp
    axis.profile_cruise = cruise
    axis.profile_rate = distance / ((ramp + cruise) * dt)
    axis.profile_epoch = 0
    axis.state = AxisState.MOVING


@njit(cache=True)
def _drive(axis: Any, dt: float) -> None:
    """Go on by one epoch in the planned turn."""
    axis.profile_epoch += 1
    ramp, cruise = axis.profile_ramp, axis.profile_cruise
    left = 2 * ramp + cruise - axis.profile_epoch
    peak = axis.profile_rate
    if axis.profile_epoch <= ramp:
        done = axis.profile_epoch
        axis.rate = peak * done / ramp
        axis.angle = axis.profile_start + peak * dt * done * done / (2.0 * ramp)
    elif left >= ramp:
        axis.rate = peak
        axis.angle = axis.profile_start + peak * dt * (axis.profile_epoch - 0.5 * ramp)
    else:
        axis.rate = peak * left / ramp
        axis.angle = axis.profile_end - peak * dt * left * left / (2.0 * ramp)
    if left == 0:
        axis.rate = 0.0
        axis.angle = axis.profile_end
        axis.state = AxisState.HOLDING


@njit(cache=True)
def _brake(axis: Any, dt: float) -> None:
    """Go on by one epoch towards standstill."""
    if abs(axis.rate) <= axis.brake_step:
        axis.angle += 0.5 * axis.rate * dt
        axis.rate = 0.0
        axis.state = AxisState.OFF if axis.command == AxisCommand.OFF else AxisState.HOLDING
    else:
        slower = axis.rate - math.copysign(axis.brake_step, axis.rate)
        axis.angle += 0.5 * (axis.rate + slower) * dt
        axis.rate = slower


@njit(cache=True)
def _begin_brake(axis: Any, dt: float) -> None:
    """Choose the deceleration that stops in whole epochs."""
    epochs = max(1, math.ceil(abs(axis.rate) / (axis.acceleration_limit * dt) - _ROUNDING))
    axis.brake_step = abs(axis.rate) / epochs
    axis.state = AxisState.BRAKING


@njit(cache=True)
def advance(axis: Any, dt: float) -> None:
    """Move the axis over one epoch; its rate is linear in time meanwhile."""
    axis.angle_before = axis.angle
    axis.rate_before = axis.rate
    if axis.blocked:  # stands at once, and starts anew when released
        axis.rate_before = 0.0
        axis.rate = 0.0
        axis.state = AxisState.HOLDING
        return
    wanted = axis.command == AxisCommand.POSITION
    if axis.state == AxisState.MOVING and (not wanted or axis.target != axis.profile_end):
        _begin_brake(axis, dt)
    elif axis.state in (AxisState.HOLDING, AxisState.OFF):
        if wanted and axis.target != axis.angle:
            _plan(axis, dt)
        else:
            off = axis.command == AxisCommand.OFF
            axis.state = AxisState.OFF if off else AxisState.HOLDING
    if axis.state == AxisState.MOVING:
        _drive(axis, dt)
    elif axis.state == AxisState.BRAKING:
        _brake(axis, dt)


@njit(cache=True)
def encoder_angle_deg(axis: Any) -> float:
    """Return what the encoder reads: the angle, rounded to its steps."""
    return round(math.degrees(axis.angle) / axis.encoder_step_deg) * axis.encoder_step_deg
