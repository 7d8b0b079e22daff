"""One epoch of the hardware: axis commands in, the frames of sensors and encoders out.

``commands -> turntable -> true increments -> sensors -> counts -> frames``. No clock, socket,
thread, file or allocation; all state is the `Plant` record, and the vehicle's motion is only read.
"""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats, Records
from rrins.dbc.codec import decode, encode, encode_wrapped, pack, span_of, unpack, unwrapped
from rrins.dbc.contract import Contract, MessageSignals
from rrins.dbc.e2e import COUNTER_MODULUS, MessageLayout, counter_of, crc_holds, fill
from rrins.dbc.frame import Frame, FrameArray
from rrins.host_tools.hardware import (
    faults,
    gnss,
    master,
    motion,
    odometer,
    sensors,
    standing,
    truth,
    turntable,
)
from rrins.host_tools.hardware.memory import INNER, OUTER, Plant, TurntableAxis, WaitingCommand
from rrins.host_tools.hardware.noise import normal

OUTBOX_CAPACITY = 40
"""Most frames that one step sends, with room to spare."""

COMMAND_DELAY = 2
"""Epochs between a command's epoch and its effect: both loops may be late by almost a period, and
a run in real time still equals one in lockstep."""

_NS_PER_MS = 1_000_000


@compiled
def _receive_command(
    plant: Plant, message: MessageSignals, axis: TurntableAxis, frame: Frame
) -> None:
    """Store an axis command if it is valid and its epoch's commands have not taken effect yet.

    What a firmware has sent before it could know the epoch does not count.
    """
    if not crc_holds(frame, message.message):
        plant.counters.crc_errors += 1
        return
    age = (plant.epoch - counter_of(frame["data"])) % COUNTER_MODULUS
    slot = axis.waiting[(plant.epoch - age) % 2]
    if not 1 <= age <= min(COMMAND_DELAY, plant.epoch) or slot.valid:
        plant.counters.counter_errors += plant.epoch >= COMMAND_DELAY
        return
    word = frame["data"]
    what = unpack(word, message.command)
    target_deg = decode(word, message.target_angle_deg)
    keep_command(slot, axis, message, what, target_deg, decode(word, message.rate_limit_dps))


@compiled
def keep_command(
    slot: WaitingCommand,
    axis: TurntableAxis,
    message: MessageSignals,
    what: int,
    target_deg: float,
    rate_dps: float,
) -> None:
    """Store an axis command until its epoch; its target is the nearest of all it can mean."""
    slot.valid = True
    slot.command = what
    span_deg = span_of(message.target_angle_deg)
    slot.target = math.radians(unwrapped(target_deg, math.degrees(axis.angle), span_deg))
    slot.rate = math.radians(rate_dps)


@compiled
def _apply_command(plant: Plant, axis: TurntableAxis) -> None:
    """Apply the command that is due; without one, the last one remains active."""
    slot = axis.waiting[plant.epoch % 2]
    if slot.valid:
        slot.valid = False
        turntable.command(axis, slot.command, slot.target, slot.rate)
    elif plant.epoch >= COMMAND_DELAY:
        plant.counters.missing_commands += 1


@compiled
def _receive(plant: Plant, contract: Contract, inbox: FrameArray, count: int) -> None:
    for k in range(count):
        frame = inbox[k]
        if frame.can_id == contract.axis_inner_command.message.can_id:
            _receive_command(plant, contract.axis_inner_command, plant.axis[INNER], frame)
        elif frame.can_id == contract.axis_outer_command.message.can_id:
            _receive_command(plant, contract.axis_outer_command, plant.axis[OUTER], frame)


@compiled
def _send_sync(plant: Plant, contract: Contract, frame: Frame) -> None:
    sync = contract.sync
    time_us = plant.epoch * plant.period_ns // 1000
    word = pack(np.uint64(0), sync.epoch, plant.epoch)
    fill(frame, sync.message, pack(word, sync.time_us, time_us), plant.epoch)


@compiled
def group_counts(plant: Plant, group: int) -> tuple[int, int, int]:
    """Return what a sensor group says: counts of gyro and accelerometer, and its status."""
    gyros, accelerometers = plant.gyros, plant.accelerometers
    bit = 1 << group
    status = dtheta = dv = 0
    if group < gyros.count and gyros.absent & bit == 0:
        dtheta = int(gyros.counts[group])
        status |= int(gyros.saturated) >> group & 1
    else:
        status |= 4
    if group < accelerometers.count and accelerometers.absent & bit == 0:
        dv = int(accelerometers.counts[group])
        status |= (int(accelerometers.saturated) >> group & 1) << 1
    else:
        status |= 8
    return dtheta, dv, status


@compiled
def _group_word(plant: Plant, sensor: MessageSignals, group: int) -> np.uint64:
    """Return the payload of a sensor group's frame."""
    dtheta, dv, status = group_counts(plant, group)
    word = pack(np.uint64(0), sensor.gyro_dtheta, dtheta)
    word = pack(word, sensor.accelerometer_dv, dv)
    return pack(word, sensor.status, status)


@compiled
def _axis_word(axis: TurntableAxis, message: MessageSignals) -> np.uint64:
    """Return the payload of an axis' frame."""
    word = pack(np.uint64(0), message.state, axis.state)
    word = encode_wrapped(word, message.encoder_angle_deg, turntable.encoder_angle_deg(axis))
    return encode(word, message.encoder_rate_dps, math.degrees(axis.rate))


@compiled
def _altitude_epochs(plant: Plant, message: MessageLayout) -> int:
    """Return the epochs from one height to the next."""
    return max(1, message.cycle_ms * _NS_PER_MS // plant.period_ns)


@compiled
def is_altitude_due(plant: Plant, message: MessageLayout) -> bool:
    """Return whether the altimeter measures in this epoch."""
    return plant.altimeter.fitted and plant.epoch % _altitude_epochs(plant, message) == 0


@compiled
def altitude_word(plant: Plant, message: MessageSignals) -> np.uint64:
    """Measure the height; return the payload of the altimeter's frame."""
    altimeter = plant.altimeter
    height = plant.truth.height + altimeter.bias + altimeter.fault_height
    if altimeter.noise > 0.0:
        height += altimeter.noise * normal(altimeter, 0)
    if altimeter.random_walk > 0.0:
        dt = _altitude_epochs(plant, message.message) * plant.period_ns * 1e-9
        altimeter.bias += altimeter.random_walk * math.sqrt(dt) * normal(altimeter, 0)
    return encode(np.uint64(0), message.height, height)


@compiled
def update_operator(plant: Plant) -> bool:
    """Update the operator's request; return whether it is new."""
    operator = plant.operator
    changed = False
    while operator.next < operator.count and operator.epoch[operator.next] <= plant.epoch:
        operator.present = operator.request[operator.next]
        operator.next += 1
        changed = True
    return changed


@compiled
def _operate(plant: Plant, contract: Contract, frame: Frame) -> int:
    """Send the operator's request when it changes and at its cycle time; return frames sent."""
    operator = plant.operator
    changed = update_operator(plant)
    message = contract.mode_command
    every = max(1, message.message.cycle_ms * _NS_PER_MS // plant.period_ns)
    if not changed and plant.epoch % every != 0:
        return 0
    word = pack(np.uint64(0), message.mode_request, operator.present)
    fill(frame, message.message, word, operator.transmissions)
    operator.transmissions += 1
    return 1


@compiled
def readmission_word(plant: Plant, message: MessageSignals) -> np.uint64:
    """Return the payload of the operator's order to readmit a sensor; 0 where none is due."""
    orders = plant.readmissions
    k = orders.next
    word = np.uint64(0)
    if k >= orders.count or orders.epoch[k] > plant.epoch:
        return word
    orders.next += 1
    word = pack(word, message.order, 1)
    word = pack(word, message.kind, orders.kind[k])
    word = pack(word, message.sensor, orders.sensor[k])
    word = pack(word, message.anew, orders.anew[k])
    return pack(word, message.test_s, orders.test_s[k])


@compiled
def _send(plant: Plant, pieces: Floats, contract: Contract, outbox: FrameArray) -> int:
    """Write the epoch's frames; the status of the outer axis is always the last."""
    _send_sync(plant, contract, outbox[0])
    count = 1
    count += _operate(plant, contract, outbox[count])
    readmission = contract.readmission_command
    word = readmission_word(plant, readmission)
    if word != 0:
        fill(outbox[count], readmission.message, word, plant.readmissions.next)
        count += 1
    zero = contract.zero_velocity
    if standing.is_due(plant, zero):
        word = standing.word(plant, zero)
        fill(outbox[count], zero.message, word, plant.standing.transmissions)
        plant.standing.transmissions += 1
        count += 1
    for group in range(max(plant.gyros.count, plant.accelerometers.count)):
        sensor = contract.sensor[group]
        fill(outbox[count], sensor.message, _group_word(plant, sensor, group), plant.epoch)
        count += 1
    altimeter = contract.altimeter
    if is_altitude_due(plant, altimeter.message):
        fill(outbox[count], altimeter.message, altitude_word(plant, altimeter), plant.epoch)
        count += 1
    if gnss.measures(plant):
        gnss.measure(plant, pieces, contract)
    if gnss.is_due(plant):
        count = gnss.send(plant, contract, outbox, count)
    if master.measures(plant):
        master.measure(plant, contract)
    if master.is_due(plant):
        count = master.send(plant, contract, outbox, count)
    if odometer.measures(plant):
        odometer.measure(plant, contract.odometer)
    if odometer.is_due(plant):
        fill(outbox[count], contract.odometer.message, plant.odometer.word[0], plant.epoch)
        count += 1
    heartbeat = contract.heartbeat_hardware
    if plant.epoch * plant.period_ns % (heartbeat.message.cycle_ms * _NS_PER_MS) == 0:
        uptime = plant.epoch * plant.period_ns * 1e-9
        word = encode(np.uint64(0), heartbeat.uptime, uptime)
        fill(outbox[count], heartbeat.message, word, plant.heartbeats)
        plant.heartbeats += 1
        count += 1
    inner, outer = contract.axis_inner_status, contract.axis_outer_status
    fill(outbox[count], inner.message, _axis_word(plant.axis[INNER], inner), plant.epoch)
    fill(outbox[count + 1], outer.message, _axis_word(plant.axis[OUTER], outer), plant.epoch)
    return count + 2


@compiled_with(is_unit=True)
def advance(plant: Plant, pieces: Floats, contract: Contract) -> None:
    """Simulate an epoch: table, vehicle and sensors, without frames."""
    dt = plant.period_ns * 1e-9
    faults.apply(plant)
    for axis in (INNER, OUTER):
        _apply_command(plant, plant.axis[axis])
        turntable.advance(plant.axis[axis], dt)
        turntable.slip(plant.axis[axis])
    truth.integrate(plant, pieces, dt)
    if plant.odometer.fitted:
        odometer.turn(plant, pieces, dt)
    if plant.epoch % plant.drift_epochs == 0:
        drift(plant, dt)
    layout = contract.sensor[0]
    gyro, accelerometer = layout.gyro_dtheta, layout.accelerometer_dv
    sensors.measure(plant.gyros, plant.dtheta_s, plant.dv_s, gyro.scale, gyro.raw_maximum)
    sensors.measure(
        plant.accelerometers,
        plant.dv_s,
        plant.dv_s,
        accelerometer.scale,
        accelerometer.raw_maximum,
    )


@compiled
def drift(plant: Plant, dt: float) -> None:
    """Update the sensors' drifting errors."""
    thermal = plant.thermal
    warmer = thermal.ambient_offset
    if thermal.warm_up != 0.0:
        warmer += thermal.warm_up * (1.0 - math.exp(-plant.epoch * dt / thermal.time_constant))
    if plant.gyros.drifts:
        sensors.drift(plant.gyros, warmer)
    if plant.accelerometers.drifts:
        sensors.drift(plant.accelerometers, warmer)


@compiled
def note_truth(plant: Plant, pieces: Floats) -> None:
    """Record the true state of the vehicle and the table at the end of the epoch."""
    motion.note(plant, pieces)
    plant.truth.epoch = plant.epoch
    plant.truth.axis_angle[INNER] = plant.axis[INNER].angle
    plant.truth.axis_angle[OUTER] = plant.axis[OUTER].angle


@compiled
def hardware_step(
    plants: Records[Plant],
    pieces: Floats,
    contract: Records[Contract],
    inbox: FrameArray,
    count: int,
    outbox: FrameArray,
) -> int:
    """Run the hardware over one epoch.

    Parameters
    ----------
    plants : Records[Plant]
        One record, changed in place.
    pieces : array, shape (n, 15, 8)
        The vehicle's motion, see `rrins.host_tools.hardware.motion`; only read.
    contract : Records[Contract]
        From `rrins.dbc.contract.load_contract`.
    inbox : FrameArray
        Frames received since the previous step; the first `count` are read.
    outbox : FrameArray
        At least `OUTBOX_CAPACITY` long.

    Returns
    -------
    int
        Frames written to `outbox`: SYNC first, the outer axis' status last.
    """
    plant = plants[0]
    record = contract[0]
    _receive(plant, record, inbox, count)
    advance(plant, pieces, record)
    note_truth(plant, pieces)
    sent = _send(plant, pieces, record, outbox)
    plant.epoch += 1
    return sent
