"""All sensors of a kind that are off alike, as a hypothesis of the bank.

With one direction v of parity, a residual r_k = v_k p: leaving sensor k out changes the vector by
``-g_k p / v_k``, g_k its column of the gain. The same fault b of all makes ``p = b sum(v)``, and
taking it off changes the vector by ``-b sum(g)``. As ``sum(v_k g_k) = 0``, that is the mean of what
leaving each out changes, weighted by v. So its size is known, as that of a single sensor's is.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.redundancy_records import Parity
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM

ALIKE = -2
"""In the place of the sensor that fails."""


@compiled
def largest(parity: Parity) -> int:
    """Return the compared sensor that shows most in the parity."""
    most = 0
    for k in range(parity.residual.shape[0]):
        if parity.projector[k, k] > parity.projector[most, most]:
            most = k
    return most


@compiled
def weigh(parity: Parity, weights: Floats) -> bool:
    """Write the weights of the mean; return whether a fault of all alike shows in the parity."""
    shown, total = largest(parity), 0.0
    for k in range(parity.residual.shape[0]):
        total += parity.projector[k, shown]
    if abs(total) <= CHECKED_FROM:
        return False
    for k in range(parity.residual.shape[0]):
        weights[k] = parity.projector[k, shown] / total
    return True


@compiled
def weight_of(sensor: int, weights: Floats, k: int) -> float:
    """Return how much of what leaving out sensor k changes a hypothesis changes."""
    if sensor == ALIKE:
        return float(weights[k])
    return 1.0 if sensor == k else 0.0


@compiled
def direct(parity: Parity, sensor: int, weights: Floats, direction: Floats) -> int:
    """Write along which direction of s a hypothesis has the noise of a residual; return which."""
    if sensor >= 0:
        for axis in range(3):
            direction[axis] = parity.leave_out[sensor, axis]
        return sensor
    shown = largest(parity)
    for axis in range(3):
        direction[axis] = 0.0
        for k in range(parity.residual.shape[0]):
            part = weights[k] * parity.projector[k, shown] / parity.projector[shown, shown]
            direction[axis] += part * parity.leave_out[k, axis]
    return shown
