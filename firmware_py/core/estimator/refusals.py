"""Measurements that are refused: what they have said of faults, until it is known who was wrong.

A device whose measurements agree again was wrong while it was refused, if a fault of it explained
what it said, and the navigation has not followed it: what that says of other faults is void. If it
agrees only because the navigation has moved, or its sigma has grown, it may have been right.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator.fault_effects import (
    KEPT_FROM,
    channel_of,
    device_of,
    keep,
    shown,
)
from rrins.firmware_py.core.records.estimator_records import AIDS, COMPONENTS
from rrins.firmware_py.core.records.integrity_records import (
    AGES,
    CHANNELS,
    DEVICES,
    FAULT_CAPACITY,
    SINCE_BEGIN,
    SUSPECT,
    Effect,
    Integrity,
    Verdict,
)

AGREES_AFTER = 10
"""Measurements within the gate, of each component that was refused."""

_AT_ONCE = 9.0
"""Square of the first normalised innovation within the gate, at most: an error of the navigation
comes back through the gate's edge."""

_NONE, _ASKED, _OPEN = int(Verdict.NONE), int(Verdict.ASKED), int(Verdict.OPEN)
_OWN_FAULT, _PASSED = int(Verdict.OWN_FAULT), int(Verdict.PASSED)


@compiled
def refuse(integrity: Integrity, aid: int, component: int, has_begun: bool) -> None:
    """Note a measurement beyond the gate: of a device that has just failed, it is another fault.

    What the device was refused for before is void if the fault `has_begun` there.
    """
    device = device_of(channel_of(aid, component))
    if device >= 0:
        if has_begun or integrity.verdicts[device] == _PASSED:
            forget(integrity, device)
        integrity.owed[aid, component] = AGREES_AFTER
        integrity.verdicts[device] = _ASKED


@compiled
def ask_again(integrity: Integrity, aid: int, component: int) -> None:
    """Ask whether a device fails for certain, until it has agreed often enough."""
    device = device_of(channel_of(aid, component))
    if integrity.owed[aid, component] > 0 and integrity.verdicts[device] == _OPEN:
        integrity.verdicts[device] = _ASKED


@compiled
def agree(integrity: Integrity, aid: int, component: int) -> None:
    """Note a measurement within the gate, of a device that may still be doubted."""
    device = device_of(channel_of(aid, component))
    owes = device >= 0 and integrity.owed[aid, component] > 0
    if owes and integrity.verdicts[device] == _OWN_FAULT:
        integrity.verdicts[device] = _PASSED


@compiled
def use(integrity: Integrity, aid: int, component: int, square: float) -> None:
    """Note a measurement that is used, with the square of its normalised innovation."""
    if integrity.owed[aid, component] == 0:
        return
    device = device_of(channel_of(aid, component))
    if integrity.owed[aid, component] == AGREES_AFTER and square > _AT_ONCE:
        if integrity.verdicts[device] != _OWN_FAULT:
            believe(integrity, device)
        return
    ask_again(integrity, aid, component)
    agree(integrity, aid, component)
    integrity.owed[aid, component] -= 1
    if not _is_owed(integrity, device):
        if integrity.verdicts[device] == _PASSED:
            forget(integrity, device)
        else:
            believe(integrity, device)


@compiled
def _is_owed(integrity: Integrity, device: int) -> bool:
    for aid in range(AIDS):
        for component in range(COMPONENTS):
            is_its_own = device_of(channel_of(aid, component)) == device
            if is_its_own and integrity.owed[aid, component] > 0:
                return True
    return False


@compiled
def _settle(integrity: Integrity, device: int) -> None:
    integrity.verdicts[device] = _NONE
    for aid in range(AIDS):
        for component in range(COMPONENTS):
            if device_of(channel_of(aid, component)) == device:
                integrity.owed[aid, component] = 0


@compiled
def _clear(effect: Effect, device: int) -> None:
    for channel in range(CHANNELS):
        if device_of(channel) == device:
            effect.refused_information[channel] = 0.0
            effect.refused_correlation[channel] = 0.0


@compiled
def believe(integrity: Integrity, device: int) -> None:
    """Let what a device's refused measurements have said count: they may have been right."""
    _settle(integrity, device)
    for k in range(FAULT_CAPACITY):
        for age in range(AGES):
            effect = integrity.faults[k].effects[age]
            for channel in range(CHANNELS):
                if device_of(channel) == device:
                    effect.information += effect.refused_information[channel]
                    effect.correlation += effect.refused_correlation[channel]
            _clear(effect, device)


@compiled
def believe_all(integrity: Integrity) -> None:
    """Let what all refused measurements have said count."""
    for device in range(DEVICES):
        believe(integrity, device)


@compiled
def forget(integrity: Integrity, device: int) -> None:
    """Forget what a device's refused measurements have said: it was the device that erred."""
    _settle(integrity, device)
    for k in range(FAULT_CAPACITY):
        for age in range(AGES):
            _clear(integrity.faults[k].effects[age], device)
        suspect = integrity.faults[k].effects[SUSPECT]
        if shown(suspect) < KEPT_FROM:  # it was kept for what is void now
            keep(suspect, integrity.faults[k].effects[SINCE_BEGIN])
