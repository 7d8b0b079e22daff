"""How likely the faults are by all that the innovations show, and what outweighs all others.

While the fault of a device explains why its own measurements are refused, and all other faults,
and none, are less likely by more than their share of the risk, these measurements say nothing of
the others: the device may have failed, and besides it another part.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import doubt
from rrins.firmware_py.core.estimator.fault_effects import (
    channel_at_fault,
    channel_of,
    device_of,
    evidence,
    explains,
)
from rrins.firmware_py.core.records.estimator_records import AIDS, COMPONENTS
from rrins.firmware_py.core.records.integrity_records import (
    AGES,
    CHANNELS,
    DEVICES,
    FAULT_CAPACITY,
    SINCE_BEGIN,
    Effect,
    Fault,
    Integrity,
    Verdict,
)
from rrins.firmware_py.core.records.memory import Ram

LONGEST_S = 24 * 3600.0
"""For which a fault may have lasted unseen."""

_NONE, _ASKED, _OPEN = int(Verdict.NONE), int(Verdict.ASKED), int(Verdict.OPEN)
_OWN_FAULT, _PASSED = int(Verdict.OWN_FAULT), int(Verdict.PASSED)


@compiled
def rivals(integrity: Integrity, number: int) -> float:
    """Return 2 ln of how much likelier another fault of the channel is, where that is certain."""
    channel = channel_at_fault(number)
    if channel < 0 or integrity.verdicts[device_of(channel)] != _OWN_FAULT:
        return 0.0
    return float(integrity.excess[channel])


@compiled
def odds_of(integrity: Integrity, fault: Fault, age: int) -> float:
    """Return twice the logarithm of a fault's probability over its share of the risk, so far."""
    odds = float(fault.odds[age])
    if age == SINCE_BEGIN:
        odds += 2.0 * math.log(min(1.0, max(1, integrity.seconds) / LONGEST_S))
    return odds


@compiled
def believed(integrity: Integrity, effect: Effect, number: int) -> tuple[float, float]:
    """Return information and correlation, less what is refused for another fault."""
    information, correlation = float(effect.information), float(effect.correlation)
    own = channel_at_fault(number)
    for channel in range(CHANNELS):
        verdict = integrity.verdicts[device_of(channel)]
        if verdict <= _OPEN or (channel == own and verdict != _PASSED):
            information += effect.refused_information[channel]
            correlation += effect.refused_correlation[channel]
    return information, correlation


@compiled
def _weight(integrity: Integrity, number: int, by_explaining: bool) -> float:
    """Return the same as `odds_of`, by all innovations, of the most likely time of a fault.

    With `by_explaining`, of a fault that leaves no more of the innovations than noise.
    """
    fault, most = integrity.faults[number], -math.inf
    for age in range(AGES):
        effect = fault.effects[age]
        information, correlation = evidence(effect)
        if information <= 0.0 or (by_explaining and not explains(effect)):
            continue
        weight = odds_of(integrity, fault, age) + correlation * correlation / information
        if fault.known > 0.0:
            weight -= math.log(information / fault.known)
        most = max(most, weight)
    return most


@compiled
def _weigh_devices(integrity: Integrity) -> None:
    """Find how far the likeliest fault of each channel that explains it is beyond certain."""
    for number in range(FAULT_CAPACITY):
        channel = channel_at_fault(number)
        if channel >= 0 and integrity.faults[number].present:
            beyond = _weight(integrity, number, True) - integrity.certain
            integrity.excess[channel] = max(integrity.excess[channel], beyond)


@compiled
def _outweighs(integrity: Integrity, device: int) -> bool:
    """Return whether the faults of a device, one of each channel, outweigh all others."""
    own, others = 0.0, float(integrity.certain)
    for channel in range(CHANNELS):
        if device_of(channel) == device:
            own += integrity.excess[channel]
    for aid in range(AIDS):
        for component in range(COMPONENTS):
            channel = channel_of(aid, component)
            refused = integrity.owed[aid, component] > 0
            if refused and device_of(channel) == device and integrity.excess[channel] == 0.0:
                return False
    for number in range(FAULT_CAPACITY):
        is_its_own = device_of(channel_at_fault(number)) == device
        if integrity.faults[number].present and not is_its_own:
            others = max(others, _weight(integrity, number, False))
    return own > others


@compiled
def weigh(state: Ram) -> None:
    """Find which devices fail for certain: not while a sensor may, or has lately.

    What a sensor's fault has left of the navigation may look like a device's.
    """
    integrity, redundancy = state.integrity, state.redundancy
    integrity.excess[:] = 0.0
    if not integrity.verdicts.any():
        return
    _weigh_devices(integrity)
    alarm = redundancy.gyros.alarm or redundancy.accelerometers.alarm
    in_doubt = alarm or doubt.explains(state.estimator, state.epoch)
    for device in range(DEVICES):
        verdict = integrity.verdicts[device]
        if verdict == _ASKED and not in_doubt and _outweighs(integrity, device):
            integrity.verdicts[device] = _OWN_FAULT
        elif verdict == _ASKED or (verdict != _NONE and in_doubt):
            integrity.verdicts[device] = _OPEN
