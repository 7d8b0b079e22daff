"""Makes the frames that the hardware would have sent, of what a recording measured."""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats, Integers, Records
from rrins.dbc.codec import encode, pack
from rrins.dbc.contract import Contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import FrameArray
from rrins.dbc.values import AxisState

MOST_FRAMES = 28
"""Of an epoch: SYNC, a request, 16 sensors, five of a fix, two axes, and some room."""

NOTHING = -1
"""Where an epoch has no fix, or no request."""

_FIX_3D = 3
_ABSENT_GYRO, _ABSENT_ACCELEROMETER = 4, 8
_HOLDING = int(AxisState.HOLDING)


@compiled
def _fix(contract: Contract, fix: Floats, epoch: int, outbox: FrameArray, count: int) -> int:
    """Append a fix: time (µs), latitude, longitude (°), height (m), velocity (m/s), σ (m, m/s)."""
    time = contract.gnss_time
    word = pack(np.uint64(0), time.time_us, np.int64(fix[0]))
    word = pack(word, time.quality, _FIX_3D)
    word = encode(word, time.position_sigma, fix[7])
    fill(outbox[count], time.message, encode(word, time.velocity_sigma, fix[8]), epoch)
    latitude, longitude = contract.gnss_latitude, contract.gnss_longitude
    word = encode(np.uint64(0), latitude.latitude_deg, fix[1])
    fill(outbox[count + 1], latitude.message, word, epoch)
    word = encode(np.uint64(0), longitude.longitude_deg, fix[2])
    fill(outbox[count + 2], longitude.message, word, epoch)
    vertical, level = contract.gnss_height, contract.gnss_velocity
    word = encode(np.uint64(0), vertical.height, fix[3])
    word = encode(word, vertical.velocity_up, fix[6])
    fill(outbox[count + 3], vertical.message, word, epoch)
    word = encode(np.uint64(0), level.velocity_east, fix[4])
    word = encode(word, level.velocity_north, fix[5])
    fill(outbox[count + 4], level.message, word, epoch)
    return count + 5


@compiled
def _group(contract: Contract, gyros: Integers, accelerometers: Integers, group: int) -> np.uint64:
    sensor = contract.sensor[group]
    word, status = np.uint64(0), 0
    if group < len(gyros):
        word = pack(word, sensor.gyro_dtheta, gyros[group])
    else:
        status += _ABSENT_GYRO
    if group < len(accelerometers):
        word = pack(word, sensor.accelerometer_dv, accelerometers[group])
    else:
        status += _ABSENT_ACCELEROMETER
    return pack(word, sensor.status, status)


@compiled
def write_epochs(
    contracts: Records[Contract],
    first: int,
    period_ns: int,
    gyros: Integers,
    accelerometers: Integers,
    requests: Integers,
    fix_of: Integers,
    fixes: Floats,
    outbox: FrameArray,
    epoch_of: Integers,
) -> int:
    """Write the frames of some epochs.

    Parameters
    ----------
    contracts : Records[Contract]
        One record.
    first : int
        The first epoch.
    period_ns : int
    gyros, accelerometers : array of int, shape (epochs, sensors)
        Counts.
    requests : array of int, shape (epochs, 2)
        What the operator asks for, a value of `mode_request`, and the frame's counter; or
        `NOTHING` where no request is sent.
    fix_of : array of int, shape (epochs,)
        Row of `fixes` that is sent in the epoch, or `NOTHING`.
    fixes : array, shape (n, 9)
        As `_fix` takes them.
    outbox : FrameArray
        `MOST_FRAMES` for each epoch.
    epoch_of : array of int
        As long; filled with the epoch of each frame.

    Returns
    -------
    int
        Frames written.
    """
    contract, count = contracts[0], 0
    sync, command = contract.sync, contract.mode_command
    inner, outer = contract.axis_inner_status, contract.axis_outer_status
    groups = max(gyros.shape[1], accelerometers.shape[1])
    for k in range(gyros.shape[0]):
        epoch, begun = first + k, count
        word = pack(np.uint64(0), sync.epoch, epoch)
        word = pack(word, sync.time_us, epoch * period_ns // 1000)
        fill(outbox[count], sync.message, word, epoch)
        count += 1
        if requests[k, 0] != NOTHING:
            word = pack(np.uint64(0), command.mode_request, requests[k, 0])
            fill(outbox[count], command.message, word, requests[k, 1])
            count += 1
        for group in range(groups):
            word = _group(contract, gyros[k], accelerometers[k], group)
            fill(outbox[count], contract.sensor[group].message, word, epoch)
            count += 1
        if fix_of[k] != NOTHING:
            count = _fix(contract, fixes[fix_of[k]], epoch, outbox, count)
        fill(outbox[count], inner.message, pack(np.uint64(0), inner.state, _HOLDING), epoch)
        fill(outbox[count + 1], outer.message, pack(np.uint64(0), outer.state, _HOLDING), epoch)
        count += 2
        epoch_of[begun:count] = epoch
    return count
