"""One epoch of the hardware: axis commands in, the frames of sensors and encoders out.

``commands -> turntable -> true increments -> sensors -> counts -> frames``. No clock, socket,
thread, file or allocation; all state is the `PLANT` record.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dbc.codec import decode, encode, encode_wrapped, pack, span_of, unpack, unwrapped
from dbc.e2e import COUNTER_MODULUS, counter_of, crc_holds, fill
from dbc.frame import FrameArray
from host_tools.hardware import sensors, truth, turntable
from host_tools.hardware.memory import INNER, OUTER

OUTBOX_CAPACITY = 32
"""Frames that one step sends at most, with room to spare."""

COMMAND_DELAY = 2
"""Epochs from the one a command belongs to until it takes effect: both loops may be late by almost
a period, and a run in real time is still the same as one in lockstep."""

_NS_PER_MS = 1_000_000


@njit(cache=True)
def _take_command(plant: Any, message: Any, axis: Any, frame: Any) -> None:
    """Keep an axis command if it is sound and its epoch's commands have not taken effect yet."""
    if not crc_holds(frame, message.message):
        plant.counters.crc_errors += 1
        return
    age = (plant.epoch - counter_of(frame["data"])) % COUNTER_MODULUS
    slot = axis.waiting[(plant.epoch - age) % 2]
    if not 1 <= age <= COMMAND_DELAY or slot.valid:
        plant.counters.counter_errors += 1
        return
    slot.valid = True
    slot.command = unpack(frame["data"], message.command)
    target_deg = unwrapped(
        decode(frame["data"], message.target_angle_deg),
        math.degrees(axis.angle),
        span_of(message.target_angle_deg),
    )
    slot.target = math.radians(target_deg)
    slot.rate = math.radians(decode(frame["data"], message.rate_limit_dps))


@njit(cache=True)
def _apply_command(plant: Any, axis: Any) -> None:
    """Let the command whose time has come take effect; without one, the last one holds."""
    slot = axis.waiting[plant.epoch % 2]
    if slot.valid:
        slot.valid = False
        turntable.command(axis, slot.command, slot.target, slot.rate)
    elif plant.epoch >= COMMAND_DELAY:
        plant.counters.missing_commands += 1


@njit(cache=True)
def _take(plant: Any, contract: Any, inbox: Any, count: int) -> None:
    for k in range(count):
        frame = inbox[k]
        if frame.can_id == contract.axis_inner_command.message.can_id:
            _take_command(plant, contract.axis_inner_command, plant.axis[INNER], frame)
        elif frame.can_id == contract.axis_outer_command.message.can_id:
            _take_command(plant, contract.axis_outer_command, plant.axis[OUTER], frame)
    for axis in (INNER, OUTER):
        _apply_command(plant, plant.axis[axis])


@njit(cache=True)
def _send_sync(plant: Any, contract: Any, frame: Any) -> None:
    sync = contract.sync
    time_us = plant.epoch * plant.period_ns // 1000
    word = pack(np.uint64(0), sync.epoch, plant.epoch)
    fill(frame, sync.message, pack(word, sync.time_us, time_us), plant.epoch)


@njit(cache=True)
def _send_group(plant: Any, contract: Any, group: int, frame: Any) -> None:
    sensor = contract.sensor[group]
    gyros, accelerometers = plant.gyros, plant.accelerometers
    status = 0
    word = np.uint64(0)
    if group < gyros.count:
        word = pack(word, sensor.gyro_dtheta, gyros.counts[group])
        status |= gyros.saturated >> group & 1
    else:
        status |= 4
    if group < accelerometers.count:
        word = pack(word, sensor.accelerometer_dv, accelerometers.counts[group])
        status |= (accelerometers.saturated >> group & 1) << 1
    else:
        status |= 8
    fill(frame, sensor.message, pack(word, sensor.status, status), plant.epoch)


@njit(cache=True)
def _send_axis(axis: Any, message: Any, epoch: int, frame: Any) -> None:
    word = pack(np.uint64(0), message.state, axis.state)
    word = encode_wrapped(word, message.encoder_angle_deg, turntable.encoder_angle_deg(axis))
    word = encode(word, message.encoder_rate_dps, math.degrees(axis.rate))
    fill(frame, message.message, word, epoch)


@njit(cache=True)
def _operate(plant: Any, contract: Any, frame: Any) -> int:
    """Send the operator's request when it changes and at its cycle time; return frames sent."""
    operator = plant.operator
    changed = False
    while operator.next < operator.count and operator.epoch[operator.next] <= plant.epoch:
        operator.present = operator.request[operator.next]
        operator.next += 1
        changed = True
    message = contract.mode_command
    every = max(1, message.message.cycle_ms * _NS_PER_MS // plant.period_ns)
    if not changed and plant.epoch % every != 0:
        return 0
    word = pack(np.uint64(0), message.mode_request, operator.present)
    fill(frame, message.message, word, operator.transmissions)
    operator.transmissions += 1
    return 1


@njit(cache=True)
def _send(plant: Any, contract: Any, outbox: Any) -> int:
    """Put the epoch's frames; the status of the outer axis is always the last."""
    _send_sync(plant, contract, outbox[0])
    count = 1
    count += _operate(plant, contract, outbox[count])
    for group in range(max(plant.gyros.count, plant.accelerometers.count)):
        _send_group(plant, contract, group, outbox[count])
        count += 1
    heartbeat = contract.heartbeat_hardware
    if plant.epoch * plant.period_ns % (heartbeat.message.cycle_ms * _NS_PER_MS) == 0:
        uptime = plant.epoch * plant.period_ns * 1e-9
        word = encode(np.uint64(0), heartbeat.uptime, uptime)
        fill(outbox[count], heartbeat.message, word, plant.heartbeats)
        plant.heartbeats += 1
        count += 1
    _send_axis(plant.axis[INNER], contract.axis_inner_status, plant.epoch, outbox[count])
    _send_axis(plant.axis[OUTER], contract.axis_outer_status, plant.epoch, outbox[count + 1])
    return count + 2


@njit(cache=True)
def hardware_step(
    plants: NDArray[Any], contract: NDArray[Any], inbox: FrameArray, count: int, outbox: FrameArray
) -> int:
    """Run the hardware over one epoch.

    Parameters
    ----------
    plants : array of one record of dtype `host_tools.hardware.memory.PLANT`
        Changed in place.
    contract : array of one record, from `dbc.contract.load_contract`
    inbox : array of dtype `dbc.frame.FRAME`
        Frames received since the step before; the first `count` are read.
    outbox : array of dtype `dbc.frame.FRAME`, at least `OUTBOX_CAPACITY` long

    Returns
    -------
    int
        Frames written to `outbox`: SYNC first, the outer axis' status last.
    """
    plant = plants[0]
    record = contract[0]
    dt = plant.period_ns * 1e-9
    _take(plant, record, inbox, count)
    turntable.advance(plant.axis[INNER], dt)
    turntable.advance(plant.axis[OUTER], dt)
    truth.integrate(plant, dt)
    layout = record.sensor[0]
    sensors.measure(
        plant.gyros, plant.dtheta_s, layout.gyro_dtheta.scale, layout.gyro_dtheta.raw_maximum
    )
    sensors.measure(
        plant.accelerometers,
        plant.dv_s,
        layout.accelerometer_dv.scale,
        layout.accelerometer_dv.raw_maximum,
    )
    sent = _send(plant, record, outbox)
    plant.truth.epoch = plant.epoch
    plant.truth.axis_angle[INNER] = plant.axis[INNER].angle
    plant.truth.axis_angle[OUTER] = plant.axis[OUTER].angle
    plant.epoch += 1
    return sent
