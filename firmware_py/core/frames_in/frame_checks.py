"""Notes of the intake about single frames, for the monitor."""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of
from rrins.dbc.frame import ERR_FLAG, Frame
from rrins.firmware_py.core.records.memory import Ram

# Error frames as in SocketCAN (linux/can/error.h).
_CONTROLLER, _BUS_OFF, _RESTARTED = 0x004, 0x040, 0x100
_PASSIVE, _ACTIVE = 0x30, 0x40  # of byte 1, with _CONTROLLER
_BYTE_1 = 8

_GYRO_SATURATED, _ACCELEROMETER_SATURATED = 1, 2  # of a sensor frame's status
GYRO_ABSENT, ACCELEROMETER_ABSENT = 4, 8


@compiled
def crc_error(state: Ram, source: int) -> None:
    """Count a frame with a wrong CRC."""
    state.faults.crc_errors += 1
    state.diagnostics.crc_wrong |= 1 << source


@compiled
def counter_error(state: Ram, source: int) -> None:
    """Count a frame with a wrong or repeated counter."""
    state.faults.counter_errors += 1
    state.diagnostics.counter_wrong |= 1 << source


@compiled
def foreign_epoch(state: Ram, source: int, word: np.uint64) -> None:
    """Count a frame whose counter is not that of the current epoch."""
    age = (state.epoch - counter_of(word)) % COUNTER_MODULUS
    if 1 <= age <= COUNTER_MODULUS // 2:
        state.faults.counter_errors += 1
        state.diagnostics.stale |= 1 << source
    else:
        counter_error(state, source)


@compiled
def sensor_status(state: Ram, bit: int, status: int) -> None:
    """Note the faults that a sensor group reports, if any."""
    monitor = state.diagnostics
    if status & _GYRO_SATURATED:
        monitor.gyro_saturated |= bit
    if status & _ACCELEROMETER_SATURATED:
        monitor.accelerometer_saturated |= bit
    if status & GYRO_ABSENT:
        monitor.gyro_absent |= bit
    if status & ACCELEROMETER_ABSENT:
        monitor.accelerometer_absent |= bit


@compiled
def foreign_frame(state: Ram, frame: Frame) -> None:
    """Track the controller's state in an error frame; ignore other frames."""
    if frame.can_id & ERR_FLAG == 0:
        return
    monitor = state.diagnostics
    detail = np.int64(frame["data"] >> np.uint64(_BYTE_1)) & 0xFF
    if frame.can_id & _BUS_OFF:
        monitor.bus_state = 2
    elif frame.can_id & _RESTARTED:
        monitor.bus_state = 0
    elif frame.can_id & _CONTROLLER and detail & _PASSIVE:
        monitor.bus_state = 1
    elif frame.can_id & _CONTROLLER and detail & _ACTIVE:
        monitor.bus_state = 0
    monitor.bus_state_worst = max(monitor.bus_state_worst, monitor.bus_state)
