"""What the intake notes of single frames, for the monitor."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from dbc.e2e import COUNTER_MODULUS, counter_of
from dbc.frame import ERR_FLAG

# Error frames as SocketCAN gives them (linux/can/error.h).
_CONTROLLER, _BUS_OFF, _RESTARTED = 0x004, 0x040, 0x100
_PASSIVE, _ACTIVE = 0x30, 0x40  # of byte 1, with _CONTROLLER
_BYTE_1 = 8

_GYRO_SATURATED, _ACCELEROMETER_SATURATED = 1, 2  # of a sensor frame's status
_GYRO_ABSENT, _ACCELEROMETER_ABSENT = 4, 8


@njit(cache=True)
def crc_error(state: Any, source: int) -> None:
    """Count a frame with a wrong CRC."""
    state.faults.crc_errors += 1
    state.diagnostics.crc_wrong |= 1 << source


@njit(cache=True)
def counter_error(state: Any, source: int) -> None:
    """Count a frame with a wrong or repeated counter."""
    state.faults.counter_errors += 1
    state.diagnostics.counter_wrong |= 1 << source


@njit(cache=True)
def foreign_epoch(state: Any, source: int, word: Any) -> None:
    """Count a frame whose counter is not that of the present epoch."""
    age = (state.epoch - counter_of(word)) % COUNTER_MODULUS
    if 1 <= age <= COUNTER_MODULUS // 2:
        state.faults.counter_errors += 1
        state.diagnostics.stale |= 1 << source
    else:
        counter_error(state, source)


@njit(cache=True)
def sensor_status(state: Any, bit: int, status: int) -> None:
    """Note what a sensor group says of itself, where it says anything."""
    monitor = state.diagnostics
    if status & _GYRO_SATURATED:
        monitor.gyro_saturated |= bit
    if status & _ACCELEROMETER_SATURATED:
        monitor.accelerometer_saturated |= bit
    if status & _GYRO_ABSENT:
        monitor.gyro_absent |= bit
    if status & _ACCELEROMETER_ABSENT:
        monitor.accelerometer_absent |= bit


@njit(cache=True)
def foreign_frame(state: Any, frame: Any) -> None:
    """Follow the controller's state in an error frame; other frames say nothing."""
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
