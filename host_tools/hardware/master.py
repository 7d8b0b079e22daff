"""The emulated master unit: attitude, velocity and position from which the firmware may start.

It navigates in the same vehicle, with errors that stay as they are; both have the same reference
point and axes. What holds at the end of an epoch is sent, as a group of eight frames, some epochs
later: it carries its time of validity on SYNC's clock, and the standard deviations of the errors.
During an outage the groups go on, and say that nothing is valid.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import encode, encode_wrapped, pack, unwrapped
from rrins.dbc.contract import Contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import FrameArray
from rrins.host_tools.hardware import earth
from rrins.host_tools.hardware.memory import MasterState, Plant

_TIME, _LEVEL, _HEADING, _LATITUDE, _LONGITUDE, _HEIGHT, _VELOCITY, _SIGMA = range(8)


@compiled
def measures(plant: Plant) -> bool:
    """Return whether it prepares a transfer in this epoch, of which the truth is needed then."""
    return plant.master.present and plant.epoch % plant.master.interval_epochs == 0


@compiled
def _navigates(master: MasterState, epoch: int) -> bool:
    for k in range(master.outage_count):
        if master.outage_first[k] <= epoch <= master.outage_last[k]:
            return False
    return True


@compiled
def measure(plant: Plant, contract: Contract) -> None:
    """Prepare a transfer that is valid at the end of this epoch; keep it until it is due."""
    master, word = plant.master, plant.master.word
    master.waiting = True
    master.epoch = plant.epoch
    for part in range(len(word)):
        word[part] = np.uint64(0)
    time = contract.master_time
    time_us = plant.epoch * plant.period_ns // 1000
    word[_TIME] = pack(np.uint64(0), time.time_us, time_us)
    if not _navigates(master, plant.epoch):
        return
    word[_TIME] = pack(word[_TIME], time.valid, 1)
    word[_TIME] = encode(word[_TIME], time.level_sigma, master.level_sigma_arcsec)
    _write_attitude(plant, contract)
    _write_position(plant, contract)
    truth, off, along = plant.truth.velocity_n, master.velocity_error, contract.master_velocity
    level = encode(np.uint64(0), along.velocity_east, truth[0] + off[0])
    word[_VELOCITY] = encode(level, along.velocity_north, truth[1] + off[1])
    up = contract.master_height.velocity_up
    word[_HEIGHT] = encode(word[_HEIGHT], up, truth[2] + off[2])
    sigma = contract.master_sigma
    word[_SIGMA] = encode(np.uint64(0), sigma.velocity_sigma, master.velocity_sigma)
    word[_SIGMA] = encode(word[_SIGMA], sigma.position_sigma, master.position_sigma)


@compiled
def _write_attitude(plant: Plant, contract: Contract) -> None:
    master, truth = plant.master, plant.truth
    roll = truth.roll + master.attitude_error[0]
    pitch = truth.pitch + master.attitude_error[1]
    heading = truth.heading + master.attitude_error[2]
    if abs(pitch) > 0.5 * math.pi:  # over the top
        pitch = math.copysign(math.pi, pitch) - pitch
        roll, heading = roll + math.pi, heading + math.pi
    level, direction = contract.master_level, contract.master_heading
    word = encode_wrapped(np.uint64(0), level.master_roll_deg, math.degrees(roll))
    master.word[_LEVEL] = encode(word, level.master_pitch_deg, math.degrees(pitch))
    word = encode_wrapped(np.uint64(0), direction.master_heading_deg, math.degrees(heading))
    master.word[_HEADING] = encode(word, direction.heading_sigma, master.heading_sigma_arcsec)


@compiled
def _write_position(plant: Plant, contract: Contract) -> None:
    master, truth, off = plant.master, plant.truth, plant.master.position_error
    latitude, longitude = contract.master_latitude, contract.master_longitude
    north_m, east_m = earth.metres_per_rad(truth.latitude, truth.height)
    latitude_deg = math.degrees(truth.latitude + off[1] / north_m)
    longitude_deg = math.degrees(truth.longitude + off[0] / east_m)
    longitude_deg = unwrapped(longitude_deg, 0.0, 360.0)
    master.word[_LATITUDE] = encode(np.uint64(0), latitude.latitude_deg, latitude_deg)
    master.word[_LONGITUDE] = encode(np.uint64(0), longitude.longitude_deg, longitude_deg)
    height = contract.master_height.height
    master.word[_HEIGHT] = encode(np.uint64(0), height, truth.height + off[2])


@compiled
def is_due(plant: Plant) -> bool:
    """Return whether the last transfer is sent in this epoch."""
    master = plant.master
    return master.waiting and plant.epoch == master.epoch + master.latency_epochs


@compiled
def send(plant: Plant, contract: Contract, outbox: FrameArray, count: int) -> int:
    """Append the eight frames of the last transfer; return the new number of frames."""
    word, epoch = plant.master.word, plant.epoch
    fill(outbox[count], contract.master_time.message, word[_TIME], epoch)
    fill(outbox[count + 1], contract.master_level.message, word[_LEVEL], epoch)
    fill(outbox[count + 2], contract.master_heading.message, word[_HEADING], epoch)
    fill(outbox[count + 3], contract.master_latitude.message, word[_LATITUDE], epoch)
    fill(outbox[count + 4], contract.master_longitude.message, word[_LONGITUDE], epoch)
    fill(outbox[count + 5], contract.master_height.message, word[_HEIGHT], epoch)
    fill(outbox[count + 6], contract.master_velocity.message, word[_VELOCITY], epoch)
    fill(outbox[count + 7], contract.master_sigma.message, word[_SIGMA], epoch)
    return count + 8
