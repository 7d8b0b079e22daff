"""AIDING_STATUS: which sources of aiding there are, and which of them say anything."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import encode, pack
from rrins.dbc.contract import MessageSignals
from rrins.firmware_py.core.records.memory import Ram


class AidingState(IntEnum):
    """State of a source of aiding, as in AIDING_STATUS."""

    NONE = 0
    PRESENT = 1
    LOST = 2


@compiled
def has_any(state: Ram) -> bool:
    """Return whether there is anything to tell."""
    if state.gnss.interval_epochs > 0 or state.odometer.interval_epochs > 0:
        return True
    return state.zero_velocity.counter > 0 or state.estimator.detects_standing


@compiled
def _state(fitted: bool, comes: bool) -> int:
    if not fitted:
        return AidingState.NONE
    return AidingState.PRESENT if comes else AidingState.LOST


@compiled
def word(state: Ram, message: MessageSignals) -> np.uint64:
    """Return the payload of AIDING_STATUS."""
    gnss, odometer, monitor = state.gnss, state.odometer, state.diagnostics
    seconds = state.parameters.period_ns * 1e-9
    payload = np.uint64(0)
    payload = pack(payload, message.gnss, _state(gnss.interval_epochs > 0, gnss.available))
    comes = odometer.available
    payload = pack(payload, message.odometer, _state(odometer.interval_epochs > 0, comes))
    comes = monitor.altimeter_silence <= monitor.patience_epochs
    payload = pack(payload, message.altimeter, _state(state.parameters.altimeter, comes))
    payload = pack(payload, message.standing, state.zero_velocity.standing)
    payload = pack(payload, message.detected, state.estimator.standing)
    payload = encode(payload, message.gate_openings, state.estimator.reopenings)
    payload = encode(payload, message.gnss_losses, gnss.losses)
    payload = encode(payload, message.odometer_losses, odometer.losses)
    payload = encode(payload, message.gnss_age, gnss.age_epochs * seconds)
    return encode(payload, message.odometer_age, odometer.age_epochs * seconds)
