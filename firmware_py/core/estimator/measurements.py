"""Measurements of the filter: what waits, how each depends on the errors, and the gate.

Each scalar is a measurement of its own. All are of the epoch at which the filter stands; what was
valid at another one is compared with the navigation of that epoch, and the velocity's error in
between counts. Groves (2nd ed., 2013), section 14.3.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.aiding import antenna
from rrins.firmware_py.core.estimator import (
    agreement,
    covariance,
    doubt,
    fault_effects,
    heights,
    lockout,
    receiver,
    refusals,
    standstill,
    wheels,
)
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.vectors import copy
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.records.estimator_records import (
    AIDS,
    ATTITUDE,
    COMPONENTS,
    CORRECTIONS,
    HEIGHT,
    LATITUDE,
    LEVEL,
    MOST_DISTRUST,
    NO_TRUST,
    SWAY_EAST,
    SWAY_NORTH,
    TRACK_EPOCHS,
    VELOCITY,
    Aid,
    Estimator,
    Source,
)
from rrins.firmware_py.core.records.memory import ANTENNA_EPOCHS, Ram

_FIX = (1 << 2 * COMPONENTS) - 1
_EVERY = (1 << COMPONENTS) - 1
_LEVEL = 3
"""The two level components of three."""

_ZERO_VELOCITY, _KNOWN_POSITION = int(Aid.ZERO_VELOCITY), int(Aid.KNOWN_POSITION)
_GNSS_POSITION, _GNSS_VELOCITY = int(Aid.GNSS_POSITION), int(Aid.GNSS_VELOCITY)
_ODOMETER, _ALTIMETER = int(Aid.ODOMETER), int(Aid.ALTIMETER)

_LEAST_POSITION_SIGMA, _LEAST_VELOCITY_SIGMA = 0.01, 0.002
"""m, m/s: a receiver that promises more is not believed."""

_LEAST_HEIGHT_SIGMA = 0.1
"""m, of a mean height: wind and a passing lorry move the pressure by a pascal."""


@compiled
def begin(state: Ram) -> None:
    """Begin with no measurement waiting, and no past before this epoch."""
    estimator = state.estimator
    estimator.waiting = 0
    agreement.begin(estimator)
    estimator.aided_epoch = -1
    estimator.used_epoch[:] = -1
    estimator.track_first = state.epoch
    _keep(state)
    estimator.heights = 0
    estimator.height_sum = 0.0
    estimator.height_epochs = 0
    estimator.heights_refused = 0
    estimator.fix_height_epoch = -1
    estimator.correction_epoch[:] = -1
    for aid in range(AIDS):
        source = estimator.sources[aid]
        source.used = 0
        source.rejected = 0
        source.rejected_in_a_row = 0
        source.distrust = 0
        source.squares = 0.0


@compiled
def _keep(state: Ram) -> None:
    """Keep the navigation at the end of this epoch."""
    ins, row = state.ins, state.estimator.track[state.epoch % TRACK_EPOCHS]
    row[0], row[1], row[2] = ins.latitude, ins.longitude, ins.height
    copy(row[3:], ins.velocity_n)


@compiled
def note(state: Ram) -> None:
    """Keep the navigation at the end of this epoch; take a fix that came in it."""
    estimator, gnss = state.estimator, state.gnss
    _keep(state)
    is_free = estimator.waiting >> (COMPONENTS * _GNSS_POSITION) & _FIX == 0
    oldest = max(estimator.track_first, state.epoch - TRACK_EPOCHS + 1)
    if gnss.fresh and is_free and gnss.epoch >= oldest:
        _take_fix(state)
    if estimator.altimeter and state.assembly.altimeter_received:
        estimator.heights += 1
        estimator.height_sum += state.assembly.altimeter_height - state.ins.height
        estimator.height_epochs += state.epoch - estimator.epoch


@compiled
def _take_fix(state: Ram) -> None:
    estimator, gnss, place = state.estimator, state.gnss, state.antenna
    if place.present:
        if not antenna.is_known(place, gnss.epoch):
            return
        dt = state.parameters.period_ns * 1e-9
        antenna.velocity(place, gnss.epoch, dt, estimator.fix_lever_velocity_n)
        copy(estimator.fix_lever_n, place.lever_n[gnss.epoch % ANTENNA_EPOCHS])
    estimator.fix_epoch = gnss.epoch
    estimator.fix_position[0] = gnss.latitude
    estimator.fix_position[1] = gnss.longitude
    estimator.fix_position[2] = gnss.height
    copy(estimator.fix_velocity_n, gnss.velocity_n)
    estimator.fix_sigma[0] = max(gnss.position_sigma, _LEAST_POSITION_SIGMA)
    estimator.fix_sigma[1] = max(gnss.velocity_sigma, _LEAST_VELOCITY_SIGMA)
    components = _EVERY if estimator.vertical else _LEVEL
    estimator.waiting |= components << (COMPONENTS * _GNSS_POSITION)
    estimator.waiting |= components << (COMPONENTS * _GNSS_VELOCITY)


@compiled
def stand(state: Ram) -> None:
    """Know the velocity where the vehicle stands: so says the operator, or the fine alignment.

    There the position is known, too; of a vehicle that sways, it says what is to say of the
    velocity. The sensors may find standing themselves (`standstill`).
    """
    estimator = state.estimator
    has_just_aligned = state.epoch - estimator.aligned_epoch <= 1  # its last epoch ends the mode
    is_aligning = state.modes.mode == Mode.FINE_ALIGNMENT or has_just_aligned
    is_aligning = is_aligning and not standstill.may_move(state)
    components = _EVERY if estimator.vertical else _LEVEL
    stands = state.zero_velocity.standing or estimator.standing
    if stands or (is_aligning and not estimator.sway):
        estimator.waiting |= components << (COMPONENTS * _ZERO_VELOCITY)
    else:
        _forgive(estimator.sources[_ZERO_VELOCITY])
    if is_aligning:
        estimator.waiting |= components << (COMPONENTS * _KNOWN_POSITION)
    else:
        _forgive(estimator.sources[_KNOWN_POSITION])


@compiled
def _forgive(source: Source) -> None:
    """Trust a source again when what it says ends: the next time is another matter."""
    source.distrust = 0
    source.rejected_in_a_row = 0


@compiled
def finish_second(state: Ram) -> None:
    """Let the mean of the second's heights wait as a measurement; begin the next second."""
    estimator = state.estimator
    if estimator.heights > 0:
        dt = state.parameters.period_ns * 1e-9
        mean_epochs = estimator.height_epochs / estimator.heights
        estimator.height_difference = estimator.height_sum / estimator.heights
        estimator.height_count = estimator.heights
        estimator.height_after_s = (mean_epochs - estimator.second_epochs) * dt
        estimator.waiting |= 1 << (COMPONENTS * _ALTIMETER)
    estimator.heights = 0
    estimator.height_sum = 0.0
    estimator.height_epochs = 0


@compiled
def _standing_sigma(state: Ram) -> float:
    """Return the noise of zero velocity, m/s, of each component.

    A vehicle that sways has that with which it swayed in the coarse alignment, unless the operator
    says how still it stands.
    """
    sigma = state.alignment.velocity_sigma
    if state.zero_velocity.standing:
        sigma = state.zero_velocity.velocity_sigma
    return float(max(state.estimator.zero_velocity_sigma, sigma))


@compiled
def _place_sigma(state: Ram) -> float:
    """Return the noise of a known height, m: also of a vehicle that sways."""
    return float(max(state.estimator.position_sigma, state.alignment.position_sigma))


@compiled
def take(state: Ram) -> bool:
    """Take the next scalar that waits; return whether there was one."""
    estimator = state.estimator
    if estimator.waiting == 0:
        return False
    bit = 0
    while estimator.waiting >> bit & 1 == 0:
        bit += 1
    estimator.waiting &= ~(1 << bit)
    aid, component = bit // COMPONENTS, bit % COMPONENTS
    estimator.row[: estimator.states] = 0.0
    innovation, sigma = innovation_of(state, aid, component)
    used = _judge(state, aid, component, innovation, sigma)
    if aid == _GNSS_VELOCITY and component < LEVEL:
        agreement.note(state, agreement.RECEIVER, component, estimator.normalised)
    elif aid == _ODOMETER and component < LEVEL:
        agreement.note(state, agreement.ODOMETER, component, estimator.normalised)
    if wheels.is_forward(aid, component) and not used:
        wheels.follow_slip(state, innovation)
    return True


@compiled
def _judge(state: Ram, aid: int, component: int, innovation: float, sigma: float) -> bool:
    """Take a measurement, unless its innovation is beyond the gate; return whether it was."""
    estimator = state.estimator
    x, P, n, source = estimator.x, estimator.P, estimator.states, estimator.sources[aid]
    for i in range(n):
        if estimator.row[i] != 0.0:
            innovation -= estimator.row[i] * x[i]
    expected = covariance.expect(P, n, estimator.row, sigma * sigma, estimator.gain)
    square = innovation * innovation / expected
    estimator.normalised = innovation / math.sqrt(expected)
    refused = estimator.receiver_doubted and aid in (_GNSS_POSITION, _GNSS_VELOCITY)
    beyond = not square <= estimator.gate * estimator.gate
    is_silent = False
    if wheels.is_forward(aid, component):
        is_silent = wheels.is_silent(estimator, beyond)
    if refused or beyond or is_silent:
        source.rejected += 1
        source.rejected_in_a_row += 1
        source.distrust = min(MOST_DISTRUST, source.distrust + 3)
        if is_silent:
            if state.integrity.enabled:
                refusals.ask_again(state.integrity, aid, component)
            return False
        known = max(expected - sigma * sigma, 1e-9 * expected)
        estimator.excess = max(estimator.excess, innovation * innovation / known)
        if source.distrust < NO_TRUST or not doubt.explains(estimator, state.epoch):
            _note_refused(state, aid, component, innovation, expected, beyond)
            return False
        expected = lockout.open_at_once(state, aid, component, innovation, expected)
        square = 1.0
        if state.integrity.enabled:
            refusals.believe_all(state.integrity)
    if aid != _ALTIMETER or not doubt.take_height(estimator, innovation, expected):
        covariance.update(x, P, n, estimator.gain, innovation, expected)
    if state.integrity.enabled:
        refusals.use(state.integrity, aid, component, square)
        fault_effects.take(state, aid, component, innovation, expected, True)
    _note_used(state, aid, component, square)
    return True


@compiled
def _note_refused(
    state: Ram, aid: int, component: int, innovation: float, expected: float, beyond: bool
) -> None:
    """Note what a refused measurement says of the faults, and of its own device."""
    has_begun = False
    if wheels.is_forward(aid, component):
        has_begun = wheels.refuse(state.estimator)
    if state.integrity.enabled:
        if beyond:
            refusals.refuse(state.integrity, aid, component, has_begun)
        else:
            refusals.agree(state.integrity, aid, component)
        fault_effects.take(state, aid, component, innovation, expected, False)
    if aid == _ALTIMETER:
        heights.refuse(state, innovation)


@compiled
def _note_used(state: Ram, aid: int, component: int, square: float) -> None:
    """Note that a measurement was used, with the square of its normalised innovation."""
    estimator, source = state.estimator, state.estimator.sources[aid]
    if aid != _ALTIMETER:
        estimator.aided_epoch = state.epoch
    else:
        estimator.heights_refused = 0
    if aid == _GNSS_POSITION and component == COMPONENTS - 1:
        estimator.fix_height_epoch = state.epoch
    if wheels.is_forward(aid, component):
        estimator.ways_refused = 0
    source.used += 1
    estimator.used_epoch[aid, component] = state.epoch
    source.distrust = max(0, source.distrust - 1)
    source.rejected_in_a_row = 0
    source.squares += square


@compiled
def innovation_of(state: Ram, aid: int, component: int) -> tuple[float, float]:
    """Write the measurement's row; return measured less navigated, and the noise's sigma.

    Positions are in m: the row of a latitude is in m per rad.
    """
    estimator, parameters = state.estimator, state.parameters
    if aid == _ZERO_VELOCITY:
        estimator.row[VELOCITY + component] = 1.0
        return -estimator.velocity_n[component], _standing_sigma(state)
    if aid == _GNSS_VELOCITY:
        estimator.row[VELOCITY + component] = 1.0
        navigated = _past(estimator, 3 + component) + estimator.fix_lever_velocity_n[component]
        _turn(estimator, estimator.fix_lever_velocity_n, component)
        return estimator.fix_velocity_n[component] - navigated, estimator.fix_sigma[1]
    if aid == _ODOMETER:
        return wheels.innovation(state, component)
    if aid == _ALTIMETER:
        estimator.row[HEIGHT] = 1.0
        estimator.row[VELOCITY + 2] = estimator.height_after_s
        estimator.row[estimator.altimeter_state] = 1.0
        sigma = max(estimator.altimeter_sigma / estimator.height_count**0.5, _LEAST_HEIGHT_SIGMA)
        return estimator.height_difference - estimator.altimeter_bias, sigma
    metres = 1.0
    if component == 0:
        metres = estimator.north_radius
    elif component == 1:
        metres = estimator.east_radius
    estimator.row[LATITUDE + component] = metres
    if aid == _KNOWN_POSITION:
        difference = parameters.latitude - estimator.latitude
        if component == 1:
            difference = earth.wrapped(parameters.longitude - estimator.longitude)
        elif component == 2:
            difference = parameters.height - estimator.height
        if component == 2:
            return difference, _place_sigma(state)
        away = 0.0
        if estimator.sway:
            at = (SWAY_NORTH if component == 0 else SWAY_EAST) + 1
            estimator.row[estimator.sway_state + at] = -1.0
            away = estimator.sway_way[at]
        return difference * metres + away, estimator.position_sigma
    difference = estimator.fix_position[component] - _past(estimator, component)
    if component == 1:
        difference = earth.wrapped(difference)
    seconds = (estimator.fix_epoch - estimator.epoch) * parameters.period_ns * 1e-9
    axis = 2
    if component == 0:
        axis = 1
    elif component == 1:
        axis = 0
    estimator.row[VELOCITY + axis] = seconds
    _turn(estimator, estimator.fix_lever_n, axis)
    lasting = 0.0
    if estimator.receiver:
        estimator.row[estimator.receiver_state + component] = 1.0
        lasting = estimator.receiver_error[component]
    sigma = receiver.white_sigma(estimator, estimator.fix_sigma[0], _LEAST_POSITION_SIGMA)
    return difference * metres - estimator.fix_lever_n[axis] - lasting, sigma


@compiled
def _turn(estimator: Estimator, vector_n: Floats, axis: int) -> None:
    """Write what the attitude does to a component of a body's vector: ``attitude x vector``."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    estimator.row[ATTITUDE + one] = vector_n[two]
    estimator.row[ATTITUDE + two] = -vector_n[one]


@compiled
def _past(estimator: Estimator, component: int) -> float:
    """Return a component of the navigation when the fix was valid, as corrected since."""
    value = estimator.track[estimator.fix_epoch % TRACK_EPOCHS, component]
    for k in range(CORRECTIONS):
        if estimator.fix_epoch <= estimator.correction_epoch[k]:
            value += estimator.correction[k, component]
    return float(value)
