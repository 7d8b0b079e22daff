"""Frames out: axis commands every epoch, the rest at the cycle times of the DBC."""

from __future__ import annotations

import math

import numpy as np

from rrins.compiled.compilation import compiled, compiled_with
from rrins.dbc.codec import SignalLayout, encode, encode_wrapped, pack
from rrins.dbc.contract import Contract, MessageSignals
from rrins.dbc.e2e import MessageLayout, fill
from rrins.dbc.frame import FrameArray
from rrins.firmware_py.core.frames_in import aiding_status, clock
from rrins.firmware_py.core.frames_out import estimator_frames
from rrins.firmware_py.core.modes.modes import navigating
from rrins.firmware_py.core.navigation import bridging
from rrins.firmware_py.core.records.calibration_records import Drift
from rrins.firmware_py.core.records.integrity_records import HEADING, HORIZONTAL, VERTICAL
from rrins.firmware_py.core.records.memory import INNER, OUTER, FaultCounters, Ram
from rrins.firmware_py.core.records.redundancy_records import Parity, Readmission
from rrins.firmware_py.core.redundancy import drift
from rrins.firmware_py.core.turntable import sequencer

OUTBOX_CAPACITY = 32
"""Most frames that one step sends, with room to spare."""

_NS_PER_MS = 1_000_000


@compiled
def _due(state: Ram, message: MessageLayout) -> bool:
    """Return whether a cyclic message is due in this epoch."""
    every = max(1, message.cycle_ms * _NS_PER_MS // state.parameters.period_ns)
    return state.epoch % every == 0


@compiled
def _saturate(value: int, signal: SignalLayout) -> int:
    return min(value, signal.raw_maximum)


@compiled
def _status(state: Ram, status: MessageSignals) -> np.uint64:
    modes, running = state.modes, state.sequencer
    word = np.uint64(0)
    word = pack(word, status.mode, modes.mode)
    word = pack(word, status.fault, modes.fault)
    if running.running and not running.homing:
        word = pack(word, status.scheme_position, running.position + 1)
    word = pack(word, status.scheme_cycle, running.cycle)
    word = encode(word, status.load_percent, state.load_percent)
    word = pack(word, status.axis_inner_not_following, running.not_following[INNER])
    word = pack(word, status.axis_outer_not_following, running.not_following[OUTER])
    word = pack(word, status.sync_lost, state.clock.sync_lost)
    usable = 0
    both = state.assembly.gyro_valid & state.assembly.accelerometer_valid
    while both != 0:
        usable += both & 1
        both >>= 1
    word = pack(word, status.usable_sensors, usable)
    error_ppm = clock.error_ppm(state.clock, state.parameters.period_ns)
    return encode(word, status.clock_error_ppm, error_ppm)


@compiled
def _faults(counters: FaultCounters, message: MessageSignals) -> np.uint64:
    word = np.uint64(0)
    word = pack(word, message.crc_errors, _saturate(counters.crc_errors, message.crc_errors))
    word = pack(
        word, message.counter_errors, _saturate(counters.counter_errors, message.counter_errors)
    )
    word = pack(
        word, message.missing_frames, _saturate(counters.missing_frames, message.missing_frames)
    )
    word = pack(
        word, message.bridged_epochs, _saturate(counters.bridged_epochs, message.bridged_epochs)
    )
    return pack(word, message.overruns, _saturate(counters.overruns, message.overruns))


@compiled
def _redundancy(
    parity: Parity, compared: Drift, repairing: bool, message: MessageSignals
) -> np.uint64:
    word = pack(np.uint64(0), message.alarm, parity.alarm)
    word = pack(word, message.redundant, parity.redundancy_left)
    word = pack(word, message.repairing, repairing)
    word = pack(word, message.standing, parity.now.standing > 0)
    word = pack(word, message.excluded, parity.excluded)
    word = encode(word, message.parity_ratio, parity.ratio)
    level = 0
    while 1 << (level + 1) <= parity.window_s:
        level += 1
    word = pack(word, message.window_log2, level)
    word = pack(word, message.suspect, parity.suspect + 1)
    word = pack(word, message.how, parity.how)
    word = pack(word, message.isolated, parity.isolated + 1)
    return pack(word, message.drift, drift.size_of(compared))


@compiled
def _readmission(readmission: Readmission, message: MessageSignals) -> np.uint64:
    word = pack(np.uint64(0), message.state, readmission.state)
    word = pack(word, message.kind, readmission.kind)
    word = pack(word, message.sensor, readmission.sensor)
    word = pack(word, message.anew, readmission.anew)
    word = pack(word, message.refusal, readmission.refusal)
    word = pack(word, message.passed_s, readmission.passed_s)
    word = pack(word, message.test_s, readmission.wanted_s)
    return encode(word, message.parity_ratio, readmission.ratio)


@compiled
def _redundancies(state: Ram, contract: Contract, outbox: FrameArray, count: int) -> int:
    """Append the frames of the redundancy; return the new number of frames."""
    redundancy, calibration = state.redundancy, state.calibration
    active, kind = redundancy.repair.active, redundancy.repair.kind
    gyros, accelerometers = contract.gyro_redundancy, contract.accelerometer_redundancy
    word = _redundancy(redundancy.gyros, calibration.gyros, active and kind == 0, gyros)
    fill(outbox[count], gyros.message, word, redundancy.transmissions)
    parity, compared = redundancy.accelerometers, calibration.accelerometers
    word = _redundancy(parity, compared, active and kind == 1, accelerometers)
    fill(outbox[count + 1], accelerometers.message, word, redundancy.transmissions)
    if redundancy.readmission.sensor > 0:
        message = contract.readmission_status
        word = _readmission(redundancy.readmission, message)
        fill(outbox[count + 2], message.message, word, redundancy.transmissions)
        count += 1
    redundancy.transmissions += 1
    return count + 2


@compiled
def _integrity(state: Ram, message: MessageSignals) -> np.uint64:
    integrity = state.integrity
    word = pack(np.uint64(0), message.status, integrity.status)
    word = pack(word, message.suspected, integrity.suspected)
    word = pack(word, message.unmonitored, integrity.unmonitored)
    word = pack(word, message.refusing, integrity.refusing)
    word = encode(word, message.horizontal_protection, integrity.protection[HORIZONTAL])
    word = encode(word, message.vertical_protection, integrity.protection[VERTICAL])
    heading_deg = math.degrees(integrity.protection[HEADING])
    return encode(word, message.heading_protection, heading_deg)


@compiled
def _table(state: Ram, message: MessageSignals) -> np.uint64:
    encoders, running = state.encoders, state.sequencer
    word = pack(np.uint64(0), message.axis_inner_source, encoders.source[INNER])
    word = pack(word, message.axis_outer_source, encoders.source[OUTER])
    word = encode(word, message.axis_inner_offset_deg, encoders.offset_deg[INNER])
    word = encode(word, message.axis_outer_offset_deg, encoders.offset_deg[OUTER])
    word = pack(word, message.tries, running.tries)
    word = pack(word, message.interrupted, running.interrupted)
    word = pack(word, message.axis_inner_abandoned, running.abandoned[INNER])
    return pack(word, message.axis_outer_abandoned, running.abandoned[OUTER])


@compiled
def _bridged(state: Ram, message: MessageSignals) -> np.uint64:
    gaps, seconds = state.bridging, state.parameters.period_ns * 1e-9
    word = pack(np.uint64(0), message.degraded, bridging.is_degraded(gaps))
    percent = 100.0 * gaps.recent_s / bridging.MEMORY_S
    word = encode(word, message.recent_percent, percent)
    word = encode(word, message.bridged_s, gaps.bridged_epochs * seconds)
    uncertainty = math.degrees(math.sqrt(gaps.angle_variance)) * 3600.0
    return encode(word, message.uncertainty_arcsec, uncertainty)


@compiled
def _had_trouble(state: Ram) -> bool:
    """Return whether an encoder has been wrong, or an axis has not followed, since power-on."""
    trouble = np.int64(0)
    for axis in range(2):
        trouble |= state.encoders.found_epoch[axis] | state.sequencer.interruptions[axis]
    return trouble != 0


@compiled
def _navigation(state: Ram, contract: Contract, outbox: FrameArray, count: int) -> int:
    """Append the five navigation frames; return the new number of frames."""
    output = state.navigation
    counter = state.navigation_transmissions
    state.navigation_transmissions += 1

    message = contract.nav_latitude
    word = encode(np.uint64(0), message.latitude_deg, math.degrees(output.latitude))
    fill(outbox[count], message.message, pack(word, message.epoch, output.epoch), counter)

    east = contract.nav_longitude
    word = encode(np.uint64(0), east.longitude_deg, math.degrees(output.longitude))
    fill(outbox[count + 1], east.message, pack(word, east.epoch, output.epoch), counter)

    velocity = contract.nav_velocity
    word = encode(np.uint64(0), velocity.velocity_east, output.velocity_n[0])
    word = encode(word, velocity.velocity_north, output.velocity_n[1])
    fill(outbox[count + 2], velocity.message, word, counter)

    vertical = contract.nav_height
    word = encode(np.uint64(0), vertical.height, output.height)
    word = encode(word, vertical.velocity_up, output.velocity_n[2])
    fill(outbox[count + 3], vertical.message, word, counter)

    attitude = contract.nav_attitude
    word = encode(np.uint64(0), attitude.roll_deg, math.degrees(output.roll))
    word = encode(word, attitude.pitch_deg, math.degrees(output.pitch))
    word = encode(word, attitude.heading_deg, math.degrees(output.heading))
    fill(outbox[count + 4], attitude.message, word, counter)
    return count + 5


@compiled
def axis_command(state: Ram, axis: int) -> tuple[int, float, float]:
    """Return an axis' command: an `AxisCommand`, target in degrees, largest rate in °/s."""
    running = state.sequencer
    rate_dps = state.parameters.turn_rate_dps
    if axis == INNER and sequencer.is_isolating(running):
        rate_dps = state.parameters.isolation_rate_dps
    return int(running.command[axis]), sequencer.commanded_angle_deg(running, axis), rate_dps


@compiled
def _axis_command_word(state: Ram, message: MessageSignals, axis: int) -> np.uint64:
    """Return the payload of an axis' command."""
    command, target_deg, rate_dps = axis_command(state, axis)
    word = pack(np.uint64(0), message.command, command)
    word = encode_wrapped(word, message.target_angle_deg, target_deg)
    return encode(word, message.rate_limit_dps, rate_dps)


@compiled_with(is_unit=True)
def transmit(state: Ram, contract: Contract, outbox: FrameArray) -> int:
    """Write this epoch's frames to `outbox`; return their number.

    The command of the outer axis is always the last: in lockstep it closes the epoch for the
    other side.
    """
    count = 0
    if _due(state, contract.heartbeat_firmware.message):
        heartbeat = contract.heartbeat_firmware
        uptime = state.steps * state.parameters.period_ns * 1e-9
        word = encode(np.uint64(0), heartbeat.uptime, uptime)
        word = pack(word, heartbeat.began_late, int(state.clock.began_late))
        fill(outbox[count], heartbeat.message, word, state.heartbeats)
        state.heartbeats += 1
        count += 1
    if _due(state, contract.firmware_status.message):
        status = _status(state, contract.firmware_status)
        fill(outbox[count], contract.firmware_status.message, status, state.transmissions)
        faults = _faults(state.faults, contract.firmware_faults)
        fill(outbox[count + 1], contract.firmware_faults.message, faults, state.transmissions)
        state.transmissions += 1
        count += 2
    if state.redundancy.enabled and _due(state, contract.gyro_redundancy.message):
        count = _redundancies(state, contract, outbox, count)
    is_due = state.estimator.enabled and _due(state, contract.estimator_status.message)
    if is_due and estimator_frames.is_known(state):
        count = estimator_frames.send(state, contract, outbox, count)
    bounds = contract.integrity
    if state.integrity.enabled and _due(state, bounds.message):
        fill(
            outbox[count], bounds.message, _integrity(state, bounds), state.integrity.transmissions
        )
        state.integrity.transmissions += 1
        count += 1
    table = contract.table_status
    if _due(state, table.message) and _had_trouble(state):
        fill(outbox[count], table.message, _table(state, table), state.encoders.transmissions)
        state.encoders.transmissions += 1
        count += 1
    gaps = contract.bridging
    if navigating(state) and state.bridging.bridged_epochs > 0 and _due(state, gaps.message):
        fill(outbox[count], gaps.message, _bridged(state, gaps), state.bridging.transmissions)
        state.bridging.transmissions += 1
        count += 1
    aiding = contract.aiding_status
    if _due(state, aiding.message) and aiding_status.has_any(state):
        word = aiding_status.word(state, aiding)
        fill(outbox[count], aiding.message, word, state.aiding_transmissions)
        state.aiding_transmissions += 1
        count += 1
    if navigating(state) and _due(state, contract.nav_latitude.message):
        count = _navigation(state, contract, outbox, count)
    inner, outer = contract.axis_inner_command, contract.axis_outer_command
    fill(outbox[count], inner.message, _axis_command_word(state, inner, INNER), state.epoch)
    fill(outbox[count + 1], outer.message, _axis_command_word(state, outer, OUTER), state.epoch)
    return count + 2
