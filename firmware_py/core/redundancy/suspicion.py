"""The effect that a fault may have had, told to the estimator from the alarm on, per suspect.

From the alarm's earliest start, the changes from leaving a sensor out are carried through the
stored seconds as the repair does, some blocks per epoch. With the size of the fault, as the window
shows it in which it is most significant, this is what the sensor has done if it is the one that
fails. The estimator adds it to its covariance (`estimator.doubt`); once the sensor is left out, it
takes back what the doubt about the others let it learn.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import transition
from rrins.firmware_py.core.records.estimator_records import HEIGHT, LATITUDE, LONGITUDE
from rrins.firmware_py.core.records.memory import Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    GYROS,
    WINDOWS_S,
    Parity,
)
from rrins.firmware_py.core.redundancy import blocks, repair, windows
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM

_BLOCKS_PER_EPOCH = 8

LASTS_S = 200
"""Seconds after an alarm in which the next one is of the same fault: a small one raises it now and
then."""

_SURE = 3.0
"""Standard deviations of the fault's size, beyond what was measured."""

_GROWS = 1.2
"""By how much the size of a fault has to grow to be told again: noise moves it, too."""


@compiled
def begin(state: Ram) -> None:
    """Begin with the navigation: suspect nothing."""
    suspicion = state.redundancy.suspicion
    suspicion.active = False
    suspicion.until[:] = 0


@compiled
def lasts(state: Ram, kind: int) -> bool:
    """Return whether the fault of an alarm that nothing has resolved may still be there."""
    return bool(state.epoch < state.redundancy.suspicion.until[kind])


@compiled
def _since_s(state: Ram, parity: Parity) -> float:
    """Return for how many seconds the fault may have lasted, at most."""
    seconds = float(WINDOWS_S[windows.begun_level(parity, 0.0)])
    waited = (state.epoch - parity.alarm_epoch) / state.redundancy.second_epochs
    return max(seconds, waited)


@compiled
def _measure(state: Ram, parity: Parity) -> bool:
    """Write each suspect's size as it shows now; return whether one has grown.

    Within a second also what this has shown so far: a large fault is found at once.
    """
    suspicion, kind = state.redundancy.suspicion, int(parity.kind)
    level = windows.begun_level(parity, 0.0)
    part = parity.used_epochs / state.redundancy.second_epochs
    grown = False
    for k in range(parity.residual.shape[0]):
        suspicion.fault_size[kind, k] = 0.0
        if parity.sensors >> k & 1 == 0 or parity.projector[k, k] <= CHECKED_FROM:
            continue
        share = parity.projector[k, k] * WINDOWS_S[level]
        value = parity.window_sum[level, k] / share
        sigma = math.sqrt(windows.variance_of(parity, level, k)) / share
        if part > 0.0 and abs(parity.residual[k]) > abs(value) * parity.projector[k, k] * part:
            value = parity.residual[k] / (parity.projector[k, k] * part)
        size = abs(value) + _SURE * sigma
        suspicion.value[kind, k] = value
        suspicion.sigma[kind, k] = sigma
        suspicion.fault_size[kind, k] = size if value >= 0.0 else -size
        grown = grown or size > _GROWS * suspicion.told[kind, k]
    return grown


@compiled
def _suspect(state: Ram, parity: Parity, anew: bool) -> None:
    """Begin to carry what the suspects have done; not again within one fault: only its size."""
    suspicion, history = state.redundancy.suspicion, state.redundancy.repair
    longer = repair.longer(history, _since_s(state, parity)) if anew else 0
    suspicion.kind = parity.kind
    suspicion.anew = anew
    suspicion.active = True
    suspicion.at = history.count - longer
    suspicion.begun_epoch = state.epoch - longer * state.redundancy.second_epochs
    for k in range(parity.residual.shape[0]):
        size = abs(suspicion.fault_size[parity.kind, k])
        before = 0.0 if anew else suspicion.told[parity.kind, k]
        suspicion.told[parity.kind, k] = max(size, before)
    suspicion.height[:] = 0.0
    suspicion.x[:] = 0.0


@compiled
def _update(state: Ram, parity: Parity) -> None:
    """Look at a kind at the end of a second."""
    suspicion, kind = state.redundancy.suspicion, int(parity.kind)
    if not parity.alarm or not parity.redundant or suspicion.active:
        return
    anew = not lasts(state, kind)
    suspicion.until[kind] = state.epoch + LASTS_S * state.redundancy.second_epochs
    if _measure(state, parity) or anew:
        _suspect(state, parity, anew)


@compiled
def was_aided(state: Ram, kind: int, seconds: float) -> bool:
    """Return whether a measurement was used since the fault began: it has changed its effect."""
    estimator, redundancy = state.estimator, state.redundancy
    if lasts(state, kind):
        return estimator.unaided[kind] == 0
    longest = repair.longer(redundancy.repair, seconds) * redundancy.second_epochs
    return bool(estimator.aided_epoch >= 0 and state.epoch - estimator.aided_epoch <= longest)


@compiled
def settle(state: Ram, parity: Parity, sensor: int, seconds: float) -> bool:
    """Tell the estimator that it was this sensor, which is left out from now on.

    Returns whether the estimator undoes what the fault has done, for `seconds` as it seems.
    """
    suspicion, estimator, kind = state.redundancy.suspicion, state.estimator, int(parity.kind)
    if not estimator.running:
        return False
    is_told = lasts(state, kind)
    aided = was_aided(state, kind, seconds)
    if not (aided or is_told):
        return False
    if not is_told:
        _measure(state, parity)
        _suspect(state, parity, True)
    suspicion.until[kind] = 0
    estimator.settles |= 1 << kind
    estimator.settled_sensor[kind] = sensor
    estimator.settled_value[kind] = suspicion.value[kind, sensor]
    estimator.settled_sigma[kind] = suspicion.sigma[kind, sensor]
    return aided


@compiled
def _carry(state: Ram) -> None:
    """Carry the changes of the suspects through the next block."""
    suspicion, history = state.redundancy.suspicion, state.redundancy.repair
    at = blocks.place(history, suspicion.at)
    block = history.blocks[at : at + history.stride]
    of_gyro = suspicion.kind == GYROS
    fusion, first = state.gyros, 0
    if not of_gyro:
        fusion, first = state.accelerometers, 3 * int(state.gyros.count)
    up = transition.VELOCITY + 2
    for k in range(fusion.count):
        if suspicion.fault_size[suspicion.kind, k] == 0.0:
            continue
        place = first + 3 * k
        before = suspicion.x[k, up]
        repair.carry(state, suspicion.x[k], block, block[place : place + 3], 1.0, of_gyro)
        dt = block[history.stride - blocks.OTHERS + blocks.TIME]
        suspicion.height[k] += 0.5 * (before + suspicion.x[k, up]) * dt
    suspicion.at += 1


@compiled
def _tell(state: Ram, fusion: Fusion) -> None:
    """Hand the suspects' effects over to the estimator, enlarged as their sizes are."""
    suspicion, estimator = state.redundancy.suspicion, state.estimator
    kind = int(suspicion.kind)
    estimator.doubts = True
    estimator.doubt_kind = kind
    estimator.doubt_anew = suspicion.anew
    estimator.doubt_epoch = suspicion.begun_epoch
    for k in range(fusion.count):
        size, value = suspicion.fault_size[kind, k], suspicion.value[kind, k]
        larger = size / value if value != 0.0 else 0.0
        estimator.doubt_size[k] = size
        for i in range(LATITUDE):
            estimator.doubt_effect[k, i] = larger * suspicion.x[k, i]
        estimator.doubt_effect[k, LATITUDE] = larger * suspicion.x[k, transition.LATITUDE]
        estimator.doubt_effect[k, LONGITUDE] = larger * suspicion.x[k, transition.LONGITUDE]
        estimator.doubt_effect[k, HEIGHT] = larger * suspicion.height[k]


@compiled
def follow(state: Ram) -> None:
    """Suspect what has an alarm, and carry on; called at the end of an epoch's comparisons."""
    suspicion, history = state.redundancy.suspicion, state.redundancy.repair
    if not state.estimator.running:
        return
    if state.redundancy.epochs == 0:
        parity = state.redundancy.gyros
        for kind in range(2):
            if kind == ACCELEROMETERS:
                parity = state.redundancy.accelerometers
            _update(state, parity)
    if not suspicion.active or state.estimator.doubts:
        return
    for _ in range(_BLOCKS_PER_EPOCH):
        if suspicion.at >= history.count:
            fusion = state.gyros
            if suspicion.kind == ACCELEROMETERS:
                fusion = state.accelerometers
            _tell(state, fusion)
            suspicion.active = False
            return
        _carry(state)
