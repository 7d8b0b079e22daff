"""Faults of the hardware itself: axes that stall or run away, encoders and sensors that fail.

Each has a kind, a target (axis or sensor group), first and last epochs and a value. The active
faults are re-evaluated only in epochs in which a fault begins or ends.
"""

from __future__ import annotations

import math
from enum import IntEnum

from rrins.dbc.compilation import compiled
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
    by the value, °. GYRO_STUCK, ACCELEROMETER_STUCK: repeats its last increment. GYRO_BIAS,
    ACCELEROMETER_BIAS: additional bias, rad/s or m/s². GYRO_NOISE, ACCELEROMETER_NOISE: additional
    white noise, rad/√s or m/s/√s. GYRO_ABSENT, ACCELEROMETER_ABSENT: flagged as absent.
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


_STUCK, _BIAS, _NOISE, _ABSENT = 0, 1, 2, 3  # of a sensor, above its kind's first


@compiled
def _clear(plant: Plant) -> None:
    for axis in (INNER, OUTER):
        plant.axis[axis].blocked = False
        plant.axis[axis].runaway = False
        plant.axis[axis].encoder_stuck = False
        plant.axis[axis].encoder_error_deg = 0.0
    for kind in range(2):
        sensors = plant.gyros if kind == 0 else plant.accelerometers
        sensors.stuck = 0
        sensors.absent = 0
        for k in range(SENSOR_GROUPS):
            sensors.fault_bias_increment[k] = 0.0
            sensors.fault_noise_increment[k] = 0.0


@compiled
def _set_axis(axis: TurntableAxis, kind: int, value: float) -> None:
    if kind == HardwareFault.AXIS_STALL:
        axis.blocked = True
    elif kind == HardwareFault.AXIS_RUNAWAY:
        axis.runaway = True
        axis.runaway_rate = value
    elif kind == HardwareFault.ENCODER_STUCK:
        axis.encoder_stuck = True
    else:
        axis.encoder_error_deg += value


@compiled
def _set_sensors(sensors: Sensors, what: int, target: int, value: float, dt: float) -> None:
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
        else:
            sensors.absent |= 1 << k


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
        kind, target, value = faults.kind[k], faults.target[k], faults.value[k]
        if kind < HardwareFault.GYRO_STUCK:
            _set_axis(plant.axis[target], kind, value)
        elif kind < HardwareFault.ACCELEROMETER_STUCK:
            _set_sensors(plant.gyros, kind - HardwareFault.GYRO_STUCK, target, value, dt)
        else:
            what = kind - HardwareFault.ACCELEROMETER_STUCK
            _set_sensors(plant.accelerometers, what, target, value, dt)


def put(plant: Plant, kind: int, target: int, first: int, last: int, value: float) -> bool:
    """Plan a fault from epoch `first` to `last` (negative: to the end); False if there is no room.

    Faults that have ended make room.
    """
    faults = plant.faults
    kept = [k for k in range(faults.count) if faults.last_epoch[k] >= plant.epoch]
    columns = ("kind", "target", "first_epoch", "last_epoch", "value")
    for name in columns:
        faults[name][: len(kept)] = faults[name][kept]
    count = len(kept)
    faults.count = count
    if count == FAULT_CAPACITY:
        return False
    row = (kind, target, first, NEVER - 1 if last < 0 else last, value)
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
