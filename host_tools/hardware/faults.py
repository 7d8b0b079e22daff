"""Faults of the hardware itself: axes that stall or run away, encoders and sensors that fail.

Each has a kind, a target (axis, sensor group or direction), first and last epochs and a value; an
intermittent one is present in the first epochs of each period only. The active faults are
re-evaluated only in epochs in which a fault comes or goes, or changes as a ramp does.
"""

from __future__ import annotations

import math
from enum import IntEnum

from rrins.compiled.compilation import compiled
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.host_tools.hardware.memory import (
    FAULT_CAPACITY,
    INNER,
    OUTER,
    Plant,
    Sensors,
    TurntableAxis,
)

NEVER = 1 << 62
"""An epoch that is never reached."""

EVERY = -1
"""Target that means all sensors."""


class HardwareFault(IntEnum):
    """Kinds of fault, as `kind` of HARDWARE_FAULT_COMMAND; the value of each, in SI units.

    AXIS_STALL: an axis stops (no value). AXIS_RUNAWAY: it turns at the value, rad/s.
    ENCODER_STUCK: its encoder repeats the last angle. ENCODER_OFFSET: its encoder reads too much
    by the value, °. ENCODER_SLIP: its encoder misses this share of what it turns, for good.
    GYRO_STUCK, ACCELEROMETER_STUCK: repeats its last increment. GYRO_BIAS, ACCELEROMETER_BIAS:
    additional bias, rad/s or m/s². GYRO_NOISE, ACCELEROMETER_NOISE: additional white noise, rad/√s
    or m/s/√s. GYRO_ABSENT, ACCELEROMETER_ABSENT: flagged as absent. RAMP: a bias that grows from
    zero, rad/s² or m/s³. SCALE: additional error of the scale factor. SHIFT_U, SHIFT_V: the mount
    turns, additional installation angle δu or δv, rad. DEAD: reads zero. FULL_SCALE: reads the end
    of its range, flagged as saturated.

    ODOMETER_SLIP: the wheel turns more than the vehicle moves, by this share. ODOMETER_LOCK: the
    wheel stands. ODOMETER_LOST: it does not count. GNSS_JUMP: positions are off by the value, m.
    GNSS_PULL: they are led away at the value, m/s, and velocities with them. GNSS_LOST: no fix.

    Kinds of sensors have the same faults in the same order, in two blocks each.
    """

    AXIS_STALL = 1
    AXIS_RUNAWAY = 2
    ENCODER_STUCK = 3
    ENCODER_OFFSET = 4
    GYRO_STUCK = 5
    GYRO_BIAS = 6
    GYRO_NOISE = 7
    GYRO_ABSENT = 8
    ACCELEROMETER_STUCK = 9
    ACCELEROMETER_BIAS = 10
    ACCELEROMETER_NOISE = 11
    ACCELEROMETER_ABSENT = 12
    GYRO_RAMP = 13
    GYRO_SCALE = 14
    GYRO_SHIFT_U = 15
    GYRO_SHIFT_V = 16
    GYRO_DEAD = 17
    GYRO_FULL_SCALE = 18
    ACCELEROMETER_RAMP = 19
    ACCELEROMETER_SCALE = 20
    ACCELEROMETER_SHIFT_U = 21
    ACCELEROMETER_SHIFT_V = 22
    ACCELEROMETER_DEAD = 23
    ACCELEROMETER_FULL_SCALE = 24
    ENCODER_SLIP = 25
    ODOMETER_SLIP = 26
    ODOMETER_LOCK = 27
    ODOMETER_LOST = 28
    GNSS_JUMP = 29
    GNSS_PULL = 30
    GNSS_LOST = 31


_STUCK, _BIAS, _NOISE, _ABSENT = 0, 1, 2, 3  # of a sensor, the first block of its kind
_RAMP, _SCALE, _SHIFT_U, _SHIFT_V, _DEAD, _FULL_SCALE = 4, 5, 6, 7, 8, 9  # the second
_FIRST_BLOCK, _SECOND_BLOCK = 4, 6  # faults in each


@compiled
def is_of_axis(kind: int) -> bool:
    """Return whether an axis has faults of this kind, not a sensor."""
    return kind < HardwareFault.GYRO_STUCK or kind == HardwareFault.ENCODER_SLIP


@compiled
def is_of_aiding(kind: int) -> bool:
    """Return whether a source of aiding has faults of this kind."""
    return kind > HardwareFault.ENCODER_SLIP


@compiled
def has_direction(kind: int) -> bool:
    """Return whether the target of a kind of fault is a direction: 0 east, 1 north, 2 up."""
    return kind in (HardwareFault.GNSS_JUMP, HardwareFault.GNSS_PULL)


@compiled
def is_of_gyros(kind: int) -> bool:
    """Return whether gyros have faults of this kind of fault of sensors."""
    if kind < HardwareFault.GYRO_RAMP:
        return kind < HardwareFault.ACCELEROMETER_STUCK
    return kind < HardwareFault.ACCELEROMETER_RAMP


@compiled
def _effect_of(kind: int) -> int:
    """Return what a kind of fault of sensors does, for either kind of sensor."""
    if kind < HardwareFault.GYRO_RAMP:
        return (kind - HardwareFault.GYRO_STUCK) % _FIRST_BLOCK
    return _FIRST_BLOCK + (kind - HardwareFault.GYRO_RAMP) % _SECOND_BLOCK


@compiled
def _clear(plant: Plant) -> None:
    for axis in (INNER, OUTER):
        plant.axis[axis].blocked = False
        plant.axis[axis].runaway = False
        plant.axis[axis].encoder_stuck = False
        plant.axis[axis].encoder_error_deg = 0.0
        plant.axis[axis].encoder_slip = 0.0
    gnss, odometer = plant.gnss, plant.odometer
    odometer.slip = 0.0
    odometer.locked = False
    odometer.lost = False
    gnss.lost = False
    for i in range(3):
        gnss.fault_position[i] = 0.0
        gnss.fault_velocity[i] = 0.0
    for kind in range(2):
        sensors = plant.gyros if kind == 0 else plant.accelerometers
        sensors.stuck = 0
        sensors.absent = 0
        sensors.dead = 0
        sensors.full_scale = 0
        for k in range(SENSOR_GROUPS):
            sensors.fault_bias_increment[k] = 0.0
            sensors.fault_noise_increment[k] = 0.0
            sensors.fault_scale_error[k] = 0.0
            for i in range(3):
                sensors.axis[k, i] = sensors.mounted_axis[k, i]


@compiled
def _set_axis(axis: TurntableAxis, kind: int, value: float) -> None:
    if kind == HardwareFault.AXIS_STALL:
        axis.blocked = True
    elif kind == HardwareFault.AXIS_RUNAWAY:
        axis.runaway = True
        axis.runaway_rate = value
    elif kind == HardwareFault.ENCODER_STUCK:
        axis.encoder_stuck = True
    elif kind == HardwareFault.ENCODER_SLIP:
        axis.encoder_slip += value
    else:
        axis.encoder_error_deg += value


@compiled
def _set_aiding(plant: Plant, kind: int, target: int, value: float, age_s: float) -> None:
    """Set a fault of GNSS or odometer that began `age_s` before the end of the epoch."""
    gnss, odometer = plant.gnss, plant.odometer
    if kind == HardwareFault.ODOMETER_SLIP:
        odometer.slip += value
    elif kind == HardwareFault.ODOMETER_LOCK:
        odometer.locked = True
    elif kind == HardwareFault.ODOMETER_LOST:
        odometer.lost = True
    elif kind == HardwareFault.GNSS_JUMP:
        gnss.fault_position[target] += value
    elif kind == HardwareFault.GNSS_PULL:
        gnss.fault_position[target] += value * age_s
        gnss.fault_velocity[target] += value
    else:
        gnss.lost = True


@compiled
def _set_sensors(
    sensors: Sensors, what: int, target: int, value: float, dt: float, age_s: float
) -> None:
    """Set a fault of sensors that began `age_s` before the middle of the epoch."""
    for k in range(sensors.count):
        if target not in (k, EVERY):
            continue
        if what == _STUCK:
            sensors.stuck |= 1 << k
        elif what == _BIAS:
            sensors.fault_bias_increment[k] += value * dt
        elif what == _NOISE:
            before = sensors.fault_noise_increment[k]
            sensors.fault_noise_increment[k] = math.sqrt(before * before + value * value * dt)
        elif what == _ABSENT:
            sensors.absent |= 1 << k
        elif what == _RAMP:
            sensors.fault_bias_increment[k] += value * age_s * dt
        elif what == _SCALE:
            sensors.fault_scale_error[k] += value
        elif what == _DEAD:
            sensors.dead |= 1 << k
        elif what == _FULL_SCALE:
            sensors.full_scale |= 1 << k
        else:
            turned = sensors.axis_by_angle[k, what - _SHIFT_U]
            for i in range(3):
                sensors.axis[k, i] += value * turned[i]


@compiled
def apply(plant: Plant) -> None:
    """Activate the faults of the plant's epoch, and no others."""
    faults = plant.faults
    if plant.epoch < faults.changes_at:
        return
    _clear(plant)
    faults.changes_at = NEVER
    dt = plant.period_ns * 1e-9
    for k in range(faults.count):
        first, last = faults.first_epoch[k], faults.last_epoch[k]
        if plant.epoch < first:
            faults.changes_at = min(faults.changes_at, first)
            continue
        if plant.epoch > last:
            continue
        faults.changes_at = min(faults.changes_at, last + 1)
        period = faults.period_epochs[k]
        if period > 0:
            phase = (plant.epoch - first) % period
            is_on = phase < faults.on_epochs[k]
            changes_in = (faults.on_epochs[k] if is_on else period) - phase
            faults.changes_at = min(faults.changes_at, plant.epoch + changes_in)
            if not is_on:
                continue
        kind, target, value = faults.kind[k], faults.target[k], faults.value[k]
        if is_of_axis(kind):
            _set_axis(plant.axis[target], kind, value)
            continue
        if is_of_aiding(kind):
            if kind == HardwareFault.GNSS_PULL:
                faults.changes_at = min(faults.changes_at, plant.epoch + 1)
            _set_aiding(plant, kind, target, value, (plant.epoch - first + 1) * dt)
            continue
        what = _effect_of(kind)
        if what == _RAMP:
            faults.changes_at = min(faults.changes_at, plant.epoch + 1)
        age_s = (plant.epoch - first + 0.5) * dt
        sensors = plant.gyros if is_of_gyros(kind) else plant.accelerometers
        _set_sensors(sensors, what, target, value, dt, age_s)


ALWAYS = (0, 0)
"""The cycle of a fault that is not intermittent."""


def cycle_of(period_s: float, duty: float, period_ns: int) -> tuple[int, int]:
    """Return an intermittent fault's cycle in epochs: its period, and those in which it is present.

    `period_ns` is the length of an epoch; either part of the period is an epoch at least.
    """
    period = max(2, round(period_s * 1e9 / period_ns))
    return period, min(period - 1, max(1, round(duty * period)))


def put(
    plant: Plant,
    kind: int,
    target: int,
    first: int,
    last: int,
    value: float,
    cycle: tuple[int, int] = ALWAYS,
) -> bool:
    """Plan a fault from epoch `first` to `last` (negative: to the end); False if there is no room.

    `cycle` is as `cycle_of` returns it. Faults that have ended make room.
    """
    faults = plant.faults
    kept = [k for k in range(faults.count) if faults.last_epoch[k] >= plant.epoch]
    columns = (
        "kind",
        "target",
        "first_epoch",
        "last_epoch",
        "value",
        "period_epochs",
        "on_epochs",
    )
    for name in columns:
        faults[name][: len(kept)] = faults[name][kept]
    count = len(kept)
    faults.count = count
    if count == FAULT_CAPACITY:
        return False
    row = (kind, target, first, NEVER - 1 if last < 0 else last, value, *cycle)
    for name, entry in zip(columns, row, strict=True):
        faults[name][count] = entry
    faults.count = count + 1
    faults.changes_at = 0
    return True


def remove(plant: Plant, kind: int | None = None, target: int | None = None) -> int:
    """End the faults of a kind and target, or all, before the next epoch; return their number."""
    faults = plant.faults
    ended = 0
    for k in range(faults.count):
        meant = kind in (None, faults.kind[k]) and target in (None, faults.target[k])
        if meant and faults.last_epoch[k] >= plant.epoch:
            faults.last_epoch[k] = plant.epoch - 1
            ended += 1
    faults.changes_at = 0
    return ended
