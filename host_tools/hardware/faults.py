"""Faults of the hardware itself: axes that stall or run away, encoders and sensors that fail.

Each has a kind, a target (axis, sensor group or direction), first and last epochs and a value; an
intermittent one is present in the first epochs of each period only. The active faults are
re-evaluated only in epochs in which a fault comes or goes, or changes as a ramp does.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault, Part
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

_PART_OF = np.array([-1, *(kind.part for kind in HardwareFault)])
"""By kind."""

_AS_OF_GYROS = (HardwareFault[kind.name.replace("ACCELEROMETER", "GYRO")] for kind in HardwareFault)
_EFFECT_OF = np.array([0, *_AS_OF_GYROS])
"""By kind: the kind itself, or that of gyros with the same effect."""


_GROWING = (HardwareFault.GYRO_RAMP, HardwareFault.GNSS_PULL, HardwareFault.ALTIMETER_PULL)


@compiled
def _clear(plant: Plant) -> None:
    for axis in (INNER, OUTER):
        plant.axis[axis].blocked = False
        plant.axis[axis].runaway = False
        plant.axis[axis].encoder_stuck = False
        plant.axis[axis].encoder_error_deg = 0.0
        plant.axis[axis].encoder_slip = 0.0
    gnss, odometer, altimeter = plant.gnss, plant.odometer, plant.altimeter
    odometer.slip = 0.0
    odometer.locked = False
    odometer.lost = False
    gnss.lost = False
    altimeter.fault_height = 0.0
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
    elif kind == HardwareFault.ENCODER_OFFSET:
        axis.encoder_error_deg += value


@compiled
def _set_aiding(plant: Plant, kind: int, target: int, value: float, age_s: float) -> None:
    """Set a fault of an aid that began `age_s` before the end of the epoch."""
    gnss, odometer, altimeter = plant.gnss, plant.odometer, plant.altimeter
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
    elif kind == HardwareFault.GNSS_LOST:
        gnss.lost = True
    elif kind == HardwareFault.ALTIMETER_JUMP:
        altimeter.fault_height += value
    elif kind == HardwareFault.ALTIMETER_PULL:
        altimeter.fault_height += value * age_s


@compiled
def _set_sensors(
    sensors: Sensors, kind: int, target: int, value: float, dt: float, age_s: float
) -> None:
    """Set a fault of sensors, by the kind of gyros, `age_s` before the middle of the epoch."""
    for k in range(sensors.count):
        if target not in (k, EVERY):
            continue
        if kind == HardwareFault.GYRO_STUCK:
            sensors.stuck |= 1 << k
        elif kind == HardwareFault.GYRO_BIAS:
            sensors.fault_bias_increment[k] += value * dt
        elif kind == HardwareFault.GYRO_NOISE:
            before = sensors.fault_noise_increment[k]
            sensors.fault_noise_increment[k] = math.sqrt(before * before + value * value * dt)
        elif kind == HardwareFault.GYRO_ABSENT:
            sensors.absent |= 1 << k
        elif kind == HardwareFault.GYRO_RAMP:
            sensors.fault_bias_increment[k] += value * age_s * dt
        elif kind == HardwareFault.GYRO_SCALE:
            sensors.fault_scale_error[k] += value
        elif kind == HardwareFault.GYRO_DEAD:
            sensors.dead |= 1 << k
        elif kind == HardwareFault.GYRO_FULL_SCALE:
            sensors.full_scale |= 1 << k
        elif kind in (HardwareFault.GYRO_SHIFT_U, HardwareFault.GYRO_SHIFT_V):
            turned = sensors.axis_by_angle[k, kind - HardwareFault.GYRO_SHIFT_U]
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
        part, effect = _PART_OF[kind], _EFFECT_OF[kind]
        if effect in _GROWING:
            faults.changes_at = min(faults.changes_at, plant.epoch + 1)
        age = plant.epoch - first  # epochs
        if part == Part.AXIS:
            _set_axis(plant.axis[target], kind, value)
        elif part == Part.GYRO:
            _set_sensors(plant.gyros, effect, target, value, dt, (age + 0.5) * dt)
        elif part == Part.ACCELEROMETER:
            _set_sensors(plant.accelerometers, effect, target, value, dt, (age + 0.5) * dt)
        else:
            _set_aiding(plant, kind, target, value, (age + 1) * dt)


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
