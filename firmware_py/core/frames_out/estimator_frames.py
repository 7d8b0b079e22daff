"""Frames of the estimator: how well it knows the navigation, its sources, its sensors in turn."""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import encode, pack
from rrins.dbc.contract import Contract
from rrins.dbc.e2e import fill
from rrins.dbc.frame import FrameArray
from rrins.firmware_py.core.records.estimator_records import (
    AIDS,
    ESTIMATOR_HISTORY_S,
    PITCH,
    SCALE,
    SENSOR_CONSTANTS,
    YAW,
    EstimatorSecond,
)
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.sensors.calibration import DPH, PPM, UG

_FRAMES = 7


@compiled
def is_known(state: Ram) -> bool:
    """Return whether the filter has ended a second of its own not long ago."""
    estimator = state.estimator
    last = estimator.history[(estimator.history_count - 1) % ESTIMATOR_HISTORY_S]
    is_recent = last.epoch > state.epoch - 2 * estimator.second_epochs
    return bool(estimator.running and estimator.history_count > 0 and is_recent)


@compiled
def send(state: Ram, contract: Contract, outbox: FrameArray, count: int) -> int:
    """Append the frames of the estimator; return the new number of frames.

    Source, gyro, accelerometer and constant are another one each time.
    """
    estimator = state.estimator
    last = estimator.history[(estimator.history_count - 1) % ESTIMATOR_HISTORY_S]
    counter = estimator.transmissions

    attitude = contract.estimator_attitude
    arcsec = math.degrees(1.0) * 3600.0
    word = encode(np.uint64(0), attitude.east_sigma, last.attitude_sigma[0] * arcsec)
    word = encode(word, attitude.north_sigma, last.attitude_sigma[1] * arcsec)
    word = encode(word, attitude.up_sigma, last.attitude_sigma[2] * arcsec)
    fill(outbox[count], attitude.message, word, counter)

    velocity = contract.estimator_velocity
    word = encode(np.uint64(0), velocity.east_sigma, last.velocity_sigma[0])
    word = encode(word, velocity.north_sigma, last.velocity_sigma[1])
    word = encode(word, velocity.up_sigma, last.velocity_sigma[2])
    fill(outbox[count + 1], velocity.message, word, counter)

    position = contract.estimator_position
    word = encode(np.uint64(0), position.east_sigma, last.position_sigma[0])
    word = encode(word, position.north_sigma, last.position_sigma[1])
    word = encode(word, position.up_sigma, last.position_sigma[2])
    fill(outbox[count + 2], position.message, word, counter)

    used, rejected = 0, 0
    for aid in range(AIDS):
        used += last.used[aid]
        rejected += last.rejected[aid]
    status = contract.estimator_status
    word = pack(np.uint64(0), status.aided_by, last.aided_by)
    word = pack(word, status.rejecting, last.rejecting)
    word = pack(word, status.used, min(used, status.used.raw_maximum))
    word = pack(word, status.rejected, min(rejected, status.rejected.raw_maximum))
    fill(outbox[count + 3], status.message, word, counter)

    source, aid = contract.estimator_source, counter % AIDS
    word = pack(np.uint64(0), source.source, aid)
    word = pack(word, source.used, min(last.used[aid], source.used.raw_maximum))
    word = pack(word, source.rejected, min(last.rejected[aid], source.rejected.raw_maximum))
    word = encode(word, source.nis, last.squares[aid] / max(1, last.used[aid]))
    fill(outbox[count + 4], source.message, word, counter)

    gyro, k = contract.estimator_gyro, counter % state.gyros.count
    word = pack(np.uint64(0), gyro.sensor, k + 1)
    word = encode(word, gyro.bias, last.bias[0, k] / DPH)
    word = encode(word, gyro.bias_sigma, last.bias_sigma[0, k] / DPH)
    fill(outbox[count + 5], gyro.message, word, counter)

    accelerometer, k = contract.estimator_accelerometer, counter % state.accelerometers.count
    word = pack(np.uint64(0), accelerometer.sensor, k + 1)
    word = encode(word, accelerometer.bias, last.bias[1, k] / UG)
    word = encode(word, accelerometer.bias_sigma, last.bias_sigma[1, k] / UG)
    fill(outbox[count + 6], accelerometer.message, word, counter)

    estimator.transmissions += 1
    return _send_optional(state, last, contract, outbox, count + _FRAMES, counter)


@compiled
def _send_optional(
    state: Ram,
    last: EstimatorSecond,
    contract: Contract,
    outbox: FrameArray,
    count: int,
    counter: int,
) -> int:
    """Append what is estimated of the odometer, the altimeter and a sensor's constants, if any."""
    if state.odometer.interval_epochs > 0:
        scale, mounting = contract.estimator_odometer, contract.estimator_mounting
        word = encode(np.uint64(0), scale.scale_error, last.odometer[SCALE] / PPM)
        word = encode(word, scale.scale_sigma, last.odometer_sigma[SCALE] / PPM)
        fill(outbox[count], scale.message, word, counter)
        word = encode(np.uint64(0), mounting.yaw, math.degrees(last.odometer[YAW]))
        word = encode(word, mounting.pitch, math.degrees(last.odometer[PITCH]))
        word = encode(word, mounting.yaw_sigma, math.degrees(last.odometer_sigma[YAW]))
        word = encode(word, mounting.pitch_sigma, math.degrees(last.odometer_sigma[PITCH]))
        fill(outbox[count + 1], mounting.message, word, counter)
        count += 2
    if state.estimator.altimeter:
        altimeter = contract.estimator_altimeter
        word = encode(np.uint64(0), altimeter.bias, last.altimeter_bias)
        word = encode(word, altimeter.bias_sigma, last.altimeter_bias_sigma)
        fill(outbox[count], altimeter.message, word, counter)
        count += 1
    if state.estimator.constants:
        constant, gyros = contract.estimator_constant, int(state.gyros.count)
        sensors = gyros + int(state.accelerometers.count)
        error, k = counter // sensors % SENSOR_CONSTANTS, counter % sensors
        kind = 0 if k < gyros else 1
        k -= kind * gyros
        row = SENSOR_CONSTANTS * kind + error
        word = pack(np.uint64(0), constant.error, error)
        word = pack(word, constant.kind, kind)
        word = pack(word, constant.sensor, k + 1)
        word = encode(word, constant.value, last.constant[row, k] / PPM)
        word = encode(word, constant.sigma, last.constant_sigma[row, k] / PPM)
        fill(outbox[count], constant.message, word, counter)
        count += 1
    return count
