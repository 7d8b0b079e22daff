"""The emulated odometer: a wheel that counts pulses along the vehicle's forward axis.

The wheel rolls at the speed of its point of contact along the vehicle's forward axis::

    u = a · (C_n^b v^n + (ω_ib^b - C_n^b ω_ie^n) x l)

with a the forward axis and l the lever arm, both in the body frame (Groves, *Principles of GNSS,
Inertial, and Multisensor Integrated Navigation Systems*, 2nd ed., 2013, section 6.3). It is summed
over the epochs by the trapezoidal rule. The count is taken at the end of an epoch and sent some
epochs later.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.dbc.codec import pack
from rrins.dbc.contract import MessageSignals
from rrins.host_tools.hardware import earth, motion
from rrins.host_tools.hardware.memory import OdometerState, Plant
from rrins.host_tools.hardware.noise import normal

STANDING_MPS = 0.01
"""Mean speed below which the count has no noise: a wheel that stands counts nothing."""


@compiled
def _speed(odometer: OdometerState, piece: Floats, u: float) -> float:
    """Return the speed of the wheel, m/s, at `u` of a piece of motion."""
    roll, pitch = (
        motion.value(piece, motion.ATTITUDE, u),
        motion.value(piece, motion.ATTITUDE + 1, u),
    )
    heading = motion.value(piece, motion.ATTITUDE + 2, u)
    sr, cr, sp, cp = math.sin(roll), math.cos(roll), math.sin(pitch), math.cos(pitch)
    sh, ch = math.sin(heading), math.cos(heading)
    # a in the navigation frame: Rz(-heading) Rx(pitch) Ry(roll)
    ax, ay, az = odometer.forward_b[0], odometer.forward_b[1], odometer.forward_b[2]
    right, level = cr * ax + sr * az, cr * az - sr * ax
    ahead, up = cp * ay - sp * level, sp * ay + cp * level
    east, north = ch * right + sh * ahead, ch * ahead - sh * right
    speed = east * motion.value(piece, motion.VELOCITY, u)
    speed += north * motion.value(piece, motion.VELOCITY + 1, u)
    speed += up * motion.value(piece, motion.VELOCITY + 2, u)
    if odometer.has_lever_arm:  # a · (ω x l) = ω · (l x a)
        lx, ly, lz = odometer.lever_arm[0], odometer.lever_arm[1], odometer.lever_arm[2]
        latitude = motion.value(piece, motion.POSITION, u)
        north_rate = earth.ROTATION_RATE * math.cos(latitude)
        up_rate = earth.ROTATION_RATE * math.sin(latitude)
        ahead, up = ch * north_rate, up_rate
        right, forward, above = -sh * north_rate, cp * ahead + sp * up, cp * up - sp * ahead
        wx = motion.value(piece, motion.RATE, u) - (cr * right - sr * above)
        wy = motion.value(piece, motion.RATE + 1, u) - forward
        wz = motion.value(piece, motion.RATE + 2, u) - (cr * above + sr * right)
        speed += wx * (ly * az - lz * ay) + wy * (lz * ax - lx * az) + wz * (lx * ay - ly * ax)
    return speed


@compiled
def turn(plant: Plant, pieces: Floats, dt: float) -> None:
    """Turn the wheel over the epoch."""
    odometer = plant.odometer
    index = motion.piece_of(plant, plant.epoch)
    speed = 0.0
    if index >= 0:
        end = motion.begin_of(plant, plant.epoch) + 1.0 / plant.piece_epochs
        speed = _speed(odometer, pieces[index], end)
    if odometer.lost:
        odometer.missed = True
    elif not odometer.locked:
        odometer.rolled += 0.5 * (odometer.speed + speed) * dt * (1.0 + odometer.slip)
    odometer.speed = speed


@compiled
def measures(plant: Plant) -> bool:
    """Return whether the pulses are read at the end of this epoch."""
    return plant.odometer.fitted and plant.epoch % plant.odometer.interval_epochs == 0


@compiled
def measure(plant: Plant, message: MessageSignals) -> None:
    """Read the pulses at the end of this epoch; keep the payload until it is due."""
    odometer = plant.odometer
    interval_s = odometer.interval_epochs * plant.period_ns * 1e-9
    rolled = odometer.rolled
    if odometer.noise > 0.0:
        noise = odometer.noise * interval_s * normal(odometer, 0)
        if abs(rolled) > STANDING_MPS * interval_s:
            rolled += noise
    odometer.rolled = 0.0
    odometer.counted += rolled / odometer.metres_per_pulse
    pulses = np.int64(math.floor(odometer.counted))
    latency_us = odometer.latency_epochs * plant.period_ns // 1000
    word = pack(np.uint64(0), message.valid, not odometer.missed)
    odometer.missed = False
    word = pack(word, message.age_us, latency_us)
    odometer.word[0] = pack(word, message.pulses, pulses)
    odometer.epoch = plant.epoch
    odometer.waiting = True


@compiled
def is_due(plant: Plant) -> bool:
    """Return whether the count that was read last is sent in this epoch."""
    odometer = plant.odometer
    return odometer.waiting and plant.epoch == odometer.epoch + odometer.latency_epochs
