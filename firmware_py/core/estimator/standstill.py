"""Standing, as the sensors feel it: neither force nor attitude changes, and the speed is near zero.

Skog, Händel, Nilsson and Rantakokko, "Zero-velocity detection: an algorithm evaluation", *IEEE
Trans. Biomedical Engineering* 57 (2010) 2657: the variance of the specific force, and the rate. In
axes that do not turn with the table, both are those of the vehicle. A vehicle that glides at a
constant velocity feels the same, so the navigation must know that it is slow. Looked for where the
settings say so, and in the fine alignment of a vehicle that may move: there it is what aids.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.maths.attitude import multiply_transposed
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.estimator_records import VELOCITY
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import Ram

STEADY_S = 2
"""Seconds in a row without a change, after which the vehicle stands."""

_NOISE_RATIO = 1.5
"""Of the variance of a second, over that of the data sheet: 6 sigma at 100 Hz."""

_VIBRATION = 0.02
"""m/s², rms, of a vehicle that stands with its engine idling; driving shakes it ten times that."""

_TURN = math.radians(0.03)
"""rad in a second, of a vehicle that stands."""

_TURN_SIGMAS = 4.0
"""Of the gyros' noise, beyond that."""

_SLOW, _KNOWN = 0.1, 0.3
"""m/s: the speed of a vehicle that may stand, and how well it has to be known."""

_SPEED_SIGMAS = 3.0

_MOVING = int(InitialAttitude.SELF_ALIGNED_MOVING)
_TRANSFERRED = int(InitialAttitude.TRANSFERRED)


@compiled
def may_move(state: Ram) -> bool:
    """Return whether the vehicle may move while it aligns."""
    method = state.parameters.initial_attitude
    return method in (_MOVING, _TRANSFERRED)


@compiled
def _is_looked_for(state: Ram) -> bool:
    is_aligning = state.modes.mode == Mode.FINE_ALIGNMENT
    return state.estimator.detects_standing or (is_aligning and may_move(state))


@compiled
def begin(state: Ram) -> None:
    """Begin with the filter."""
    estimator = state.estimator
    estimator.standing = False
    estimator.steady_s = 0
    _begin_second(state)


@compiled
def _begin_second(state: Ram) -> None:
    estimator = state.estimator
    estimator.felt_square = 0.0
    estimator.felt_n[:] = 0.0
    multiply_transposed(estimator.body_n, state.ins.C_s_n, state.C_s_b)


@compiled
def note(state: Ram) -> None:
    """Add an epoch's velocity change."""
    estimator, C_s_n, dv_s = state.estimator, state.ins.C_s_n, state.dv_s
    if not _is_looked_for(state):
        return
    for i in range(3):
        felt = C_s_n[i, 0] * dv_s[0] + C_s_n[i, 1] * dv_s[1] + C_s_n[i, 2] * dv_s[2]
        estimator.felt_n[i] += felt
        estimator.felt_square += felt * felt


@compiled
def finish_second(state: Ram) -> None:
    """Judge the second that ends with this epoch; the filter stands at its end."""
    estimator = state.estimator
    if not _is_looked_for(state):
        estimator.standing = False
        return
    is_steady = _force_is_steady(state) and _attitude_is_steady(state) and _is_slow(state)
    estimator.steady_s = estimator.steady_s + 1 if is_steady else 0
    estimator.standing = estimator.steady_s >= STEADY_S
    _begin_second(state)


@compiled
def _force_is_steady(state: Ram) -> bool:
    estimator, count = state.estimator, state.estimator.second_epochs
    dt = state.parameters.period_ns * 1e-9
    square = estimator.felt_square
    for i in range(3):
        square -= estimator.felt_n[i] * estimator.felt_n[i] / count
    noise = _fused_noise(state, 1) * dt
    limit = _NOISE_RATIO * noise + (_VIBRATION * dt) ** 2
    return bool(square < 3.0 * (count - 1) * limit)


@compiled
def _attitude_is_steady(state: Ram) -> bool:
    estimator, before = state.estimator, state.estimator.body_n
    multiply_transposed(estimator.C_b_n, state.ins.C_s_n, state.C_s_b)
    now, square = estimator.C_b_n, 0.0
    for i in range(3):
        one, two = (i + 1) % 3, (i + 2) % 3
        turn = 0.0
        for k in range(3):
            turn += now[two, k] * before[one, k] - now[one, k] * before[two, k]
        square += 0.25 * turn * turn
    limit = _TURN + _TURN_SIGMAS * math.sqrt(3.0 * _fused_noise(state, 0))
    limit += 2.0 * math.radians(state.encoders.step_deg)
    return bool(square < limit * limit)


@compiled
def _is_slow(state: Ram) -> bool:
    estimator, P = state.estimator, state.estimator.P
    sigma = math.sqrt(max(0.0, P[VELOCITY, VELOCITY] + P[VELOCITY + 1, VELOCITY + 1]))
    speed = math.hypot(estimator.velocity_n[0], estimator.velocity_n[1])
    return bool(sigma < _KNOWN and speed < max(_SLOW, _SPEED_SIGMAS * sigma))


@compiled
def _fused_noise(state: Ram, kind: int) -> float:
    """Return the variance that white noise adds to a component of the fused vector in a second."""
    estimator, fusion, total = state.estimator, state.gyros, 0.0
    if kind == 1:
        fusion = state.accelerometers
    for k in range(fusion.count):
        share = 0.0
        for i in range(3):
            share += fusion.gain[i, k] * fusion.gain[i, k] / 3.0
        total += share * estimator.white_variance[kind, k]
    return float(total)
