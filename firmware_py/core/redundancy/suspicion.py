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
    FINE_LEVELS,
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

_CHANGES = 5.0
"""Standard deviations of the parity's noise from which on a fault has changed: it ends, or comes
and goes as the table turns."""

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
def _share(parity: Parity, level: int, k: int) -> float:
    """Return what a window's parity along a sensor's axis shows of a fault of 1, s."""
    return float(parity.projector[k, k] * WINDOWS_S[level])


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
        share = _share(parity, level, k)
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
def _follow_size(state: Ram, parity: Parity) -> None:
    """Tell the estimator by how much the biases of suspects may have changed with what is shown."""
    suspicion, kind = state.redundancy.suspicion, int(parity.kind)
    since_s = (state.epoch - suspicion.shown_epoch[kind]) // state.redundancy.second_epochs
    for level in range(FINE_LEVELS):
        if WINDOWS_S[level] > since_s or not windows.is_due(parity, level):
            return
        if not _has_changed(state, parity, level):
            continue
        _tell_change(state, parity, level)
        return


@compiled
def _has_changed(state: Ram, parity: Parity, level: int) -> bool:
    """Return whether a window shows another size of a suspect's fault than when it last changed."""
    suspicion, kind = state.redundancy.suspicion, int(parity.kind)
    for k in range(parity.residual.shape[0]):
        if suspicion.told[kind, k] > 0.0 and parity.projector[k, k] > CHECKED_FROM:
            change = parity.window_sum[level, k]
            change -= suspicion.shown[kind, k] * _share(parity, level, k)
            if abs(change) > _CHANGES * math.sqrt(parity.variance[k, level]):
                return True
    return False


@compiled
def _tell_change(state: Ram, parity: Parity, level: int) -> None:
    """Tell the estimator how large the fault is now, and by how much it has changed."""
    suspicion, estimator, kind = state.redundancy.suspicion, state.estimator, int(parity.kind)
    suspicion.shown_epoch[kind] = state.epoch
    for k in range(parity.residual.shape[0]):
        if suspicion.told[kind, k] > 0.0 and parity.projector[k, k] > CHECKED_FROM:
            share = _share(parity, level, k)
            shown = parity.window_sum[level, k] / share
            sigma = math.sqrt(parity.variance[k, level]) / share
            estimator.change[kind, k] = abs(shown - suspicion.shown[kind, k])
            estimator.changed_size[kind, k] = abs(shown) + _SURE * sigma
            suspicion.shown[kind, k] = shown


@compiled
def _suspect(state: Ram, parity: Parity, anew: bool) -> None:
    """Begin to carry what the suspects have done; not again within one fault: only its size."""
    suspicion, history = state.redundancy.suspicion, state.redundancy.repair
    longer = repair.longer(history, _since_s(state, parity)) if anew else 0
    suspicion.kind = parity.kind
    suspicion.anew = anew
    suspicion.active = True
    suspicion.at = history.count - longer
    suspicion.last = -1
    suspicion.begun_epoch = state.epoch - longer * state.redundancy.second_epochs
    for k in range(parity.residual.shape[0]):
        size = abs(suspicion.fault_size[parity.kind, k])
        before = 0.0 if anew else suspicion.told[parity.kind, k]
        suspicion.told[parity.kind, k] = max(size, before)
        suspicion.shown[parity.kind, k] = suspicion.value[parity.kind, k] if size > 0.0 else 0.0
    suspicion.shown_epoch[parity.kind] = state.epoch
    suspicion.height[:] = 0.0
    suspicion.x[:] = 0.0


@compiled
def _update(state: Ram, parity: Parity) -> None:
    """Look at a kind at the end of a second."""
    suspicion, kind = state.redundancy.suspicion, int(parity.kind)
    if not parity.redundant or suspicion.active:
        return
    anew = not lasts(state, kind)
    if not anew:
        _follow_size(state, parity)
    if not parity.alarm:
        return
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
        suspicion.last = state.redundancy.repair.count  # in which it may have begun
    suspicion.until[kind] = 0
    estimator.settles |= 1 << kind
    estimator.settled_sensor[kind] = sensor
    estimator.settled_value[kind] = suspicion.value[kind, sensor]
    estimator.settled_sigma[kind] = suspicion.sigma[kind, sensor]
    return aided


@compiled
def keep(state: Ram, parity: Parity, sensor: int) -> None:
    """Tell the estimator of a sensor that fails and is used, for it cannot be spared.

    It errs by as much as all sensors measure, at least, and in each second by something else.
    """
    vector, kind = state.dtheta_s, int(parity.kind)
    if kind == ACCELEROMETERS:
        vector = state.dv_s
    square = vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]
    dt = state.parameters.period_ns * 1e-9
    kept = state.estimator.kept_size
    kept[kind, sensor] = max(kept[kind, sensor], math.sqrt(square) / dt)


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
            if history.count <= suspicion.last:
                return
            fusion = state.gyros
            if suspicion.kind == ACCELEROMETERS:
                fusion = state.accelerometers
            _tell(state, fusion)
            suspicion.active = False
            return
        _carry(state)
