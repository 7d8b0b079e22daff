"""The parity of redundant sensors: what they measure and no vector explains.

The residual ``e = P z`` with ``P = I - H G`` lies in the space of parities, whatever the vector.
Its component i over the root of ``P[i, i]`` is the parity vector along the direction in which a
fault of sensor i moves it: the statistic of the generalised likelihood test. Daly, Gai and
Harrison, "Generalized Likelihood Test for FDI in Redundant Sensor Configurations", *Journal of
Guidance and Control* 2 (1979). With four sensors there is one direction, and all four agree.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.records.memory import Fusion
from rrins.firmware_py.core.records.redundancy_records import (
    ABSOLUTE,
    EPOCH_LEVELS,
    OUTER_TURN,
    REGRESSORS,
    SECOND_LEVELS,
    WINDOWS_S,
    Parity,
    Sums,
)
from rrins.firmware_py.core.redundancy import learning
from rrins.firmware_py.core.sensors import fusion as least_squares

LEARNED_S = 10
"""Seconds to learn from before windows shorter than a second are tested."""

_PATIENCE_S = 5
"""Seconds after which an eighth of a second's epochs suffice instead of half: fewer mean less noise
than the variances say, and a fault that shows less."""

_BLIND_S = 10
"""Seconds without even that after which nothing counts as compared."""

_SINGLE = 4
"""Sensors of which all have the same parity, but for its unit: three explain any three."""

CHECKED_FROM = 1e-6
"""Share of a fault that has to reach the parity; below, the sensor is not checked."""


@compiled
def compare(parity: Parity, fusion: Fusion, sensors: int, second_epochs: int, work: Floats) -> None:
    """Compare a set of sensors, one bit each, from now on; forgets what was learned of others."""
    parity.sensors = sensors
    parity.redundant = False
    parity.lost_epochs = 0
    parity.learning = False
    if sensors != fusion.used:
        least_squares.prepare(fusion, sensors, work)
    count = fusion.count
    for i in range(count):
        for j in range(count):
            along = 0.0
            for axis in range(3):
                along += fusion.H[i, axis] * fusion.gain[axis, j]
            used = fusion.solvable and sensors >> i & 1 and sensors >> j & 1
            parity.projector[i, j] = (1.0 if i == j else 0.0) - along if used else 0.0
        own = parity.projector[i, i]
        for axis in range(3):
            parity.leave_out[i, axis] = 0.0
        if fusion.solvable and own > CHECKED_FROM:
            parity.redundant = True
            for axis in range(3):
                parity.leave_out[i, axis] = -fusion.gain[axis, i] / own
    parity.redundancy_left = parity.redundant
    used = 0
    for i in range(count):
        used += sensors >> i & 1
    parity.is_single = used == _SINGLE
    parity.levels = 1
    while parity.levels < EPOCH_LEVELS and 1 << parity.levels < second_epochs:
        parity.levels += 1
    set_variances(parity, fusion, second_epochs)
    unit = parity.vector_learning_variance
    for i in range(count):
        if parity.projector[i, i] > CHECKED_FROM:
            unit = min(unit, parity.learning_variance[i])
    for learner in (parity.parity, parity.ahead):
        learning.forget_all(learner, unit)
    learning.forget_all(parity.expected, parity.vector_learning_variance)
    begin_again(parity)


@compiled
def spares(parity: Parity, fusion: Fusion, sensor: int) -> bool:
    """Return whether the sensors of this epoch span space without one of those compared, too."""
    if not fusion.solvable or fusion.used >> sensor & 1 == 0:
        return bool(fusion.solvable)
    whole = parity.redundant and fusion.used == parity.sensors
    return bool(whole and parity.projector[sensor, sensor] > CHECKED_FROM)


@compiled
def set_variances(parity: Parity, fusion: Fusion, second_epochs: int) -> None:
    """Find the variances of parities and fused vector for the present set of sensors."""
    _set_parity_variances(parity, fusion.count, second_epochs)
    _set_vector_variance(parity, fusion)


@compiled
def allow_for_gap(parity: Parity, fusion: Fusion, second_epochs: int) -> None:
    """Note that the present second goes on after a gap: sensors have counted on meanwhile.

    So each stretch between two gaps has the counts of a sum of its own. The variances allow for
    twice as many whenever there are more than before; never again for fewer.
    """
    parity.gaps += 1
    if parity.gaps <= parity.gaps_allowed:
        return
    more = 2 * parity.gaps - parity.gaps_allowed
    parity.gaps_allowed += more
    for k in range(fusion.count):
        parity.white_variance[k] += more * parity.quantisation_variance
    set_variances(parity, fusion, second_epochs)


@compiled
def is_full(parity: Parity, second_epochs: int) -> bool:
    """Return whether the present second has epochs enough to be closed; called once a second."""
    parity.open_s += 1
    shares = 2 if parity.open_s < _PATIENCE_S else 8
    full = shares * parity.used_epochs > second_epochs
    parity.redundancy_left = parity.redundant and (full or parity.open_s < _BLIND_S)
    return bool(full)


@compiled
def _set_vector_variance(parity: Parity, fusion: Fusion) -> None:
    """Find the largest variance of the fused vector's sum over a second."""
    parity.vector_variance = 0.0
    parity.vector_learning_variance = 0.0
    for axis in range(3):
        total, unstable = 0.0, 0.0
        for j in range(fusion.count):
            share = fusion.gain[axis, j] ** 2
            total += share * (parity.white_variance[j] + parity.quantisation_variance)
            unstable += share * parity.instability_variance[j]
        parity.vector_variance = max(parity.vector_variance, total)
        learned = learning.noise(parity.expected, total, unstable)
        parity.vector_learning_variance = max(parity.vector_learning_variance, learned)


@compiled
def _set_parity_variances(parity: Parity, count: int, second_epochs: int) -> None:
    """Find the variance of each parity, for each window."""
    for i in range(count):
        squares, white, unstable = 0.0, 0.0, 0.0
        for j in range(count):
            share = parity.projector[i, j] ** 2
            squares += share
            white += share * parity.white_variance[j]
            unstable += share * parity.instability_variance[j]
        counts = squares * parity.quantisation_variance
        parity.second_variance[i] = white + counts
        parity.learning_variance[i] = learning.noise(parity.parity, white + counts, unstable)
        for level in range(SECOND_LEVELS):
            drift = 0.0
            for j in range(count):
                drift += parity.projector[i, j] ** 2 * parity.drift_variance[j, level]
            parity.variance[i, level] = white * WINDOWS_S[level] + counts + drift
            if level == 0:
                parity.drift_second[i] = drift
        for level in range(EPOCH_LEVELS):
            share = (1 << level) / second_epochs
            drifted = parity.drift_second[i] * share * share
            parity.epoch_variance[i, level] = white * share + counts + drifted


@compiled
def inherit(parity: Parity, count: int) -> None:
    """Know of the sensors that are left what was known of all, and was not taken off them.

    Their parity is the projection of that of all, so a second fault is not learned as usual.
    """
    if not parity.redundant or parity.kept.seconds < LEARNED_S:
        return
    learner = parity.parity
    learning.copy(learner, parity.kept)
    for k in range(learner.coefficients.shape[1]):
        for i in range(count):
            total = 0.0
            for j in range(count):
                total += parity.projector[i, j] * learner.coefficients[j, k]
            parity.score[i] = total
        for i in range(count):
            learner.coefficients[i, k] = parity.score[i]
    learning.copy(parity.ahead, learner)
    parity.learning = True


@compiled
def begin_again(parity: Parity) -> None:
    """Begin all windows now."""
    parity.seconds = 0
    parity.fits_from = 0
    parity.ratio = 0.0
    parity.suspect = -1
    begin_second(parity)
    clear_levels(parity)
    parity.settled = 0
    parity.learned = 0
    for k in range(parity.learned_regressors.shape[0]):
        parity.learned_regressors[k] = 0.0
    _clear(parity.now)
    _clear(parity.fine[0])  # where the first windows begin
    _clear(parity.coarse[0])


@compiled
def _clear(sums: Sums) -> None:
    sums.leverage = 0.0
    sums.stretch = 0.0
    sums.vector_leverage = 0.0
    sums.turned = 0.0
    sums.square_variance = 0.0
    sums.standing = 0
    for i in range(sums.parity.shape[0]):
        sums.parity[i] = 0.0
        sums.residual[i] = 0.0
    for k in range(sums.regressors.shape[0]):
        sums.regressors[k] = 0.0
    for i in range(3):
        sums.vector[i] = 0.0


@compiled
def clear_levels(parity: Parity) -> None:
    """Begin all windows shorter than a second now."""
    parity.level_epochs = 0
    for level in range(EPOCH_LEVELS):
        for i in range(parity.residual.shape[0]):
            parity.level_sum[level, i] = 0.0
        for k in range(REGRESSORS):
            parity.level_begun[level, k] = 0.0
    for k in range(REGRESSORS):
        parity.summed_regressors[k] = 0.0


@compiled
def begin_second(parity: Parity) -> None:
    """Begin the sums of a second."""
    parity.used_epochs = 0
    parity.known_epochs = 0
    parity.closed_s = parity.open_s
    parity.open_s = 0
    parity.gaps = 0
    parity.peak = 0.0
    parity.turned = 0.0
    for i in range(parity.residual.shape[0]):
        parity.residual[i] = 0.0
    for k in range(parity.regressors.shape[0]):
        parity.regressors[k] = 0.0
    for i in range(3):
        parity.vector[i] = 0.0


@compiled
def regress(
    parity: Parity, fusion: Fusion, vector_s: Floats, other_s: Floats, outer_turn: float, dt: float
) -> int:
    """Write the regressors of an epoch; return their number.

    Time, the kind's own and the other vector, the outer axis' turn, and each sensor's input
    regardless of its sign.
    """
    regressors = parity.epoch_regressors
    regressors[0] = dt
    for i in range(3):
        regressors[1 + i] = vector_s[i]
        regressors[4 + i] = other_s[i]
    regressors[OUTER_TURN] = outer_turn
    for k in range(fusion.count):
        along = 0.0
        for i in range(3):
            along += fusion.H[k, i] * vector_s[i]
        regressors[ABSOLUTE + k] = abs(along)
    return ABSOLUTE + int(fusion.count)


@compiled
def take(
    parity: Parity,
    fusion: Fusion,
    measured: Floats,
    vector_s: Floats,
    regressors: int,
    counts: bool,
) -> float:
    """Take an epoch of all compared sensors; return the largest parity over its threshold.

    Tests the windows shorter than a second that end with this epoch. It `counts` if it goes into
    the sums of the second, too.
    """
    share = 1.0 if counts else 0.0
    parity.used_epochs += counts
    for k in range(REGRESSORS):  # faster than as many as there are: the others are zero
        parity.regressors[k] += share * parity.epoch_regressors[k]
        parity.summed_regressors[k] += parity.epoch_regressors[k]
    for i in range(fusion.count):
        if parity.sensors >> i & 1 == 0:
            continue
        residual = measured[i]
        for axis in range(3):
            residual -= fusion.H[i, axis] * vector_s[axis]
        learned = learning.expected(parity.parity, i, parity.epoch_regressors, regressors)
        parity.residual[i] += share * residual
        parity.unlearned[i] = residual - learned
        parity.level_sum[0, i] = residual - learned
    if parity.parity.seconds < LEARNED_S:
        clear_levels(parity)
        return 0.0
    return _test_levels(parity, fusion.count, regressors)


@compiled
def _test_levels(parity: Parity, count: int, regressors: int) -> float:
    """Test the windows that end here; return the largest parity over its threshold."""
    parity.level_epochs += 1
    level, largest = 0, 0.0
    threshold = parity.epoch_factor * parity.epoch_factor
    while True:
        square, variance = _most(parity, level, count, 0.0)
        if square > threshold * variance:  # what is not known of the learned part explains some
            begin, end = parity.level_begun[level], parity.summed_regressors
            uncertain = learning.spread(parity.parity, begin, end, regressors)
            square, variance = _most(parity, level, count, uncertain)
        if square > largest * variance:
            largest = square / variance
        last = level + 1 == parity.levels
        if not last:
            for i in range(count):
                parity.level_sum[level + 1, i] += parity.level_sum[level, i]
        for i in range(count):
            parity.level_sum[level, i] = 0.0
        for k in range(REGRESSORS):
            parity.level_begun[level, k] = parity.summed_regressors[k]
        level += 1
        if last:  # all windows begin here
            clear_levels(parity)
        if last or parity.level_epochs & ((1 << level) - 1) != 0:
            return math.sqrt(largest) / parity.epoch_factor


@compiled
def _most(parity: Parity, level: int, count: int, uncertain: float) -> tuple[float, float]:
    """Return the square and variance of a level's parity with the largest share of its variance.

    `uncertain` is in the learner's unit.
    """
    most, its_variance = 0.0, 1.0
    for i in range(count):
        if parity.projector[i, i] <= CHECKED_FROM:
            continue
        variance = parity.epoch_variance[i, level] + uncertain * parity.learning_variance[i]
        square = parity.level_sum[level, i] ** 2
        if variance > 0.0 and square * its_variance > most * variance:
            most, its_variance = square, variance
        if parity.is_single and variance > 0.0:
            break
    return most, its_variance
