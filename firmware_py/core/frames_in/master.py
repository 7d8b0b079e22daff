"""Transfers of the master unit: eight frames of one epoch make one, valid at a time before.

A group counts if all of its frames are intact and of this epoch, and none of them comes twice with
different contents. Its time of validity is on SYNC's clock; it need not be the end of an epoch.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import decode, span_of, unpack
from rrins.dbc.contract import Contract
from rrins.dbc.e2e import MessageLayout
from rrins.dbc.frame import Frame
from rrins.firmware_py.core.frames_in import frame_groups
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.transfer_records import MASTER_FRAMES

MESSAGES = ("time", "level", "heading", "latitude", "longitude", "height", "velocity", "sigma")
"""Parts of a group: the ends of the names of its messages."""

_TIME, _LEVEL, _HEADING, _LATITUDE, _LONGITUDE, _HEIGHT, _VELOCITY, _SIGMA = range(MASTER_FRAMES)
_WHOLE = (1 << MASTER_FRAMES) - 1
_TRANSFERRED = int(InitialAttitude.TRANSFERRED)
_ARCSEC = math.radians(1) / 3600

OLDEST_US = 2_000_000
"""Age beyond which a transfer is not used: the latency of a bus is a fraction of a second."""


@compiled
def _layout(contract: Contract, part: int) -> MessageLayout:
    """Return the layout of a part's message."""
    message = contract.master_time.message
    if part == _LEVEL:
        message = contract.master_level.message
    elif part == _HEADING:
        message = contract.master_heading.message
    elif part == _LATITUDE:
        message = contract.master_latitude.message
    elif part == _LONGITUDE:
        message = contract.master_longitude.message
    elif part == _HEIGHT:
        message = contract.master_height.message
    elif part == _VELOCITY:
        message = contract.master_velocity.message
    elif part == _SIGMA:
        message = contract.master_sigma.message
    return message


@compiled
def receive(state: Ram, contract: Contract, frame: Frame, part: int) -> None:
    """Process a frame of a group."""
    message = _layout(contract, part)
    found = frame_groups.receive(state.master, frame, message, part, state.epoch)
    state.faults.crc_errors += found == frame_groups.WRONG_CRC
    state.faults.counter_errors += found == frame_groups.WRONG_COUNTER


@compiled
def close(state: Ram, contract: Contract) -> None:
    """Close the epoch: take the transfer of a whole group, if the start is by transfer."""
    if state.parameters.initial_attitude != _TRANSFERRED:
        return
    master = state.master
    master.silent_epochs += 1
    master.age_epochs += 1
    if master.arrived == _WHOLE and not master.refused:
        master.silent_epochs = 0
        _take(state, contract)


@compiled
def _take(state: Ram, contract: Contract) -> None:
    """Take a group's values if they are valid and not too old."""
    master, period_ns = state.master, state.parameters.period_ns
    time, word = contract.master_time, master.word
    master.valid = unpack(word[_TIME], time.valid) != 0
    if not master.valid:
        return
    now_us = state.epoch * period_ns // 1000
    age_us = (now_us - unpack(word[_TIME], time.time_us)) % int(span_of(time.time_us))
    if age_us > OLDEST_US:
        master.too_old += 1
        return
    master.transfers += 1
    master.age_epochs = age_us * 1000 // period_ns
    master.epoch = state.epoch - master.age_epochs
    master.before_end_ns = age_us * 1000 - master.age_epochs * period_ns
    level, heading, sigma = contract.master_level, contract.master_heading, contract.master_sigma
    master.level_sigma = decode(word[_TIME], time.level_sigma) * _ARCSEC
    master.heading_sigma = decode(word[_HEADING], heading.heading_sigma) * _ARCSEC
    master.velocity_sigma = decode(word[_SIGMA], sigma.velocity_sigma)
    master.position_sigma = decode(word[_SIGMA], sigma.position_sigma)
    master.roll = math.radians(decode(word[_LEVEL], level.master_roll_deg))
    master.pitch = math.radians(decode(word[_LEVEL], level.master_pitch_deg))
    master.heading = math.radians(decode(word[_HEADING], heading.master_heading_deg))
    latitude, longitude = contract.master_latitude, contract.master_longitude
    master.latitude = math.radians(decode(word[_LATITUDE], latitude.latitude_deg))
    master.longitude = math.radians(decode(word[_LONGITUDE], longitude.longitude_deg))
    vertical, along = contract.master_height, contract.master_velocity
    master.height = decode(word[_HEIGHT], vertical.height)
    master.velocity_n[0] = decode(word[_VELOCITY], along.velocity_east)
    master.velocity_n[1] = decode(word[_VELOCITY], along.velocity_north)
    master.velocity_n[2] = decode(word[_HEIGHT], vertical.velocity_up)
