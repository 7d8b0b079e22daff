"""GNSS fixes: five frames of one epoch make one fix, valid at an epoch before.

A group counts if all of its frames are intact and of this epoch, and none of them comes twice with
different contents. Its time of validity is on SYNC's clock, so it maps to an epoch of the firmware.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import decode, span_of, unpack
from rrins.dbc.contract import Contract
from rrins.dbc.frame import Frame
from rrins.firmware_py.core.frames_in import frame_checks, frame_groups
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.troubles import Source

FRAMES = 5
"""Of a group: time and quality, latitude, longitude, height, velocity."""

_TIME, _LATITUDE, _LONGITUDE, _HEIGHT, _VELOCITY = range(FRAMES)
_WHOLE = (1 << FRAMES) - 1
_FROM_GNSS = int(Source.GNSS)

OLDEST_US = 2_000_000
"""Age beyond which a fix is not used: the latency of a receiver is a fraction of a second."""

LOST_INTERVALS = 3
"""Intervals without a fix after which the receiver's fixes count as lost."""


@compiled
def receive(state: Ram, contract: Contract, frame: Frame, part: int) -> None:
    """Process a frame of a group."""
    message = contract.gnss_time.message
    if part == _LATITUDE:
        message = contract.gnss_latitude.message
    elif part == _LONGITUDE:
        message = contract.gnss_longitude.message
    elif part == _HEIGHT:
        message = contract.gnss_height.message
    elif part == _VELOCITY:
        message = contract.gnss_velocity.message
    found = frame_groups.receive(state.gnss, frame, message, part, state.epoch)
    if found == frame_groups.WRONG_CRC:
        frame_checks.crc_error(state, _FROM_GNSS)
    elif found == frame_groups.WRONG_COUNTER:
        frame_checks.counter_error(state, _FROM_GNSS)


@compiled
def close(state: Ram, contract: Contract) -> None:
    """Close the epoch: take the fix of a whole group, note whether the receiver has one."""
    gnss = state.gnss
    gnss.fresh = False
    if gnss.interval_epochs == 0:
        return
    gnss.silent_epochs += 1
    gnss.age_epochs += 1
    if gnss.arrived == _WHOLE and not gnss.refused:
        gnss.silent_epochs = 0
        _take(state, contract)
    gnss.lost = gnss.age_epochs > LOST_INTERVALS * gnss.interval_epochs
    if gnss.available and gnss.lost:
        gnss.available = False
        gnss.losses += 1


@compiled
def _take(state: Ram, contract: Contract) -> None:
    """Take a group's values if it has a fix that is not too old."""
    gnss, period_ns = state.gnss, state.parameters.period_ns
    time, word = contract.gnss_time, gnss.word
    gnss.quality = unpack(word[_TIME], time.quality)
    if gnss.quality == 0:
        return
    now_us = state.epoch * period_ns // 1000
    age_us = (now_us - unpack(word[_TIME], time.time_us)) % int(span_of(time.time_us))
    if age_us > OLDEST_US:
        gnss.too_old += 1
        return
    age_epochs = (age_us * 1000 + period_ns // 2) // period_ns
    gnss.fresh = True
    gnss.available = True
    gnss.fixes += 1
    gnss.age_epochs = age_epochs
    gnss.epoch = state.epoch - age_epochs
    gnss.position_sigma = decode(word[_TIME], time.position_sigma)
    gnss.velocity_sigma = decode(word[_TIME], time.velocity_sigma)
    latitude, longitude = contract.gnss_latitude, contract.gnss_longitude
    gnss.latitude = math.radians(decode(word[_LATITUDE], latitude.latitude_deg))
    gnss.longitude = math.radians(decode(word[_LONGITUDE], longitude.longitude_deg))
    vertical, level = contract.gnss_height, contract.gnss_velocity
    gnss.height = decode(word[_HEIGHT], vertical.height)
    gnss.velocity_n[0] = decode(word[_VELOCITY], level.velocity_east)
    gnss.velocity_n[1] = decode(word[_VELOCITY], level.velocity_north)
    gnss.velocity_n[2] = decode(word[_HEIGHT], vertical.velocity_up)
