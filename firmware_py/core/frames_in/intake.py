"""Frames in: checks their E2E protection and assembles one epoch.

A frame updates a value only if its CRC is correct, its counter is that of the current epoch, and
it is the first of its message in this epoch; any other frame only updates a fault counter. Where
two frames disagree about an epoch, neither is used (`senders`); a sender that repeats one frame is
not used before it counts again (`repetitions`). Frames of a later epoch are left for the next step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Records
from rrins.dbc.codec import decode, to_physical, unpack
from rrins.dbc.contract import SENSOR_GROUPS, Contract, MessageSignals
from rrins.dbc.e2e import COUNTER_MODULUS, MessageLayout, counter_of, crc_holds
from rrins.dbc.frame import Frame, FrameArray
from rrins.firmware_py.core.frames_in import (
    clock,
    frame_checks,
    frame_groups,
    gnss,
    master,
    odometer,
    repetitions,
    senders,
    zero_velocity,
)
from rrins.firmware_py.core.records.diagnostic_records import ATTENTION_FRAMES, ATTENTION_XCP
from rrins.firmware_py.core.records.memory import INNER, OUTER, Assembly, Ram
from rrins.firmware_py.core.records.troubles import Source

_NOTHING, _SYNC, _MODE_COMMAND, _ALTIMETER, _AXIS, _DIAGNOSTIC, _SENSOR = 0, 1, 2, 3, 4, 8, 16
_READMISSION, _ODOMETER, _ZERO_VELOCITY, _XCP = 9, 10, 11, 12
_GNSS = _SENSOR + SENSOR_GROUPS
_MASTER = _GNSS + gnss.FRAMES

_FROM_SYNC, _FROM_COMMAND = int(Source.SYNC), int(Source.MODE_COMMAND)
_FROM_AXES, _FROM_SENSORS = int(Source.AXIS_INNER), int(Source.SENSOR_1)
_FROM_ALTIMETER = int(Source.ALTIMETER)

_EPOCH_BITS = 24  # of the SYNC frame's epoch, checked by `dispatch_table`
_EPOCH_MODULUS = 1 << _EPOCH_BITS

_GYRO_UNUSABLE = 0b0101  # saturated or absent, in the sensor frame's status
_ACCELEROMETER_UNUSABLE = 0b1010

_EARLY_NS = 1_000_000_000
"""Since the hardware's power-on: a computer that first hears it later has begun late."""

ADOPT_BEYOND = 200
"""Epochs by which SYNC may run ahead or behind before the loop adopts its count.

It takes a second SYNC that continues the first, and none that continues the loop's own count: a
single frame of somebody else moves nothing.
"""


def dispatch_table(contract: Records[Contract], has_xcp: bool = False) -> NDArray[np.int16]:
    """Return the intake's action for each of the 2048 identifiers.

    Without `has_xcp` frames of XCP are those of somebody else.
    """
    table = np.full(2048, _NOTHING, dtype=np.int16)
    actions: dict[str, int | NDArray[np.intp]] = {
        "sync": _SYNC,
        "mode_command": _MODE_COMMAND,
        "readmission_command": _READMISSION,
        "altimeter": _ALTIMETER,
        "odometer": _ODOMETER,
        "zero_velocity": _ZERO_VELOCITY,
        "diag_request": _DIAGNOSTIC,
        "diag_functional": _DIAGNOSTIC,
        "xcp_command": _XCP if has_xcp else _NOTHING,
        "axis_inner_status": _AXIS + INNER,
        "axis_outer_status": _AXIS + OUTER,
        "sensor": _SENSOR + np.arange(SENSOR_GROUPS),
    }
    parts = ("gnss_time", "gnss_latitude", "gnss_longitude", "gnss_height", "gnss_velocity")
    actions |= {name: _GNSS + part for part, name in enumerate(parts)}
    actions |= {f"master_{name}": _MASTER + part for part, name in enumerate(master.MESSAGES)}
    for name, action in actions.items():
        table[contract[name]["message"]["can_id"][0]] = action
    assert contract["sync"]["epoch"]["length"][0] == _EPOCH_BITS
    return table


@compiled
def begin(state: Ram) -> None:
    """Open the next epoch with nothing received."""
    state.epoch += 1
    state.clock.sync_seen = False
    state.clock.sync_refused = False
    if state.clock.far_epoch > 0:
        state.clock.far_epoch += 1
    senders.begin(state)
    frame_groups.begin(state.gnss)
    frame_groups.begin(state.master)
    odometer.begin(state)
    assembly = state.assembly
    assembly.received = 0
    assembly.gyro_valid = 0
    assembly.accelerometer_valid = 0
    assembly.gyro_absent = 0
    assembly.accelerometer_absent = 0
    assembly.altimeter_received = False
    assembly.axis_received[INNER] = False
    assembly.axis_received[OUTER] = False


@compiled
def receive(state: Ram, contract: Contract, inbox: FrameArray, start: int, count: int) -> int:
    """Process the frames ``inbox[start:count]`` in the current epoch.

    Returns the index of the first frame that belongs to a later epoch, or `count`.
    """
    for k in range(start, count):
        frame = inbox[k]
        if frame.can_id >= 2048:
            frame_checks.foreign_frame(state, frame)
            continue
        kind = int(state.dispatch[frame.can_id])
        if kind == _NOTHING:
            continue
        if kind == _SYNC:
            if not _receive_sync(state, contract, frame):
                return k
        elif kind == _MODE_COMMAND:
            _receive_mode_command(state, contract, frame)
        elif kind == _ALTIMETER:
            _receive_altimeter(state, contract.altimeter, frame)
        elif kind == _DIAGNOSTIC:  # processed between two steps
            state.diagnostics.attention |= ATTENTION_FRAMES
        elif kind == _XCP:  # likewise
            state.diagnostics.attention |= ATTENTION_XCP
        elif kind == _READMISSION:
            _receive_readmission(state, contract.readmission_command, frame)
        elif kind == _ODOMETER:
            odometer.receive(state, contract.odometer, frame)
        elif kind == _ZERO_VELOCITY:
            zero_velocity.receive(state, contract.zero_velocity, frame)
        elif kind < _SENSOR:
            _receive_axis(state, contract, frame, kind - _AXIS)
        elif kind < _GNSS:
            _receive_sensor(state, contract, frame, kind - _SENSOR)
        elif kind < _MASTER:
            gnss.receive(state, contract, frame, kind - _GNSS)
        else:
            master.receive(state, contract, frame, kind - _MASTER)
    return count


@compiled
def _receive_sync(state: Ram, contract: Contract, frame: Frame) -> bool:
    """Process a SYNC; return False when it opens a later epoch and must wait for the next step."""
    if not crc_holds(frame, contract.sync.message):
        frame_checks.crc_error(state, _FROM_SYNC)
        return True
    own, word = state.clock, frame["data"]
    # The counter, the whole epoch modulo 15, shows how often the 24 bits have wrapped, modulo 15.
    sync_epoch = unpack(word, contract.sync.epoch)
    wraps = (counter_of(word) - sync_epoch) % COUNTER_MODULUS
    whole_epoch = sync_epoch + _EPOCH_MODULUS * wraps
    ahead = (sync_epoch - state.epoch) % _EPOCH_MODULUS
    if ahead >= _EPOCH_MODULUS // 2:
        ahead -= _EPOCH_MODULUS
    if abs(ahead) > ADOPT_BEYOND and own.synchronised:
        if not _continues_jump(state, whole_epoch):
            _refuse_sync(state)
            return True
        own.jumps += 1
        own.synchronised = False
    if not own.synchronised:
        if own.jumps == 0:
            own.began_late = whole_epoch * state.parameters.period_ns > _EARLY_NS
        state.epoch = whole_epoch
        ahead = 0
    if ahead > 0:
        if own.is_whole or (own.sync_seen and ahead > 1):
            _refuse_sync(state)
            return True
        return False
    if ahead < 0:
        frame_checks.counter_error(state, _FROM_SYNC)
        senders.doubt(state, _FROM_SYNC, word)
    elif own.sync_seen:
        frame_checks.counter_error(state, _FROM_SYNC)
        senders.compare(state, _FROM_SYNC, word)
        return True
    else:
        _see_sync(state, word)
    clock.synchronise(own, -ahead)
    return True


@compiled
def _see_sync(state: Ram, word: np.uint64) -> None:
    """Take the SYNC of this epoch."""
    state.clock.sync_seen = True
    state.clock.far_epoch = 0
    senders.keep(state, _FROM_SYNC, word)
    if state.clock.sync_refused:
        senders.dispute(state, _FROM_SYNC)


@compiled
def _continues_jump(state: Ram, epoch: int) -> bool:
    """Return whether a SYNC far from the count continues another one; else keep its epoch."""
    own = state.clock
    if own.sync_seen:
        return False
    expected = own.far_epoch - 1
    if own.far_epoch > 0 and expected <= epoch <= expected + 1:
        return True
    own.far_epoch = epoch + 1
    return False


@compiled
def _refuse_sync(state: Ram) -> None:
    """Count a SYNC that is not of this epoch, whatever it says."""
    frame_checks.counter_error(state, _FROM_SYNC)
    state.clock.sync_refused = True
    if state.clock.sync_seen:
        senders.dispute(state, _FROM_SYNC)


@compiled
def _receive_mode_command(state: Ram, contract: Contract, frame: Frame) -> None:
    if not crc_holds(frame, contract.mode_command.message):
        frame_checks.crc_error(state, _FROM_COMMAND)
        return
    counter = counter_of(frame["data"]) + 1  # 0 in the memory: none received yet
    if counter == state.mode_command_counter:
        frame_checks.counter_error(state, _FROM_COMMAND)
        return
    state.diagnostics.command_seen = True
    state.mode_command_counter = counter
    request = unpack(frame["data"], contract.mode_command.mode_request)
    if request != state.modes.heard:  # a repetition must not undo later changes by others
        state.modes.heard = request
        state.modes.requested = request


@compiled
def _receive_readmission(state: Ram, command: MessageSignals, frame: Frame) -> None:
    if crc_holds(frame, command.message):
        keep_readmission(state, command, frame["data"])
    else:
        state.faults.crc_errors += 1


@compiled
def keep_readmission(state: Ram, command: MessageSignals, word: np.uint64) -> None:
    """Store the payload of the operator's order to readmit a sensor; a repetition changes nothing.

    Without redundancy there is nobody to obey.
    """
    readmission = state.redundancy.readmission
    readmission.order = unpack(word, command.order)
    readmission.order_kind = unpack(word, command.kind)
    readmission.order_sensor = unpack(word, command.sensor)
    readmission.order_anew = unpack(word, command.anew) != 0
    readmission.order_s = unpack(word, command.test_s)


@compiled
def _belongs_here(
    state: Ram, frame: Frame, message: MessageLayout, had_one: bool, source: int
) -> bool:
    """Return whether a frame is intact, of this epoch, the first of its kind, and trusted."""
    if not crc_holds(frame, message):
        frame_checks.crc_error(state, source)
        return False
    word = frame["data"]
    if counter_of(word) != state.epoch % COUNTER_MODULUS:
        frame_checks.foreign_epoch(state, source, word)
        senders.doubt(state, source, word)
        repetitions.note_foreign(state, source, word)
        return False
    if had_one or senders.is_disputed(state, source):
        frame_checks.counter_error(state, source)
        senders.compare(state, source, word)
        return False
    if not repetitions.is_trusted(state, source, message, word):
        frame_checks.counter_error(state, source)
        return False
    senders.keep(state, source, word)
    return True


@compiled
def _receive_altimeter(state: Ram, altimeter: MessageSignals, frame: Frame) -> None:
    had_one = state.assembly.altimeter_received
    if _belongs_here(state, frame, altimeter.message, had_one, _FROM_ALTIMETER):
        keep_altitude(state.assembly, altimeter, frame["data"])
    elif senders.is_disputed(state, _FROM_ALTIMETER):
        state.assembly.altimeter_received = False


@compiled
def keep_altitude(assembly: Assembly, altimeter: MessageSignals, word: np.uint64) -> None:
    """Store the payload of the altimeter's frame."""
    assembly.altimeter_received = True
    assembly.altimeter_height = decode(word, altimeter.height)


@compiled
def _receive_axis(state: Ram, contract: Contract, frame: Frame, axis: int) -> None:
    status = contract.axis_inner_status if axis == INNER else contract.axis_outer_status
    had_one = state.assembly.axis_received[axis]
    assembly = state.assembly
    if _belongs_here(state, frame, status.message, had_one, _FROM_AXES + axis):
        assembly.angle_before_deg[axis] = assembly.encoder_angle_deg[axis]
        assembly.rate_before_dps[axis] = assembly.encoder_rate_dps[axis]
        assembly.state_before[axis] = assembly.axis_state[axis]
        word = frame["data"]
        angle_deg = decode(word, status.encoder_angle_deg)
        rate_dps = decode(word, status.encoder_rate_dps)
        keep_axis(assembly, axis, unpack(word, status.state), angle_deg, rate_dps)
    elif had_one and senders.is_disputed(state, _FROM_AXES + axis):
        assembly.axis_received[axis] = False
        assembly.encoder_angle_deg[axis] = assembly.angle_before_deg[axis]
        assembly.encoder_rate_dps[axis] = assembly.rate_before_dps[axis]
        assembly.axis_state[axis] = assembly.state_before[axis]


@compiled
def keep_axis(assembly: Assembly, axis: int, state: int, angle_deg: float, rate_dps: float) -> None:
    """Store what an axis' frame says."""
    assembly.axis_received[axis] = True
    assembly.encoder_angle_deg[axis] = angle_deg
    assembly.encoder_rate_dps[axis] = rate_dps
    assembly.axis_state[axis] = state


@compiled
def _receive_sensor(state: Ram, contract: Contract, frame: Frame, group: int) -> None:
    sensor = contract.sensor[group]
    had_one = state.assembly.received & (1 << group) != 0
    if _belongs_here(state, frame, sensor.message, had_one, _FROM_SENSORS + group):
        word = frame["data"]
        dtheta, dv = unpack(word, sensor.gyro_dtheta), unpack(word, sensor.accelerometer_dv)
        status = unpack(word, sensor.status)
        keep_group(state.assembly, sensor, group, dtheta, dv, status)
        if status != 0:
            frame_checks.sensor_status(state, 1 << group, status)
    elif had_one and senders.is_disputed(state, _FROM_SENSORS + group):
        _withdraw_group(state, 1 << group)


@compiled
def _withdraw_group(state: Ram, bit: int) -> None:
    """Use nothing of a sensor group's frame of this epoch."""
    assembly, monitor = state.assembly, state.diagnostics
    assembly.received &= ~bit
    assembly.gyro_valid &= ~bit
    assembly.accelerometer_valid &= ~bit
    assembly.gyro_absent &= ~bit
    assembly.accelerometer_absent &= ~bit
    monitor.gyro_absent &= ~bit
    monitor.gyro_saturated &= ~bit
    monitor.accelerometer_absent &= ~bit
    monitor.accelerometer_saturated &= ~bit


@compiled
def keep_group(
    assembly: Assembly, sensor: MessageSignals, group: int, dtheta: int, dv: int, status: int
) -> None:
    """Store what a sensor group's frame says: counts of both sensors, and its status."""
    bit = 1 << group
    assembly.received |= bit
    assembly.gyro_dtheta[group] = to_physical(dtheta, sensor.gyro_dtheta)
    assembly.accelerometer_dv[group] = to_physical(dv, sensor.accelerometer_dv)
    if status & frame_checks.GYRO_ABSENT:
        assembly.gyro_absent |= bit
    if status & frame_checks.ACCELEROMETER_ABSENT:
        assembly.accelerometer_absent |= bit
    if status & _GYRO_UNUSABLE == 0:
        assembly.gyro_valid |= bit
    if status & _ACCELEROMETER_UNUSABLE == 0:
        assembly.accelerometer_valid |= bit


@compiled
def close(state: Ram) -> None:
    """Close the epoch: count the missing frames, once the hardware has been heard."""
    assembly = state.assembly
    diagnostics, redundancy = state.diagnostics, state.redundancy
    assembly.gyro_usable = assembly.gyro_valid
    assembly.accelerometer_usable = assembly.accelerometer_valid
    assembly.gyro_valid &= ~(diagnostics.excluded_gyros | redundancy.gyros.excluded)
    assembly.accelerometer_valid &= ~(
        diagnostics.excluded_accelerometers | redundancy.accelerometers.excluded
    )
    if not state.clock.synchronised:
        return
    if not state.clock.sync_seen:
        state.faults.missing_frames += 1
    groups = max(state.gyros.count, state.accelerometers.count)
    for group in range(groups):
        if assembly.received >> group & 1 == 0:
            state.faults.missing_frames += 1
        if repetitions.is_useless(state, _FROM_SENSORS + group):
            assembly.gyro_absent |= 1 << group
            assembly.accelerometer_absent |= 1 << group
    for axis in (INNER, OUTER):
        if assembly.axis_received[axis]:
            assembly.axis_silent_epochs[axis] = 0
        else:  # extrapolated by its rate
            seconds = state.parameters.period_ns * 1e-9
            assembly.encoder_angle_deg[axis] += assembly.encoder_rate_dps[axis] * seconds
            assembly.axis_silent_epochs[axis] += 1
            state.faults.missing_frames += 1
