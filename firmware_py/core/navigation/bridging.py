"""Effect of bridging lost sensor data.

While data are missing, the navigation goes on with the increments of the previous epoch. Over a
gap of n epochs in which an increment changes by d, the sum of these is wrong by about n d / 2. The
squares are summed over all gaps, and the time bridged lately tells whether the navigation is
degraded.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import Bridging, Ram

DEGRADED_S = 1.0
"""More than this, bridged within about `MEMORY_S`, makes a degraded navigation."""

MEMORY_S = 100.0


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
    bridging.recent_s *= 1.0 - seconds / MEMORY_S
    if state.faults.consecutive_bridged > 0 and not ins.first:
        bridging.recent_s += seconds
        bridging.count += 1
        bridging.bridged_epochs += 1
        return
    if bridging.count > 0:
        for i in range(3):
            turn = state.dtheta_s[i] - ins.dtheta_s_previous[i]
            force = state.dv_s[i] - ins.dv_s_previous[i]
            bridging.angle_variance += (0.5 * bridging.count * turn) ** 2
            bridging.velocity_variance += (0.5 * bridging.count * force) ** 2
        bridging.count = 0
