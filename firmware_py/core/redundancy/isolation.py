"""Which sensors fail: those whose fault alone explains what is seen.

Hypotheses: one sensor, two, or all alike; a motion of the vehicle, or a table that is not true,
which only all sensors together show. Under each, some residuals have an unknown mean, and all else
is noise. With the residuals r over a window and their covariance R, the largest likelihood ratio of
the sensors G against no fault is ``exp(T / 2)``, ``T = w' G (G' R⁻¹ G)⁻¹ G' w``, ``w = R⁻¹ r``.
Groves (2nd ed., 2013), section 17.4; Willsky, *Automatica* 12 (1976) 601.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import (
    FINE_LEVELS,
    OUTER_TURN,
    SECOND_LEVELS,
    SETTLED_S,
    WINDOWS_S,
    Parity,
)
from rrins.firmware_py.core.redundancy import windows
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM

RATIO = 2.0 * math.log(1e4)
"""Twice the logarithm of the likelihood ratio that decides."""

_REST = 5.0
"""Largest deviation of what the decision leaves unexplained, standard deviations of chi-square."""

MOTION = 2.0 * math.log(1e2)
"""By how much a sensor has to explain more, in chi-square, than a motion of the vehicle would, for
each dimension of the parity, as noise does in any of them.

A slight motion turns all sensors and leaves the parity alone; the fault of one shows in both. So
does whatever the table makes of the expectation."""

_SWAYS_S = 8
"""Seconds that fit neither a standstill nor a fault, after which the vehicle may lie on waves: then
a fault has to last, too."""

_CALM_S, _CLEAR = 30, 3.0 * RATIO
"""Seconds of standstill before which a fault has to be clearer, or to last: waves begin slowly."""

_LEAST = 1e-60
"""Of a variance that is zero: no noise, or an expectation without an error."""

_VECTOR = 3
"""Sensors that have no parity; two of one more cannot be spared."""


@compiled
def _explains(parity: Parity, i: int, k: int) -> float:
    """Return the chi-square that faults of two compared sensors explain; of one if they are equal.

    From `matrix`, R⁻¹, and `score`, w.
    """
    a, w = parity.matrix, parity.score
    if i == k:
        return float(w[i] * w[i] / a[i, i]) if a[i, i] > 0.0 else 0.0
    least = a[i, i] * a[k, k] - a[i, k] * a[i, k]
    if least <= CHECKED_FROM * a[i, i] * a[k, k]:
        return 0.0
    total = w[i] * w[i] * a[k, k] - 2.0 * w[i] * w[k] * a[i, k] + w[k] * w[k] * a[i, i]
    return float(total / least)


@compiled
def _explains_alike(parity: Parity, n: int) -> float:
    """Return the chi-square that the same fault of all compared sensors explains."""
    total, information, own = 0.0, 0.0, 0.0
    for i in range(n):
        total += parity.score[i]
        own += parity.matrix[i, i]
        for k in range(n):
            information += parity.matrix[i, k]
    return total * total / information if information > CHECKED_FROM * own else 0.0


@compiled
def _likeliest(parity: Parity, n: int, size: int) -> tuple[int, float]:
    """Return which one or two of the compared sensors explain most, one bit each, and how much."""
    sensors, most = 0, 0.0
    for i in range(n):
        for k in range(i, i + 1 if size == 1 else n):
            explained = _explains(parity, i, k)
            if (k > i or size == 1) and explained > most:
                sensors, most = 1 << i | 1 << k, explained
    return sensors, most


@compiled
def _rival(parity: Parity, n: int, sensors: int, two: bool) -> float:
    """Return the chi-square of the likeliest hypothesis by which not all of these sensors fail.

    With `two`, of two sensors, too.
    """
    most = _explains_alike(parity, n)
    for i in range(n):
        for k in range(i, n if two else i + 1):
            if sensors & ~(1 << i | 1 << k) != 0:
                most = max(most, _explains(parity, i, k))
    return most


@compiled
def _decide(
    parity: Parity, n: int, free: int, whole: float, by_motion: float, ratio: float
) -> tuple[int, float]:
    """Return which of the compared sensors fail, one bit each, and the chi-square they explain.

    0 where it is not clear: where another hypothesis, or a motion of the vehicle, which explains
    `by_motion` of the chi-square `whole`, explains nearly as much, by `ratio`, or much is left.
    The residuals have `free` degrees of freedom. Of fewer than three, any two sensors explain all.
    """
    for size in range(1, 3 if n > _VECTOR + 1 else 2):
        sensors, explained = _likeliest(parity, n, size)
        rest, left = whole - explained, free - size
        if left < 1 or rest - left > _REST * math.sqrt(2.0 * left):
            continue
        if explained - _rival(parity, n, sensors, free > 2) > ratio:
            wanted = MOTION * max(1, n - _VECTOR)
            return (sensors, explained) if explained - by_motion > wanted else (0, 0.0)
    return 0, 0.0


@compiled
def by_parity(parity: Parity, count: int) -> int:
    """Return the sensors that the parity alone points at, one bit each, 0 where it is not clear.

    Needs five sensors: with four, all explain the parity alike; two at once need six. In units of
    each sensor's own parity, the covariance of white noise is the projector's.
    """
    rank = 0.0
    for i in range(count):
        rank += parity.projector[i, i]
    for level in range(SECOND_LEVELS):
        if not windows.is_due(parity, level) or rank < 1.5:
            continue
        whole = 0.0
        for i in range(count):
            own = parity.projector[i, i]
            checked = own > CHECKED_FROM
            parity.score[i] = 0.0
            if checked:
                deviation = math.sqrt(windows.variance_of(parity, level, i))
                parity.score[i] = parity.window_sum[level, i] / deviation
            whole += own * parity.score[i] ** 2
            for k in range(count):
                both = checked and parity.projector[k, k] > CHECKED_FROM
                share = (
                    parity.projector[i, k] / math.sqrt(own * parity.projector[k, k])
                    if both
                    else 0.0
                )
                parity.matrix[i, k] = 1.0 if i == k else share
        sensors, explained = _decide(parity, count, round(rank), whole, 0.0, RATIO)
        if sensors != 0 and explained > parity.second_factor**2:
            return sensors
    return 0


@compiled
def _own_variance(parity: Parity, level: int, sensor: int) -> float:
    """Return the variance of a sensor's own noise over a window, with what was learned of it."""
    learned = parity.window_uncertain[level]
    return (
        parity.white_variance[sensor] * WINDOWS_S[level]
        + parity.drift_variance[sensor, level]
        + parity.quantisation_variance
        + learned * parity.learning_variance[sensor]
    )


@compiled
def left_by_motion(parity: Parity, count: int, level: int) -> float:
    """Return the least chi-square that no motion of the vehicle explains: that of the parity.

    Two lower bounds, the first exact if all sensors have the same noise, the second with four: a
    noisy sensor is in the parity of all.
    """
    squares, noisiest, single = 0.0, 0.0, 0.0
    for i in range(count):
        if parity.sensors >> i & 1:
            square = parity.window_sum[level, i] ** 2
            squares += square
            noisiest = max(noisiest, _own_variance(parity, level, i))
            if parity.projector[i, i] > CHECKED_FROM:
                single = max(single, square / windows.variance_of(parity, level, i))
    return max(squares / noisiest, single) if noisiest > 0.0 else 0.0


@compiled
def _expectation(parity: Parity, level: int) -> None:
    """Write the variance of what is expected of the vector over a window, by axis, into `axes`.

    The same in all directions, and what the table makes of it: an axis that is not square to the
    other shows about z when the other turns, as known so far; a wobble turns it by some of its
    size, an encoder by an error of the angles, which also mistakes the direction of a turn.
    """
    begin = windows.begin_of(parity, level)
    seconds = WINDOWS_S[level]
    alike = min(parity.frozen + 1, seconds)
    own = (parity.now.vector_leverage - begin.vector_leverage) * alike
    common = parity.expected_variance[level] + own * parity.vector_learning_variance
    common += (parity.tilt_error * seconds) ** 2
    turned = (parity.now.turned - begin.turned) ** 2
    net = (parity.now.regressors[OUTER_TURN] - begin.regressors[OUTER_TURN]) ** 2
    wobble = parity.wobble**2
    angle = parity.encoder_variance * (1.0 + parity.gaps_allowed * WINDOWS_S[level])
    across = wobble + angle * (2.0 + turned)
    parity.axes[0] = common + across
    parity.axes[1] = common + across
    along = begin.square_variance * net + wobble * turned + 2.0 * angle
    parity.axes[2] = common + along


@compiled
def _inverse_covariance(parity: Parity, fusion: Fusion, level: int) -> int:
    """Write the inverse covariance of all sensors' residuals over a window; return their number.

    Each sensor's own noise D, and what is not known of the expectation, A by axis: Woodbury's
    identity, ``R⁻¹ = D⁻¹ - D⁻¹ H (A⁻¹ + Hᵀ D⁻¹ H)⁻¹ Hᵀ D⁻¹``, as A may be larger by any factor.
    `score` is scratch.
    """
    _expectation(parity, level)
    H, axes, matrix, weight = fusion.H, parity.axes, parity.matrix, parity.score
    xx, yy, zz = 1.0 / (axes[0] + _LEAST), 1.0 / (axes[1] + _LEAST), 1.0 / (axes[2] + _LEAST)
    xy, yz, zx = 0.0, 0.0, 0.0
    for i in range(fusion.count):
        if parity.sensors >> i & 1:
            x, y, z = H[i, 0], H[i, 1], H[i, 2]
            w = 1.0 / (_own_variance(parity, level, i) + _LEAST)
            xx, yy, zz = xx + w * x * x, yy + w * y * y, zz + w * z * z
            xy, yz, zx = xy + w * x * y, yz + w * y * z, zx + w * z * x
            weight[i] = w
    l_x, l_z = xy / xx, zx / xx  # L D Lᵀ
    yy, yz, zz = max(yy - l_x * xy, _LEAST), yz - l_x * zx, zz - l_z * zx
    l_y = yz / yy
    zz = max(zz - l_y * yz, _LEAST)
    n = 0
    for i in range(fusion.count):
        if parity.sensors >> i & 1 == 0:
            continue
        x = weight[i] * H[i, 0]
        y = weight[i] * H[i, 1] - l_x * x
        z = weight[i] * H[i, 2] - l_z * x - l_y * y
        m = 0
        for j in range(fusion.count):
            if parity.sensors >> j & 1 == 0:
                continue
            along = H[j, 1] - l_x * H[j, 0]
            across = H[j, 2] - l_z * H[j, 0] - l_y * along
            common = x * H[j, 0] / xx + y * along / yy + z * across / zz
            matrix[n, m] = (weight[i] if n == m else 0.0) - weight[j] * common
            m += 1
        n += 1
    return n


@compiled
def _is_small(parity: Parity, fusion: Fusion, level: int, limit: float) -> bool:
    """Return whether the chi-square of the residuals is surely no larger than a limit.

    It is less than by each sensor's own noise alone. Writes the residuals, as `weigh` does.
    """
    _residuals(parity, fusion, level)
    n, last, most = 0, parity.matrix.shape[1] - 1, 0.0
    for i in range(fusion.count):
        if parity.sensors >> i & 1:
            own = _own_variance(parity, level, i) + _LEAST
            most += parity.matrix[n, last] ** 2 / own
            n += 1
    return most <= limit


@compiled
def _residuals(parity: Parity, fusion: Fusion, level: int) -> None:
    """Write the sums of the residuals of the compared sensors to the last column of `matrix`."""
    begin = windows.begin_of(parity, level)
    n = 0
    last = parity.matrix.shape[1] - 1
    for i in range(fusion.count):
        if parity.sensors >> i & 1:
            total = parity.window_sum[level, i]
            for axis in range(3):
                total += fusion.H[i, axis] * (parity.now.vector[axis] - begin.vector[axis])
            parity.matrix[n, last] = total
            n += 1


@compiled
def weigh(parity: Parity, fusion: Fusion, level: int) -> int:
    """Write the inverse covariance of the compared sensors' residuals, and these as last column.

    Over the window that ends now; into `matrix`. Returns the number of sensors.
    """
    _residuals(parity, fusion, level)
    return _inverse_covariance(parity, fusion, level)


@compiled
def _weighted(parity: Parity, n: int) -> float:
    """Write R⁻¹ r to `score`; return the chi-square of all residuals."""
    a, last, whole = parity.matrix, parity.matrix.shape[1] - 1, 0.0
    for i in range(n):
        parity.score[i] = 0.0
        for j in range(n):
            parity.score[i] += a[i, j] * a[j, last]
        whole += parity.score[i] * a[i, last]
    return whole


@compiled
def _sensors(parity: Parity, indices: int) -> int:
    """Return the sensors of some indices among the compared ones, one bit each."""
    n, sensors = 0, 0
    for i in range(parity.residual.shape[0]):
        if parity.sensors >> i & 1:
            sensors |= (indices >> n & 1) << i
            n += 1
    return sensors


@compiled
def standing(parity: Parity, fusion: Fusion, moved: bool, slow: bool, at_once: bool) -> int:
    """Return the sensors that fail while the vehicle stands, one bit each; 0: none, or unclear.

    Of windows of up to 128 s; the vehicle stood throughout and some time before. Three sensors have
    no parity that would tell a fault from a slight motion: there, it has to last, and the vehicle
    must not have `moved` since navigation began, for then the expectation errs, too. With a parity,
    it has to last and that to have an alarm once the vehicle has moved, for it may creep, and
    unless the navigated velocity says that it stands (`slow`): a smooth cruise looks the same. So
    it has to if an alarm has been there for some time already (not `at_once`): noise in one sensor
    and a slight motion look like another's fault now and then. If the vehicle has not stood for
    long it has to, or to be clearer; and if the sensor does not explain the alarm's seconds one by
    one, which it must if the vehicle has moved: it may have driven off. Of two that fail, the
    parity has to have an alarm in any case.
    """
    if (moved or not slow) and not parity.redundant:
        return 0
    found, is_apart = _standing(parity, fusion, RATIO)
    _note_unexplained(parity, fusion)
    if found == 0 or found != parity.persistent_sensors:
        parity.persistent = 0
    parity.persistent += found != 0
    parity.persistent_sensors = found
    if is_apart:
        parity.apart += 1
    elif found == 0:
        parity.apart = 0
    if at_once and parity.redundant and slow and not moved and parity.apart < _SWAYS_S:
        if parity.now.standing < _CALM_S:
            found, _ = _standing(parity, fusion, _CLEAR)
        if found & (found - 1) != 0:
            return found if parity.alarm else 0
        return 0 if _leaves_much(parity, int(fusion.count), found) else found
    lasts = parity.persistent > SETTLED_S and (parity.alarm or not parity.redundant)
    if not lasts or (moved and _leaves_much(parity, int(fusion.count), found)):
        return 0
    return found


@compiled
def _note_unexplained(parity: Parity, fusion: Fusion) -> None:
    """Add what each sensor alone leaves of the second that ends, in an alarm and a standstill."""
    if not parity.alarm or parity.now.standing == 0:
        parity.unexplained_free = 0
        parity.unexplained[:] = 0.0
    if not parity.alarm or not _stood(parity, 0):
        return
    n, k = weigh(parity, fusion, 0), 0
    whole = _weighted(parity, n)
    for i in range(fusion.count):
        if parity.sensors >> i & 1:
            parity.unexplained[i] += whole - _explains(parity, k, k)
            k += 1
    parity.unexplained_free += n - 1


@compiled
def _leaves_much(parity: Parity, count: int, sensors: int) -> bool:
    """Return whether it is a single sensor, and leaves much of the alarm's seconds unexplained.

    It may fail as it likes, but nothing else may show: another's noise, or a vehicle that begins to
    sway, shows in other directions each second, and looks like one sensor in some.
    """
    free = parity.unexplained_free
    for i in range(count):
        if sensors == 1 << i:
            return parity.unexplained[i] - free > _REST * math.sqrt(2.0 * free)
    return False


@compiled
def _stood(parity: Parity, level: int) -> bool:
    """Return whether a window ends now in which the vehicle stood, and some time before."""
    since = WINDOWS_S[level] + SETTLED_S
    return bool(windows.is_due(parity, level) and parity.now.standing >= since)


@compiled
def _is_contradicted(parity: Parity, fusion: Fusion, sensors: int) -> bool:
    """Return whether these compared sensors explain some window far worse than others do."""
    for level in range(FINE_LEVELS):
        if not _stood(parity, level):
            continue
        n = weigh(parity, fusion, level)
        _weighted(parity, n)
        first, second = -1, -1
        for i in range(n):
            if sensors >> i & 1:
                first, second = (i, i) if first < 0 else (first, i)
        most = _rival(parity, n, sensors, n > 2)
        if most - _explains(parity, first, second) > RATIO:
            return True
    return False


@compiled
def _standing(parity: Parity, fusion: Fusion, ratio: float) -> tuple[int, bool]:
    """Return the sensors that fail, and whether all are far from the expectation for seconds."""
    if parity.now.standing == 0:
        return 0, False
    factor, is_apart = parity.second_factor**2, False
    for level in range(FINE_LEVELS):
        if not _stood(parity, level) or _is_small(parity, fusion, level, factor):
            continue
        n = _inverse_covariance(parity, fusion, level)
        whole, by_motion = _weighted(parity, n), 0.0
        if whole <= factor:  # nothing explains more than there is
            continue
        if parity.redundant:
            by_motion = whole - left_by_motion(parity, int(fusion.count), level)
        sensors, explained = _decide(parity, n, n, whole, by_motion, ratio)
        if sensors != 0 and explained > factor:
            found = _sensors(parity, sensors)
            return (0 if _is_contradicted(parity, fusion, sensors) else found), False
        if WINDOWS_S[level] <= SETTLED_S:
            is_apart = is_apart or whole - n > factor + _REST * math.sqrt(2.0 * n)
    return 0, is_apart
