"""An axis of the turntable: a drive with limited rate, acceleration and jerk, a load, an encoder.

A turn is a trapezoid of the rate in whole epochs: ramp, cruise, ramp. Its peak rate is chosen so
that the turn ends exactly on the target, never above the limits. If the jerk is limited, the
trapezoid is averaged over the epochs that the acceleration needs to rise, and cruises for at least
as long. The drive's rate is linear in time within each epoch. A new target, or a rate lower than
the turn's, brakes first: at constant deceleration, or, if the jerk is limited, with a rate that is
a cubic in time.

FOLLOW makes the drive keep up with a target that moves from epoch to epoch, within the limits of
rate and acceleration. An axis with limited jerk brakes instead.

The load follows the drive: stiction holds it until the drive has wound up by a given angle, and
the ripple of gears and motor is added, a function of the angle.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.dbc.values import AxisCommand, AxisState
from rrins.host_tools.hardware.memory import TurntableAxis

_ROUNDING = 1e-9  # epochs: tolerance for a time that is a whole number of epochs
_SAME_RATE = 1.0 + 1e-6  # a turn planned for a rate exceeds it by rounding at most
_SLOWEST = 1e-9  # rad/s: with a rate limit of zero a turn would never end
_CATCH_UP_S = 0.05  # time constant of the load coming free
_KEEP_UP_S = 0.05  # time constant in which a small deviation from a moving target fades
_FREE = 1e-3  # of the stiction: the load has caught up


@compiled
def command(axis: TurntableAxis, what: int, target: float, rate: float) -> None:
    """Accept a command: `target` in rad, `rate` in rad/s."""
    axis.command = what
    axis.target = target
    axis.commanded_rate = max(rate, _SLOWEST)


@compiled
def _plan(axis: TurntableAxis, dt: float) -> None:
    """Plan the turn from standstill to the target."""
    distance = axis.target - axis.drive_angle
    length = abs(distance)
    rate = min(axis.rate_limit, axis.commanded_rate)
    ramp_s = min(rate / axis.acceleration_limit, math.sqrt(length / axis.acceleration_limit))
    ramp = max(1, math.ceil(ramp_s / dt - _ROUNDING))
    cruise = max(0, math.ceil(length / (rate * dt) - ramp - _ROUNDING))
    if axis.ramp_smoothing > 1:  # else one average would span both ramps: twice the jerk
        cruise = max(cruise, axis.ramp_smoothing)
    axis.profile_start = axis.drive_angle
    axis.profile_end = axis.target
    axis.profile_ramp = ramp
    axis.profile_cruise = cruise
    axis.profile_rate = distance / ((ramp + cruise) * dt)
    axis.profile_epoch = 0
    axis.state = AxisState.MOVING


@compiled
def _trapezoid(axis: TurntableAxis, epoch: int, dt: float) -> tuple[float, float]:
    """Return angle and rate of the planned trapezoid at the end of its epoch `epoch`."""
    ramp, cruise = axis.profile_ramp, axis.profile_cruise
    left = 2 * ramp + cruise - epoch
    peak = axis.profile_rate
    if epoch <= 0:
        return axis.profile_start, 0.0
    if left <= 0:
        return axis.profile_end, 0.0
    if epoch <= ramp:
        angle = axis.profile_start + peak * dt * epoch * epoch / (2.0 * ramp)
        return angle, peak * epoch / ramp
    if left >= ramp:
        return axis.profile_start + peak * dt * (epoch - 0.5 * ramp), peak
    return axis.profile_end - peak * dt * left * left / (2.0 * ramp), peak * left / ramp


@compiled
def _serves(axis: TurntableAxis) -> bool:
    """Return whether the planned turn is what is commanded: its target, and no faster from now."""
    if axis.command != AxisCommand.POSITION or axis.target != axis.profile_end:
        return False
    slows_down = axis.profile_epoch >= axis.profile_ramp + axis.profile_cruise
    return slows_down or abs(axis.profile_rate) <= axis.commanded_rate * _SAME_RATE


@compiled
def _drive(axis: TurntableAxis, dt: float) -> None:
    """Advance the planned turn by one epoch."""
    axis.profile_epoch += 1
    epoch, smoothing = axis.profile_epoch, max(1, axis.ramp_smoothing)
    ramp, cruise = axis.profile_ramp, axis.profile_cruise
    if epoch >= 2 * ramp + cruise + smoothing - 1:
        axis.drive_rate = 0.0
        axis.drive_angle = axis.profile_end
        axis.state = AxisState.HOLDING
    elif smoothing == 1:
        axis.drive_angle, axis.drive_rate = _trapezoid(axis, epoch, dt)
    elif epoch - smoothing + 1 >= ramp and epoch <= ramp + cruise:
        axis.drive_rate = axis.profile_rate
        middle = epoch - 0.5 * (ramp + smoothing - 1)
        axis.drive_angle = axis.profile_start + axis.profile_rate * dt * middle
    else:
        angle, rate = 0.0, 0.0
        for k in range(epoch - smoothing + 1, epoch + 1):
            one_angle, one_rate = _trapezoid(axis, k, dt)
            angle += one_angle - axis.profile_start
            rate += one_rate
        axis.drive_angle = axis.profile_start + angle / smoothing
        axis.drive_rate = rate / smoothing


@compiled
def _plan_stop(axis: TurntableAxis, dt: float) -> None:
    """Plan how the rate falls to zero in whole epochs: straight, or as a cubic without a kink.

    The cubic decelerates at most at 3/2 of the mean; its jerk is at most 6 rate / T².
    """
    rate, limit = abs(axis.drive_rate), axis.acceleration_limit
    seconds = rate / limit
    if axis.ramp_smoothing > 1:
        jerk = limit / (axis.ramp_smoothing * dt)
        seconds = max(1.5 * seconds, math.sqrt(6.0 * rate / jerk))
    axis.brake_rate = axis.drive_rate
    axis.brake_epochs = max(1, math.ceil(seconds / dt - _ROUNDING))
    axis.brake_epoch = 0


@compiled
def _begin_brake(axis: TurntableAxis, dt: float) -> None:
    axis.state = AxisState.BRAKING
    axis.brake_acceleration = axis.drive_acceleration if axis.ramp_smoothing > 1 else 0.0
    if axis.brake_acceleration == 0.0:
        _plan_stop(axis, dt)


@compiled
def _brake(axis: TurntableAxis, dt: float) -> None:
    """Advance by one epoch towards standstill; with limited jerk the acceleration fades first."""
    before = axis.drive_rate
    if axis.brake_acceleration != 0.0:
        step = axis.acceleration_limit / axis.ramp_smoothing
        left = max(0.0, abs(axis.brake_acceleration) - step)
        axis.brake_acceleration = math.copysign(left, axis.brake_acceleration)
        axis.drive_rate += axis.brake_acceleration * dt
        if axis.brake_acceleration == 0.0:
            _plan_stop(axis, dt)
    else:
        axis.brake_epoch += 1
        left = 1.0 - axis.brake_epoch / axis.brake_epochs
        share = left * left * (3.0 - 2.0 * left) if axis.ramp_smoothing > 1 else left
        axis.drive_rate = axis.brake_rate * share
        if axis.brake_epoch >= axis.brake_epochs:
            axis.drive_rate = 0.0
            axis.state = AxisState.OFF if axis.command == AxisCommand.OFF else AxisState.HOLDING
    axis.drive_angle += 0.5 * (before + axis.drive_rate) * dt


@compiled
def _keep_up(axis: TurntableAxis, dt: float) -> None:
    """Follow the moving target for an epoch: at its rate, and so that the deviation fades.

    From far away the drive closes in as fast as half its acceleration can brake.
    """
    target_before = axis.followed if axis.is_following else axis.target
    deviation = target_before - axis.drive_angle
    closing = min(
        abs(deviation) / max(_KEEP_UP_S, 4.0 * dt),
        math.sqrt(axis.acceleration_limit * abs(deviation)),
    )
    rate = (axis.target - target_before) / dt + math.copysign(closing, deviation)
    limit = min(axis.rate_limit, axis.commanded_rate)
    rate = min(limit, max(-limit, rate))
    before, change = axis.drive_rate, axis.acceleration_limit * dt
    axis.drive_rate = min(before + change, max(before - change, rate))
    axis.drive_angle += 0.5 * (before + axis.drive_rate) * dt
    stands = axis.drive_rate == 0.0 and before == 0.0
    axis.state = AxisState.HOLDING if stands else AxisState.MOVING
    axis.profile_end = math.nan  # matches no target: afterwards the axis brakes and replans
    axis.followed = axis.target
    axis.is_following = True


@compiled
def _run_away(axis: TurntableAxis, dt: float) -> None:
    """Turn at the rate of the runaway, whatever is commanded."""
    step = axis.acceleration_limit * dt
    faster = axis.drive_rate + min(step, max(-step, axis.runaway_rate - axis.drive_rate))
    axis.drive_angle += 0.5 * (axis.drive_rate + faster) * dt
    axis.drive_rate = faster
    axis.state = AxisState.MOVING
    axis.profile_end = math.nan  # matches no target: afterwards the axis brakes and replans


@compiled
def _follow(axis: TurntableAxis, dt: float) -> None:
    """Move the load after the drive."""
    if axis.stiction > 0.0:
        before = axis.load_angle
        gap = axis.drive_angle - before
        if axis.sticks and abs(gap) > axis.stiction:
            axis.sticks = False
        if not axis.sticks:
            axis.load_angle = axis.drive_angle - gap * math.exp(-dt / _CATCH_UP_S)
            gap = axis.drive_angle - axis.load_angle
            axis.sticks = axis.drive_rate == 0.0 and abs(gap) < _FREE * axis.stiction
        rate = 0.0 if axis.sticks else (axis.load_angle - before) / dt
    else:
        axis.load_angle = axis.drive_angle
        rate = axis.drive_rate
    axis.angle, axis.rate = axis.load_angle, rate
    if axis.ripple > 0.0:
        phase = axis.ripple_per_turn * axis.load_angle
        axis.angle += axis.ripple * math.sin(phase)
        axis.rate *= 1.0 + axis.ripple * axis.ripple_per_turn * math.cos(phase)


@compiled
def advance(axis: TurntableAxis, dt: float) -> None:
    """Move the axis over one epoch.

    Within it the table's angle is the cubic through the angles and rates at both ends.
    """
    axis.angle_before = axis.angle
    axis.rate_before = axis.rate
    follows = axis.command == AxisCommand.FOLLOW and axis.ramp_smoothing <= 1
    if not follows or axis.blocked or axis.runaway:
        axis.is_following = False
    if axis.blocked:  # stops at once, and restarts when released
        axis.rate_before = 0.0
        axis.rate = 0.0
        axis.drive_rate = axis.drive_acceleration = 0.0
        axis.drive_angle = axis.load_angle
        axis.state = AxisState.HOLDING
        return
    wanted = axis.command == AxisCommand.POSITION
    rate_before = axis.drive_rate
    if axis.runaway:
        _run_away(axis, dt)
        axis.drive_acceleration = (axis.drive_rate - rate_before) / dt
        _follow(axis, dt)
        return
    if follows:
        _keep_up(axis, dt)
        axis.drive_acceleration = (axis.drive_rate - rate_before) / dt
        _follow(axis, dt)
        return
    if axis.state == AxisState.MOVING and not _serves(axis):
        _begin_brake(axis, dt)
    elif axis.state in (AxisState.HOLDING, AxisState.OFF):
        if wanted and axis.target != axis.drive_angle:
            _plan(axis, dt)
        else:
            off = axis.command == AxisCommand.OFF
            axis.state = AxisState.OFF if off else AxisState.HOLDING
    if axis.state == AxisState.MOVING:
        _drive(axis, dt)
    elif axis.state == AxisState.BRAKING:
        _brake(axis, dt)
    elif axis.rate == 0.0 and axis.load_angle == axis.drive_angle:
        return
    axis.drive_acceleration = (axis.drive_rate - rate_before) / dt
    _follow(axis, dt)


@compiled
def slip(axis: TurntableAxis) -> None:
    """Let the encoder miss its share of the epoch's turning."""
    if axis.encoder_slip != 0.0:
        turned_deg = math.degrees(axis.angle - axis.angle_before)
        axis.encoder_slipped_deg += axis.encoder_slip * turned_deg


@compiled
def encoder_angle_deg(axis: TurntableAxis) -> float:
    """Return the encoder's reading: the angle with its errors, rounded to its steps."""
    if axis.encoder_stuck:
        return axis.encoder_held_deg
    angle_deg = math.degrees(axis.angle) + axis.encoder_offset_deg + axis.encoder_error_deg
    angle_deg -= axis.encoder_slipped_deg
    axis.encoder_held_deg = round(angle_deg / axis.encoder_step_deg) * axis.encoder_step_deg
    return axis.encoder_held_deg
