"""Distances from the odometer: from one count of its pulses to the next.

A frame counts if it is intact, of this epoch, and none disagrees with it. The pulses are a running
count, so the distance over a lost frame comes with the next one. After a time in which the odometer
did not count, or a leap that no vehicle makes, distances begin anew.
"""

from __future__ import annotations

import numpy as np

from rrins.compiled.compilation import compiled
from rrins.dbc.codec import decode, span_of, unpack
from rrins.dbc.contract import MessageSignals
from rrins.dbc.e2e import COUNTER_MODULUS, counter_of, crc_holds
from rrins.dbc.frame import Frame
from rrins.firmware_py.core.frames_in import frame_checks
from rrins.firmware_py.core.records.memory import Odometer, Ram
from rrins.firmware_py.core.records.troubles import Source

LOST_INTERVALS = 5
"""Intervals without a distance after which the odometer's distances count as lost."""

FASTEST_MPS = 200.0
"""Mean speed beyond which a distance is not used: no vehicle with wheels is faster."""

_FROM_ODOMETER = int(Source.ODOMETER)


@compiled
def begin(state: Ram) -> None:
    """Open the next epoch with no frame received."""
    state.odometer.arrived = False
    state.odometer.refused = False


@compiled
def receive(state: Ram, message: MessageSignals, frame: Frame) -> None:
    """Process a frame."""
    if not crc_holds(frame, message.message):
        frame_checks.crc_error(state, _FROM_ODOMETER)
        return
    word = frame["data"]
    if counter_of(word) != state.epoch % COUNTER_MODULUS:
        frame_checks.counter_error(state, _FROM_ODOMETER)
    elif state.odometer.arrived:
        frame_checks.counter_error(state, _FROM_ODOMETER)
        state.odometer.refused |= state.odometer.word[0] != word
    else:
        keep(state.odometer, word)


@compiled
def keep(odometer: Odometer, word: np.uint64) -> None:
    """Store the payload of a frame until the epoch is closed."""
    odometer.arrived = True
    odometer.word[0] = word


@compiled
def close(state: Ram, message: MessageSignals) -> None:
    """Close the epoch: take the distance of its frame, note whether distances come."""
    odometer = state.odometer
    odometer.fresh = False
    if odometer.interval_epochs == 0:
        return
    odometer.silent_epochs += 1
    odometer.age_epochs += 1
    if odometer.arrived and not odometer.refused:
        odometer.silent_epochs = 0
        _take(state, message)
    odometer.lost = odometer.age_epochs > LOST_INTERVALS * odometer.interval_epochs
    if odometer.available and odometer.lost:
        odometer.available = False
        odometer.losses += 1


@compiled
def _take(state: Ram, message: MessageSignals) -> None:
    """Take a frame's count, and the distance since the one before."""
    odometer, period_ns = state.odometer, state.parameters.period_ns
    word = odometer.word[0]
    odometer.valid = unpack(word, message.valid) != 0
    if not odometer.valid:
        _break_off(odometer)
        return
    before, epoch_before, begun = odometer.pulses, odometer.epoch, odometer.begun
    odometer.pulses = unpack(word, message.pulses)
    age_us = decode(word, message.age_us)
    odometer.age_epochs = int(np.rint(age_us * 1000.0 / period_ns))
    odometer.epoch = state.epoch - odometer.age_epochs
    odometer.begun = True
    if not begun:
        return
    span = int(span_of(message.pulses))
    pulses = (odometer.pulses - before + span // 2) % span - span // 2
    distance = pulses * odometer.metres_per_pulse
    seconds = (odometer.epoch - epoch_before) * period_ns * 1e-9
    if seconds <= 0.0 or abs(distance) > FASTEST_MPS * seconds:
        odometer.implausible += 1
        odometer.gaps += 1
        return
    odometer.fresh = True
    odometer.available = True
    odometer.measurements += 1
    odometer.epoch_before = epoch_before
    odometer.distance = distance
    odometer.travelled += distance


@compiled
def _break_off(odometer: Odometer) -> None:
    """Let the next count begin anew."""
    if odometer.begun:
        odometer.begun = False
        odometer.gaps += 1
