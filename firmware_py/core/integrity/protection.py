"""Bounds of the error for a stated risk, at the end of each second, once the filter stands there.

Without a fault the error is Gaussian with the filter's variance σ². Under a fault with the effect s
of size 1, of whose size parity and innovations say ``ρ / I`` with the variance ``1 / I``, it is off
by ``s ρ / I``, with the variance ``σ² + s² / I``, and the fault is ``exp(ρ² / 2 I)`` times as
likely as it was before. The bound is the largest of all hypotheses, each for its share of the
risk, with ``2 Q(K) <= exp(-K² / 2)``: multiple hypothesis solution separation, where ``s ρ / I`` is
by how much the solution with the fault estimated differs from the one in use. Blanch et al., *IEEE
Transactions on Aerospace and Electronic Systems* 51 (2015) 713; Brown and McBurney, *NAVIGATION* 35
(1988) 41; NAVIGATION 70 (2023) navi.612.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.record import Floats
from rrins.dbc.contract import SENSOR_GROUPS
from rrins.firmware_py.core.estimator.fault_effects import AGREES_BELOW, FIRST_AID, FIRST_SHIFT
from rrins.firmware_py.core.integrity.weights import believed, odds_of, rivals, weigh
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.records.encoder_records import AngleSource
from rrins.firmware_py.core.records.estimator_records import (
    AIDS,
    ATTITUDE,
    ESTIMATOR_HISTORY_S,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
)
from rrins.firmware_py.core.records.integrity_records import (
    AGES,
    AT_BEGIN,
    BOUNDS,
    HEADING,
    HORIZONTAL,
    SINCE_BEGIN,
    TABLE_FAULT,
    VERTICAL,
    Integrity,
    IntegrityStatus,
)
from rrins.firmware_py.core.records.memory import INNER, OUTER, Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import SECOND_LEVELS, WINDOWS_S, Parity
from rrins.firmware_py.core.redundancy import windows
from rrins.firmware_py.core.redundancy.alike import largest
from rrins.firmware_py.core.redundancy.parity import CHECKED_FROM
from rrins.firmware_py.core.turntable import encoders

SHOWS_FROM = 6.0
"""Standard deviations of the size of a fault from which on it is suspected."""

_SEEN = 1.1
"""Information on the size of a fault, over what is assumed of it, from which on it would show."""

_SPAN = 3
"""Sensors that span space: more are redundant."""

_IDLE_S = 2
"""Seconds without a comparison after which the parity shows nothing new."""

_GYROS = int(AngleSource.GYROS)
_AVAILABLE, _DEGRADED = int(IntegrityStatus.AVAILABLE), int(IntegrityStatus.DEGRADED)
_NOT_AVAILABLE, _OFF = int(IntegrityStatus.NOT_AVAILABLE), int(IntegrityStatus.OFF)


@compiled
def _sigma(state: Ram, bound: int) -> float:
    """Return the standard deviation of the error without a fault; horizontally the larger axis."""
    estimator, P = state.estimator, state.estimator.P
    if bound == VERTICAL:
        return math.sqrt(max(0.0, P[HEIGHT, HEIGHT]))
    if bound == HEADING:
        return math.sqrt(max(0.0, P[ATTITUDE + 2, ATTITUDE + 2]))
    north, east = estimator.north_radius, estimator.east_radius
    along = P[LATITUDE, LATITUDE] * north * north
    across = P[LONGITUDE, LONGITUDE] * east * east
    both = P[LATITUDE, LONGITUDE] * north * east
    half = 0.5 * (along - across)
    return math.sqrt(max(0.0, 0.5 * (along + across) + math.sqrt(half * half + both * both)))


@compiled
def _size(state: Ram, error: Floats, bound: int) -> float:
    """Return how large an error of the filter's states is along a bound."""
    estimator = state.estimator
    if bound == VERTICAL:
        return abs(error[HEIGHT])
    if bound == HEADING:
        return abs(error[ATTITUDE + 2])
    return math.hypot(
        error[LATITUDE] * estimator.north_radius, error[LONGITUDE] * estimator.east_radius
    )


@compiled
def _parity_shows(integrity: Integrity, parity: Parity, kind: int) -> bool:
    """Return whether the parity of a kind has taken a second of late, and shows faults."""
    if parity.seconds == integrity.compared[kind]:
        integrity.idle_s[kind] += 1
    else:
        integrity.idle_s[kind] = 0
    integrity.compared[kind] = parity.seconds
    return bool(parity.redundant and integrity.idle_s[kind] < _IDLE_S)


@compiled
def _from_parity(parity: Parity, sensor: int, seconds: int) -> tuple[float, float]:
    """Return information and correlation of the parity with a fault, as of the innovations.

    The fault has lasted for `seconds`: by the longest window that it fills. -1: of all sensors
    alike, in the residual of that which shows most.
    """
    own = 0.0
    if sensor >= 0:
        own = parity.projector[sensor, sensor]
    else:
        sensor = largest(parity)
        for k in range(parity.residual.shape[0]):
            own += parity.projector[sensor, k]
    if abs(own) <= CHECKED_FROM:
        return 0.0, 0.0
    for back in range(SECOND_LEVELS):
        level = SECOND_LEVELS - 1 - back
        if WINDOWS_S[level] > seconds or parity.seconds < WINDOWS_S[level]:
            continue
        variance, along = windows.variance_of(parity, level, sensor), own * WINDOWS_S[level]
        if variance > 0.0:
            return along * along / variance, along * parity.window_sum[level, sensor] / variance
    return 0.0, 0.0


@compiled
def _from_constant(parity: Parity, sensor: int) -> tuple[float, float]:
    """Return the same of a fault at the beginning: by what was learned to be the sensor's bias.

    Of that, a share was learned: the rest is still its prior.
    """
    own, learner = parity.projector[sensor, sensor], parity.ahead
    learned = 1.0 - learner.covariance[0, 0] * learner.unit / learner.prior[0]
    if own <= CHECKED_FROM or learned <= 0.0:
        return 0.0, 0.0
    along = own * learned
    variance = along * learned * parity.bias_variance
    variance += learned * learner.covariance[0, 0] * parity.learning_variance[sensor]
    return along * along / variance, along * learner.coefficients[sensor, 0] / variance


@compiled
def _cover(
    state: Ram, number: int, parity: Parity, by_parity: bool, young_s: float, alarm: bool
) -> bool:
    """Raise the bounds to cover a fault; return whether it shows, and moves the navigation.

    In an alarm of its kind it is as likely as not, and what it can do is added to `sums`. Otherwise
    one that began less than `young_s` ago is not covered before it shows.
    """
    integrity, shows = state.integrity, False
    fault, less = integrity.faults[number], rivals(integrity, number)
    for bound in range(BOUNDS):
        most, sigma = 0.0, integrity.sigmas[bound]
        for age in range(AGES + 1 if by_parity and fault.sensor >= 0 else AGES):
            effect = fault.effects[SINCE_BEGIN if age == AT_BEGIN else age]
            seconds = integrity.seconds - effect.begun_s
            size = _size(state, effect.state, bound)
            if seconds == 0 or size == 0.0:
                continue
            odds = odds_of(integrity, fault, age) - less
            information, correlation = believed(integrity, effect, number)
            if by_parity:
                if age == AT_BEGIN:
                    more, along = _from_constant(parity, int(fault.sensor))
                else:
                    more, along = _from_parity(parity, int(fault.sensor), int(seconds))
                information += more
                correlation += along
            covers = math.inf
            if information > 0.0:
                deviation = size / math.sqrt(information)
                found = abs(correlation) / math.sqrt(information)
                if fault.known > 0.0:  # another size would have been as likely before it showed
                    odds -= math.log(information / fault.known)
                    odds -= fault.allowed if information < _SEEN * fault.known else 0.0
                shows = shows or (found > SHOWS_FROM and deviation * found > sigma)
                if not (alarm or found > SHOWS_FROM or seconds > young_s):
                    continue
                odds += found * found
                if alarm:
                    odds = max(odds, integrity.faultless**2)
                if odds <= 0.0:
                    continue
                covers = deviation * found
                covers += math.sqrt(odds * (sigma * sigma + deviation * deviation))
            elif odds <= 0.0 or seconds == 1:  # no measurement has come since
                continue
            if alarm:
                most = max(most, covers - integrity.faultless * sigma)
            elif covers > integrity.protection[bound]:
                integrity.protection[bound] = covers
                integrity.limit[bound] = number
        integrity.sums[bound] += most
    return shows


@compiled
def _is_suspected(state: Ram, parity: Parity, kind: int) -> bool:
    """Return whether a sensor of a kind is suspected to fail, and still in use."""
    bank = state.redundancy.bank
    return bool(parity.alarm or (bank.active and bank.doubts >> kind & 1 != 0))


@compiled_with(is_unit=True)
def follow(state: Ram) -> None:
    """Find the bounds where the filter has just ended a second, and note them with it."""
    integrity, estimator = state.integrity, state.estimator
    ended = estimator.history_count != integrity.noted
    integrity.noted = estimator.history_count
    if not estimator.running:
        _know_nothing(integrity)
    elif ended:
        _assess(state)
        last = estimator.history[(estimator.history_count - 1) % ESTIMATOR_HISTORY_S]
        last.integrity = integrity.status
        for bound in range(BOUNDS):
            last.protection[bound] = integrity.protection[bound]
            last.limit[bound] = integrity.limit[bound]


@compiled
def _know_nothing(integrity: Integrity) -> None:
    """Bound nothing: there is no navigation, or its filter does not run."""
    integrity.status = _NOT_AVAILABLE if integrity.enabled else _OFF
    for bound in range(BOUNDS):
        integrity.protection[bound] = math.inf
        integrity.limit[bound] = -1


@compiled
def _assess(state: Ram) -> None:
    """Find the bounds at the end of a second, and what they are worth."""
    integrity, estimator = state.integrity, state.estimator
    spread = math.sqrt(integrity.agreement) if integrity.agreement > AGREES_BELOW else 1.0
    for bound in range(BOUNDS):
        integrity.sigmas[bound] = spread * _sigma(state, bound)
        integrity.protection[bound] = integrity.faultless * integrity.sigmas[bound]
        integrity.limit[bound] = -1
    integrity.suspected = spread > 1.0
    integrity.unmonitored = False
    weigh(state)
    _cover_sensors(state)
    for k in range(FIRST_AID, FIRST_SHIFT):
        if integrity.faults[k].present:
            shows = _cover(state, k, state.redundancy.gyros, False, 0.0, False)
            integrity.suspected = integrity.suspected or shows
    _cover_refused(state)
    _cover_table(state)
    for bound in range(BOUNDS):  # they hold before it is fed back, too
        integrity.protection[bound] += _size(state, estimator.applied, bound)
    _judge(integrity, bool(estimator.vertical))
    if not state.redundancy.aligning:
        integrity.counts[integrity.status] += 1


@compiled
def _in_use(parity: Parity, fusion: Fusion) -> int:
    """Return how many sensors of a kind are not left out."""
    count = 0
    for k in range(fusion.count):
        count += parity.excluded >> k & 1 == 0
    return count


@compiled
def _cover_sensors(state: Ram) -> None:
    """Cover the faults of the sensors that are in use."""
    integrity, parity, fusion = state.integrity, state.redundancy.gyros, state.gyros
    gyros_shown = _parity_shows(integrity, parity, 0)
    accelerometers_shown = _parity_shows(integrity, state.redundancy.accelerometers, 1)
    unwatched = 0 if gyros_shown else _in_use(parity, fusion)
    if not accelerometers_shown:
        unwatched += _in_use(state.redundancy.accelerometers, state.accelerometers)
    by_parity = gyros_shown
    for kind in range(2):
        if kind == 1:
            parity, fusion = state.redundancy.accelerometers, state.accelerometers
            by_parity = accelerometers_shown
        alarm = _is_suspected(state, parity, kind)
        useless = parity.useless_epochs > 0  # soon left out; until then nothing is compared
        misses = fusion.count > _SPAN and (parity.excluded != 0 or useless or not by_parity)
        integrity.suspected = integrity.suspected or alarm
        integrity.unmonitored = integrity.unmonitored or misses
        for bound in range(BOUNDS):
            integrity.sums[bound] = 0.0
        first = kind * SENSOR_GROUPS
        for k in range(fusion.count):
            if parity.excluded >> k & 1 == 0:
                young_s = 0.0 if by_parity else integrity.faults[first + k].young_s / unwatched
                shows = _cover(state, first + k, parity, by_parity, young_s, alarm)
                integrity.suspected = integrity.suspected or shows
        shows = _cover(state, FIRST_SHIFT + kind, parity, by_parity, 0.0, False)
        integrity.suspected = integrity.suspected or shows
        for bound in range(BOUNDS if alarm else 0):
            all_of_kind = integrity.sums[bound] + integrity.faultless * integrity.sigmas[bound]
            if all_of_kind > integrity.protection[bound]:
                integrity.protection[bound] = all_of_kind
                integrity.limit[bound] = first + max(0, parity.suspect)


@compiled
def _cover_refused(state: Ram) -> None:
    """Cover a fix that is refused: it may be right."""
    integrity, estimator = state.integrity, state.estimator
    integrity.refusing = estimator.receiver_doubted
    for aid in range(AIDS):
        if estimator.sources[aid].rejected_in_a_row > 0:
            integrity.refusing = True
    if integrity.verdicts.any():
        integrity.refusing = True
    noise = integrity.faultless * estimator.fix_sigma[0]
    level = math.hypot(integrity.refused[0], integrity.refused[1])
    for bound in range(HEADING):
        refused = integrity.refused[2] if bound == VERTICAL else level
        if refused > 0.0 and refused + noise > integrity.protection[bound]:
            integrity.protection[bound] = refused + noise
            integrity.limit[bound] = FIRST_AID


@compiled
def _cover_table(state: Ram) -> None:
    """Cover what is not known of the table's angles, between the sensors and the vehicle."""
    integrity, table = state.integrity, state.encoders
    doubtful = math.radians(encoders.doubtful_deg(table, state.parameters))
    if doubtful > 0.0:
        integrity.protection[HEADING] += doubtful
        integrity.limit[HEADING] = TABLE_FAULT
    for axis in (INNER, OUTER):
        if table.doubted[axis] or table.source[axis] >= _GYROS:
            integrity.suspected = True


@compiled
def _judge(integrity: Integrity, vertical: bool) -> None:
    """Compare the bounds with the alert limits; one that leaves the whole circle open is none."""
    if not vertical:
        integrity.protection[VERTICAL] = 0.0
    for bound in (HORIZONTAL, HEADING):
        anywhere = math.pi if bound == HEADING else math.pi * earth.SEMI_MAJOR_AXIS
        if integrity.protection[bound] >= anywhere:
            integrity.protection[bound] = math.inf
    doubtful = integrity.suspected or integrity.unmonitored or integrity.refusing
    integrity.status = _DEGRADED if doubtful else _AVAILABLE
    for bound in range(BOUNDS):
        if not integrity.protection[bound] <= integrity.alert[bound]:
            integrity.status = _NOT_AVAILABLE
