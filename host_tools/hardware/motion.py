"""The vehicle's motion as the hardware reads it: pieces of polynomials in time.

A piece lasts a whole number of epochs and has, for each of fifteen channels, the coefficients of
a polynomial of degree seven in u, the time from 0 at its beginning to 1 at its end, lowest first:
ω_ib^b (rad/s) and f^b (m/s²), three each; latitude and longitude (rad), height (m); velocity_n
(m/s), three; roll, pitch and heading (rad). `rrins.host_tools.motion` makes them so that all agree.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.host_tools.hardware.memory import MOTION_TERMS, Plant

RATE, FORCE, POSITION, VELOCITY, ATTITUDE = 0, 3, 6, 9, 12
"""First channel of each triple."""


@compiled
def value(piece: Floats, channel: int, u: float) -> float:
    """Return a channel of a piece, shape (15, 8), at `u` in [0, 1]."""
    total = piece[channel, MOTION_TERMS - 1]
    for k in range(MOTION_TERMS - 2, -1, -1):
        total = total * u + piece[channel, k]
    return total


@compiled
def piece_of(plant: Plant, epoch: int) -> int:
    """Return the piece of an epoch; -1 at rest."""
    since, pieces = epoch - plant.motion_start - 1, plant.piece_count
    if since < 0 or pieces == 0:
        return -1
    piece = since // plant.piece_epochs
    if piece < pieces:
        return piece
    if plant.loop_from < 0:
        return -1
    return plant.loop_from + (piece - plant.loop_from) % (pieces - plant.loop_from)


@compiled
def begin_of(plant: Plant, epoch: int) -> float:
    """Return the start of an epoch within its piece, as u."""
    return (epoch - plant.motion_start - 1) % plant.piece_epochs / plant.piece_epochs


@compiled
def _set_pose(plant: Plant, piece: Floats, u: float) -> None:
    truth = plant.truth
    truth.latitude = value(piece, POSITION, u)
    longitude = value(piece, POSITION + 1, u)
    truth.longitude = longitude - 2.0 * math.pi * math.floor(longitude / (2.0 * math.pi) + 0.5)
    truth.height = value(piece, POSITION + 2, u)
    for i in range(3):
        truth.velocity_n[i] = value(piece, VELOCITY + i, u)
    truth.roll = value(piece, ATTITUDE, u)
    truth.pitch = value(piece, ATTITUDE + 1, u)
    heading = value(piece, ATTITUDE + 2, u)
    truth.heading = heading - 2.0 * math.pi * math.floor(heading / (2.0 * math.pi))


@compiled
def set_rest(plant: Plant, piece: Floats, u: float) -> None:
    """Set the vehicle at rest, with its pose at `u` of a piece."""
    for i in range(3):
        plant.omega_ib_b[i] = value(piece, RATE + i, u)
        plant.specific_force_b[i] = value(piece, FORCE + i, u)
    _set_pose(plant, piece, u)


@compiled
def note(plant: Plant, pieces: Floats) -> None:
    """Write the vehicle's state at the end of the plant's epoch to the truth."""
    index = piece_of(plant, plant.epoch)
    if index >= 0:
        end = begin_of(plant, plant.epoch) + 1.0 / plant.piece_epochs
        _set_pose(plant, pieces[index], end)
    elif plant.piece_count and plant.epoch > plant.motion_start:
        _set_pose(plant, pieces[plant.piece_count - 1], 1.0)
