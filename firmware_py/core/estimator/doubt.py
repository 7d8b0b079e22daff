"""The possible effect of a faulty sensor, in the covariance until the sensor is known.

From the alarm on each suspect's bias has jumped by an unknown amount: its variance grows by the
square of the size, and what the jump has done to the navigation since it began is added along its
direction. Where measurements have aided meanwhile, what they left of the effect goes no longer with
the bias, so both are added apart. Once a sensor is left out, the others' biases are what they were
before the fault. That is taken as a measurement which leaves of their variance what it would be
without the doubt, and its correlations undo the fault's effect on the navigation; where nothing
aided, the history is repaired and the term goes as it came. Heights of an altimeter correct the
vertical channel alone meanwhile, and what the term has to do with it. Willsky and Jones, *IEEE
Transactions on Automatic Control* 21 (1976) 108, on jumps of unknown size in a Kalman filter.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.estimator import covariance
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    PAST,
    PAST_S,
    VELOCITY,
    Estimator,
)
from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.core.records.redundancy_records import ACCELEROMETERS, GYROS

_VARIES, _AT_ENDS_S = 0.1, 2.0
"""Of a fault's size: by how much it may differ from what the parity showed last; and for how long
it may have acted less, in the seconds in which it began and was left out."""

_ANOTHER = 0.5
"""Change of a fault, in its size then, from which on it is another one."""

_MOST_LEFT, _FIXES, _SLOW = 3.0, 36, 0.1
"""Standard deviations of the mean of as many measurements, at most, that an error may have which
they did not show; and m/s, of the velocity that odometer or zero velocity measure."""

UNKNOWN = math.pi / math.sqrt(3.0)
"""rad, standard deviation of an angle of which nothing is known."""

_JOLT_S = 3
"""Seconds for which a measurement may cover the time at which a fault was told, or settled."""

EXPLAINS_S = 200
"""Seconds after a doubt or its end in which it explains why a measurement is rejected."""


@compiled
def begin(estimator: Estimator) -> None:
    """Begin with the filter, without doubt."""
    estimator.doubts = False
    estimator.settles = 0
    estimator.past_count = 0
    estimator.jolt = 0.0
    estimator.doubted_epoch = -1
    estimator.unaided[:] = 0
    estimator.doubt_variance[:] = 0.0
    estimator.change[:] = 0.0
    estimator.kept_size[:] = 0.0
    estimator.kept_before[:] = 0.0


@compiled
def _first(state: Ram, kind: int) -> tuple[int, int]:
    """Return the first state of a kind's biases, and their number."""
    gyros, accelerometers = int(state.gyros.count), int(state.accelerometers.count)
    return (BIASES, gyros) if kind == GYROS else (BIASES + gyros, accelerometers)


@compiled
def _fed(estimator: Estimator, kind: int, k: int) -> float:
    """Return the bias that a sensor is corrected by."""
    biases = estimator.gyro_bias
    if kind == ACCELEROMETERS:
        biases = estimator.accelerometer_bias
    return float(biases[k])


@compiled
def note_past(state: Ram) -> None:
    """Keep the biases and their variance now and then, for a fault that is found late."""
    estimator = state.estimator
    if estimator.history_count % PAST_S != 0:
        return
    at = estimator.past_count % PAST
    estimator.past_count += 1
    estimator.past_epoch[at] = state.epoch
    for kind in range(2):
        first, count = _first(state, kind)
        for k in range(count):
            estimator.past_bias[at, kind, k] = _fed(estimator, kind, k) + estimator.x[first + k]
            estimator.past_variance[at, kind, k] = estimator.P[first + k, first + k]


@compiled
def _past_at(estimator: Estimator, epoch: int) -> int:
    """Return where what was known before an epoch is kept."""
    oldest = max(0, estimator.past_count - PAST)
    number = int(estimator.past_count) - 1
    while number > oldest and estimator.past_epoch[number % PAST] > epoch:
        number -= 1
    return max(0, number) % PAST


@compiled
def _recall(state: Ram, kind: int, epoch: int) -> None:
    """Write what was known of a kind's biases before an epoch."""
    estimator = state.estimator
    at = _past_at(estimator, epoch)
    first, count = _first(state, kind)
    for k in range(count):
        walked = estimator.walk_variance[kind, k] * PAST_S
        estimator.bias_before[kind, k] = estimator.past_bias[at, kind, k]
        variance = estimator.past_variance[at, kind, k] + walked
        estimator.variance_before[kind, k] = max(variance, estimator.P[first + k, first + k])
        estimator.doubt_variance[kind, k] = 0.0


@compiled
def _along(state: Ram, kind: int, k: int, sign: float) -> None:
    """Add or take away the term of a suspect whose jump and effect go together."""
    estimator, P = state.estimator, state.estimator.P
    first, _ = _first(state, kind)
    effect, size = estimator.jump_effect[kind, k], estimator.jump_size[kind, k]
    for i in range(BIASES):
        for j in range(BIASES):
            P[i, j] += sign * effect[i] * effect[j]
        P[i, first + k] += sign * effect[i] * size
        P[first + k, i] = P[i, first + k]
    P[first + k, first + k] += sign * size * size


@compiled
def _left(state: Ram, effect: Floats) -> float:
    """Return how much of an effect on velocity and position sound measurements may have left."""
    estimator = state.estimator
    speed, way = _SLOW, math.inf
    if state.gnss.available:
        speed, way = estimator.fix_sigma[1], estimator.fix_sigma[0]
    fast = math.hypot(effect[VELOCITY], effect[VELOCITY + 1])
    far = math.hypot(
        effect[LATITUDE] * estimator.north_radius, effect[LONGITUDE] * estimator.east_radius
    )
    seconds = (state.epoch - estimator.doubt_epoch) / estimator.second_epochs
    most = _MOST_LEFT / math.sqrt(min(_FIXES, max(1.0, seconds)))
    return min(1.0, most * speed / max(fast, 1e-9), most * way / max(far, 1e-9))


@compiled
def tell(state: Ram) -> None:
    """Add what was told; the filter stands at the beginning of the second in work."""
    estimator, P = state.estimator, state.estimator.P
    estimator.doubts = False
    estimator.doubted_epoch = state.epoch
    kind = int(estimator.doubt_kind)
    first, count = _first(state, kind)
    if estimator.doubt_anew:
        estimator.told_epoch[kind] = state.epoch
        estimator.jolt = 0.0
        _recall(state, kind, estimator.doubt_epoch)
        estimator.unaided[kind] = int(estimator.aided_epoch < estimator.doubt_epoch)
    if kind == ACCELEROMETERS:
        for k in range(count):
            estimator.jolt = max(estimator.jolt, abs(estimator.doubt_size[k]))
    for k in range(count):
        size, effect = estimator.doubt_size[k], estimator.doubt_effect[k]
        more = size * size - estimator.doubt_variance[kind, k]
        if more <= 0.0:
            continue
        if not estimator.vertical:
            effect[VELOCITY + 2] = 0.0
            effect[HEIGHT] = 0.0
        if not estimator.unaided[kind]:
            share = _left(state, effect)
            for i in range(BIASES):
                if i >= VELOCITY:
                    effect[i] *= share
            for i in range(BIASES):
                for j in range(BIASES):
                    if (i < VELOCITY) == (j < VELOCITY):
                        P[i, j] += effect[i] * effect[j]
            P[first + k, first + k] += more
        else:
            if not estimator.doubt_anew and estimator.jump_size[kind, k] != 0.0:
                _along(state, kind, k, -1.0)
                for i in range(BIASES):
                    larger = size / estimator.jump_size[kind, k]
                    effect[i] = larger * estimator.jump_effect[kind, k, i]
            copy(estimator.jump_effect[kind, k], effect)
            estimator.jump_size[kind, k] = size
            _along(state, kind, k, 1.0)
        estimator.doubt_variance[kind, k] = size * size


@compiled
def propagate(state: Ram) -> None:
    """Carry the terms of suspects over the second, while nothing has aided since."""
    estimator, carried = state.estimator, state.estimator.gain
    for kind in range(2):
        if not estimator.unaided[kind]:
            continue
        if estimator.aided_epoch >= estimator.doubted_epoch:
            estimator.unaided[kind] = 0
            continue
        first, count = _first(state, kind)
        for k in range(count):
            effect, size = estimator.jump_effect[kind, k], estimator.jump_size[kind, k]
            for i in range(BIASES):
                total = estimator.transition[i, first + k] * size
                for j in range(BIASES):
                    total += estimator.transition[i, j] * effect[j]
                carried[i] = total
            for i in range(BIASES):
                effect[i] = carried[i]


@compiled
def change(state: Ram) -> None:
    """Let biases in doubt change as faults did; doubt those of sensors that cannot be spared."""
    for kind in range(2):
        first, count = _first(state, kind)
        for k in range(count):
            _follow_size(state, kind, k, first + k)
            _doubt_kept(state, kind, k, first + k)


@compiled
def _follow_size(state: Ram, kind: int, k: int, at: int) -> None:
    """Let a bias change by as much as the fault did.

    One that has become much larger or smaller, or has ended, is another one: the bias is what it
    was before, and that, and does not tell what the former has done. Where nothing has aided it
    waits for the history to be repaired.
    """
    estimator, changed = state.estimator, state.estimator.change[kind, k]
    estimator.change[kind, k] = 0.0
    if changed == 0.0 or estimator.unaided[kind]:
        return
    if changed > _ANOTHER * estimator.changed_size[kind, k]:
        _begin_anew(state, kind, k)
        return
    estimator.P[at, at] += changed * changed
    estimator.doubt_variance[kind, k] += changed * changed


@compiled
def _doubt_kept(state: Ram, kind: int, k: int, at: int) -> None:
    """Know nothing of the bias of a sensor that fails and is used, nor of what it did at first.

    Once it is sound again, the bias is what it was.
    """
    estimator, P = state.estimator, state.estimator.P
    kept, before = estimator.kept_size[kind, k], estimator.kept_before[kind, k]
    estimator.kept_size[kind, k] = 0.0
    estimator.kept_before[kind, k] = kept
    if kept == 0.0:
        if before > 0.0:
            _reset(state, kind, k, estimator.kept_bias[kind, k], estimator.kept_variance[kind, k])
        return
    estimator.doubted_epoch = state.epoch
    if before == 0.0:
        past = _past_at(estimator, state.epoch - 2 * estimator.second_epochs)
        estimator.kept_bias[kind, k] = estimator.past_bias[past, kind, k]
        estimator.kept_variance[kind, k] = estimator.past_variance[past, kind, k]
        into = ATTITUDE if kind == GYROS else VELOCITY
        for i in range(into, into + 3):
            P[i, i] += kept * kept
    P[at, at] = max(P[at, at], kept * kept)


@compiled
def _begin_anew(state: Ram, kind: int, k: int) -> None:
    """Know of a bias what was known before the fault, but for the fault's size now."""
    estimator, size = state.estimator, state.estimator.changed_size[kind, k]
    variance = estimator.variance_before[kind, k] + size * size
    _reset(state, kind, k, estimator.bias_before[kind, k], variance)
    estimator.doubt_variance[kind, k] = size * size


@compiled
def _reset(state: Ram, kind: int, k: int, bias: float, variance: float) -> None:
    """Know this of a bias, whatever has been found of it."""
    estimator, P, at = state.estimator, state.estimator.P, _first(state, kind)[0] + k
    estimator.x[at] = bias - _fed(estimator, kind, k)
    for i in range(estimator.states):
        P[at, i] = 0.0
        P[i, at] = 0.0
    P[at, at] = variance


@compiled
def take_height(estimator: Estimator, innovation: float, expected: float) -> bool:
    """Take an altimeter's height while terms wait; return whether one does.

    `covariance.expect` has looked at it. What is left of `gain` is what was corrected by.
    """
    if not (estimator.unaided[GYROS] or estimator.unaided[ACCELEROMETERS]):
        return False
    x, P, n, gain, row = estimator.x, estimator.P, estimator.states, estimator.gain, estimator.row
    up = VELOCITY + 2
    covariance.update_two(x, P, n, gain, innovation, expected, up, HEIGHT)
    for i in range(n):
        if i not in (up, HEIGHT):
            gain[i] = 0.0
    for kind in range(2):
        for k in range(estimator.jump_size.shape[1]):
            effect = estimator.jump_effect[kind, k]
            seen = (row[up] * effect[up] + row[HEIGHT] * effect[HEIGHT]) / expected
            effect[up] -= gain[up] * seen
            effect[HEIGHT] -= gain[HEIGHT] * seen
    return True


@compiled
def widen(state: Ram, scale: Floats) -> None:
    """Widen the terms as P is widened: by a factor for each state."""
    estimator = state.estimator
    for kind in range(2):
        first, count = _first(state, kind)
        for k in range(count):
            estimator.jump_size[kind, k] *= scale[first + k]
            for i in range(BIASES):
                estimator.jump_effect[kind, k, i] *= scale[i]


@compiled
def _repair_height(estimator: Estimator, kind: int, k: int) -> None:
    """Undo what heights have left of the fault's effect on the vertical channel."""
    share = estimator.settled_value[kind] / estimator.jump_size[kind, k]
    if estimator.altimeter:
        for i in (VELOCITY + 2, HEIGHT):
            estimator.x[i] += share * estimator.jump_effect[kind, k, i]


@compiled
def settle(state: Ram) -> None:
    """Take back what the doubt has let the filter learn: the fault was of one sensor alone."""
    estimator = state.estimator
    if estimator.doubts or state.redundancy.suspicion.active:
        return  # what is on its way comes first
    for kind in range(2):
        if estimator.settles >> kind & 1 == 0:
            continue
        _, count = _first(state, kind)
        for k in range(count):
            if estimator.doubt_variance[kind, k] == 0.0:
                continue
            if estimator.unaided[kind]:
                _along(state, kind, k, -1.0)
                if k == estimator.settled_sensor[kind]:
                    _repair_height(estimator, kind, k)
            elif k == estimator.settled_sensor[kind]:
                value = estimator.settled_value[kind]
                seconds = (state.epoch - estimator.told_epoch[kind]) / estimator.second_epochs
                varies = _VARIES + min(1.0, _AT_ENDS_S / max(1.0, seconds))
                spread = estimator.settled_sigma[kind] ** 2 + (varies * value) ** 2
                _remember(state, kind, k, value, spread)
            else:
                _remember(state, kind, k, 0.0, 0.0)
            estimator.doubt_variance[kind, k] = 0.0
        estimator.unaided[kind] = 0
    estimator.settles = 0
    estimator.doubted_epoch = state.epoch


@compiled
def _remember(state: Ram, kind: int, k: int, jump: float, spread: float) -> None:
    """Measure a bias by what it was before the fault, with its jump since and the jump's variance.

    A bias that has not jumped is then known as well as before.
    """
    estimator, at = state.estimator, _first(state, kind)[0] + k
    before, added = estimator.variance_before[kind, k], estimator.doubt_variance[kind, k]
    variance = before * (before + added) / added + spread
    row = estimator.row
    row[:] = 0.0
    row[at] = 1.0
    x, P, n = estimator.x, estimator.P, estimator.states
    innovation = estimator.bias_before[kind, k] + jump - _fed(estimator, kind, k) - x[at]
    expected = covariance.expect(P, n, row, variance, estimator.gain)
    covariance.update(x, P, n, estimator.gain, innovation, expected)


@compiled
def bend(state: Ram) -> None:
    """Add what the filter neglects of the correction that is due: the square of its turn.

    After a fault a turn may be of a degree; healthy, it is a thousandth of that.
    """
    estimator, P, x = state.estimator, state.estimator.P, state.estimator.x
    if not explains(estimator, state.epoch):
        return
    neglected = 0.5 * (x[ATTITUDE] ** 2 + x[ATTITUDE + 1] ** 2 + x[ATTITUDE + 2] ** 2)
    for i in range(3):
        known = P[ATTITUDE + i, ATTITUDE + i]
        P[ATTITUDE + i, ATTITUDE + i] += min(neglected**2, max(0.0, UNKNOWN**2 - known))


@compiled
def confine(estimator: Estimator) -> None:
    """Let no angle be less known than not at all; correlations stay, also those of `gain`."""
    P = estimator.P
    for i in range(ATTITUDE, ATTITUDE + 3):
        sigma = math.sqrt(P[i, i])
        if sigma > UNKNOWN:
            estimator.gain[i] *= UNKNOWN / sigma
            for k in range(estimator.states):
                P[i, k] *= UNKNOWN / sigma
                P[k, i] *= UNKNOWN / sigma


@compiled
def explains(estimator: Estimator, epoch: int) -> bool:
    """Return whether a sensor is, or was until lately, in doubt."""
    since = epoch - estimator.doubted_epoch
    return bool(estimator.doubted_epoch >= 0 and since <= EXPLAINS_S * estimator.second_epochs)


@compiled
def jolt(estimator: Estimator, epoch: int) -> float:
    """Return the change of force, m/s², that an accelerometer's fault has brought just now."""
    since = epoch - estimator.doubted_epoch
    is_new = estimator.doubted_epoch >= 0 and since <= _JOLT_S * estimator.second_epochs
    return float(estimator.jolt) if is_new else 0.0
