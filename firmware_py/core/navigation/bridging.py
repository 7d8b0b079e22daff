"""Effect of bridging lost sensor data.

While data are missing, the navigation goes on with the increments of the previous epoch. Over a
gap of n epochs in which an increment changes by d, the sum of these is wrong by about n d / 2. The
squares are summed over all gaps, and the time bridged lately tells whether the navigation is
degraded. Where a turn begins, gap after gap errs the same way: the filter is told the largest
square that the gaps of each 20 s add up to.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import Bridging, Ram

DEGRADED_S = 1.0
"""More than this, bridged within about `MEMORY_S`, makes a degraded navigation."""

MEMORY_S = 100.0

_TURN_S = 20.0
"""In which a turn has begun and ended, or a wave has passed: so has what they cost."""


@compiled
def is_degraded(bridging: Bridging) -> bool:
    """Return whether so much has been bridged lately that the navigation is degraded."""
    return bridging.recent_s > DEGRADED_S


@compiled
def follow(state: Ram) -> None:
    """Count an epoch that is bridged, and what a gap may have cost at its end.

    Called before the navigation of each epoch.
    """
    bridging, ins = state.bridging, state.ins
    seconds = state.parameters.period_ns * 1e-9
    if ins.first:
        bridging.count = 0
        bridging.recent_s = 0.0
        bridging.bridged_epochs = 0
        bridging.angle_variance = 0.0
        bridging.velocity_variance = 0.0
        bridging.lag_variance[:] = 0.0
        _begin_turn(bridging)
    bridging.lag_epochs += 1
    if bridging.lag_epochs * seconds > _TURN_S:
        _begin_turn(bridging)
    bridging.recent_s *= 1.0 - seconds / MEMORY_S
    if state.faults.consecutive_bridged > 0 and not ins.first:
        bridging.recent_s += seconds
        bridging.count += 1
        bridging.bridged_epochs += 1
        return
    if bridging.count > 0:
        for i in range(3):
            turn = 0.5 * bridging.count * (state.dtheta_s[i] - ins.dtheta_s_previous[i])
            force = 0.5 * bridging.count * (state.dv_s[i] - ins.dv_s_previous[i])
            bridging.angle_variance += turn**2
            bridging.velocity_variance += force**2
            bridging.lag[0, i] += turn
            bridging.lag[1, i] += force
        _note_most(bridging)
        bridging.count = 0


@compiled
def _begin_turn(bridging: Bridging) -> None:
    bridging.lag_epochs = 0
    bridging.lag[:] = 0.0
    bridging.most[:] = 0.0


@compiled
def _note_most(bridging: Bridging) -> None:
    """Let the variances grow by what the largest square of late has grown."""
    for kind in range(2):
        square = 0.0
        for i in range(3):
            square += bridging.lag[kind, i] ** 2
        if square > bridging.most[kind]:
            bridging.lag_variance[kind] += square - bridging.most[kind]
            bridging.most[kind] = square
