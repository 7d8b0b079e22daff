"""Scale factors and installation errors of the sensors as states, besides their biases.

Of each sensor λ, μ, δu, δv; paper, (13), (16), (17). With the increment Δ and the axes h, u, v of a
sensor, an error of each adds to what it measures::

    λ h·Δ + μ |h·Δ| - δu v·Δ - δv u·Δ

and its column of the least squares' gain brings that into the fused vector. What is linear in Δ
needs ``∫ C_s_n ⊗ Δ`` over a second, the same of all sensors of a kind. A common turn of all sensors
of both kinds is a turn of their frame: it cannot be found, and does no harm to the navigation.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.records.estimator_records import (
    ACROSS_U,
    ACROSS_V,
    ASYMMETRY,
    DONE,
    PRESENT,
    SCALE_FACTOR,
    SENSOR_CONSTANTS,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Fusion, Ram


@compiled
def state_of(state: Ram, error: int, kind: int, sensor: int) -> int:
    """Return the filter's state of an error of a sensor."""
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    group = state.estimator.constants_state + error * (gyros + accelerometers)
    return int(group + kind * gyros + sensor)


@compiled
def note(state: Ram) -> None:
    """Add an epoch to the sums of the present second."""
    fusion, moved = state.gyros, state.dtheta_s
    for kind in range(2):
        if kind == 1:
            fusion, moved = state.accelerometers, state.dv_s
        _note(state.estimator, state.ins.C_s_n, fusion, moved, kind)


@compiled
def _note(estimator: Estimator, C_s_n: Floats, fusion: Fusion, moved: Floats, kind: int) -> None:
    for i in range(3):
        for j in range(3):
            for m in range(3):
                estimator.moved_s[PRESENT, kind, i, j, m] += C_s_n[i, j] * moved[m]
    for k in range(fusion.count):
        H = fusion.H
        size = abs(H[k, 0] * moved[0] + H[k, 1] * moved[1] + H[k, 2] * moved[2])
        for i in range(3):
            for j in range(3):
                estimator.size_s[PRESENT, kind, k, i, j] += C_s_n[i, j] * size


@compiled
def close(estimator: Estimator) -> None:
    """Put the sums of the present second aside, and begin the next."""
    copy(estimator.moved_s[DONE], estimator.moved_s[PRESENT])
    estimator.moved_s[PRESENT] = 0.0
    copy(estimator.size_s[DONE], estimator.size_s[PRESENT])
    estimator.size_s[PRESENT] = 0.0


@compiled
def forget(estimator: Estimator) -> None:
    """Begin with unknown constants, and with no sums."""
    close(estimator)
    close(estimator)
    estimator.constant[:] = 0.0


@compiled
def _seen(estimator: Estimator, fusion: Fusion, kind: int, error: int, k: int, axis: int) -> float:
    """Return by what a unit of an error is multiplied in a component of Δ, along an axis of s."""
    if error == SCALE_FACTOR:
        return float(fusion.H[k, axis])
    across = 1 if error == ACROSS_U else 0
    return float(-estimator.transverse[kind, k, across, axis])


@compiled
def write_direction(estimator: Estimator, fusion: Fusion, kind: int, error: int, k: int) -> None:
    """Write to `direction` the integral of what a unit of an error adds in n."""
    for i in range(3):
        total = 0.0
        for j in range(3):
            amount = 0.0
            if error == ASYMMETRY:
                amount = estimator.size_s[DONE, kind, k, i, j]
            else:
                for m in range(3):
                    seen = _seen(estimator, fusion, kind, error, k, m)
                    amount += estimator.moved_s[DONE, kind, i, j, m] * seen
            total += amount * fusion.gain[j, k]
        estimator.direction[i] = total


@compiled
def remove(estimator: Estimator, fusion: Fusion, kind: int, fused: Floats) -> None:
    """Remove what the estimated errors have added to a fused vector, to first order."""
    row, H, across = SENSOR_CONSTANTS * kind, fusion.H, estimator.transverse
    x, y, z = fused[0], fused[1], fused[2]
    for k in range(fusion.count):
        along = H[k, 0] * x + H[k, 1] * y + H[k, 2] * z
        by_u = across[kind, k, 0, 0] * x + across[kind, k, 0, 1] * y + across[kind, k, 0, 2] * z
        by_v = across[kind, k, 1, 0] * x + across[kind, k, 1, 1] * y + across[kind, k, 1, 2] * z
        added = estimator.constant[row + SCALE_FACTOR, k] * along
        added += estimator.constant[row + ASYMMETRY, k] * abs(along)
        added -= estimator.constant[row + ACROSS_U, k] * by_v
        added -= estimator.constant[row + ACROSS_V, k] * by_u
        for i in range(3):
            fused[i] -= fusion.gain[i, k] * added
