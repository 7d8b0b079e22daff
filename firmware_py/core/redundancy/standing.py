"""Each sensor against the truth, where the vehicle stands: encoders, Earth rate and gravity.

At standstill the sensors turn with the table and the Earth, and gravity is all that they feel. The
fused vector less this expectation is zero but for errors, so every sensor has a residual of its
own: that of the parity, and the difference along its axis.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.angles import turn_to
from rrins.firmware_py.core.maths.attitude import cross
from rrins.firmware_py.core.navigation.strapdown import parallel
from rrins.firmware_py.core.records.estimator_records import BIASES
from rrins.firmware_py.core.records.memory import INNER, OUTER, Fusion, Ram
from rrins.firmware_py.core.records.redundancy_records import (
    ACCELEROMETERS,
    OUTER_TURN,
    SETTLED_S,
    Parity,
)
from rrins.firmware_py.core.redundancy import learning

_STANDS_BELOW = 3.0
"""m/s, largest velocity that a sound navigation has at standstill. Beyond, the sensors have to say
for longer that the vehicle stands, and nothing is learned of them."""

_WITHIN = 3.0
"""Standard deviations by which what is estimated may still change."""

_FIX_S = 2
"""Age of the oldest fix that says that the vehicle moves."""

_DRIVEN_FROM, _SURELY = 1.0, 6.0
"""m/s, and standard deviations of the fix on top, from which its velocity says so."""

_EVEN_DPS = 0.02
"""Largest change of an axis' rate within a second that is none."""


@compiled
def _expect_rotation(state: Ram, C_s_n: Floats, out: Floats, dt: float) -> None:
    """Write the sensors' rotation in this epoch at standstill, rad."""
    redundancy, assembly = state.redundancy, state.assembly
    redundancy.outer_turn = 0.0
    inner = math.radians(assembly.encoder_angle_deg[INNER])
    outer = math.radians(assembly.encoder_angle_deg[OUTER])
    before = redundancy.angle_before_rad
    span = math.radians(state.parameters.angle_span_deg)
    dinner = inner - before[INNER]
    dinner -= span * math.floor(dinner / span + 0.5)
    douter = outer - before[OUTER]
    douter -= span * math.floor(douter / span + 0.5)
    middle = inner - 0.5 * dinner
    earth.turn(out, C_s_n, parallel(state.ins), dt)
    turn_to(redundancy.middle, middle)
    out[0] += douter * redundancy.middle.cosine
    out[1] -= douter * redundancy.middle.sine
    out[2] += dinner
    before[INNER] = inner
    before[OUTER] = outer
    redundancy.outer_turn = douter


@compiled
def _turned_evenly(state: Ram, dt: float) -> bool:
    """Return whether the axes are where their rates have taken them: so they were meanwhile."""
    assembly, before = state.assembly, state.redundancy.angle_before_rad
    span = state.parameters.angle_span_deg
    for axis in range(2):
        off = assembly.encoder_angle_deg[axis] - assembly.encoder_rate_dps[axis] * dt
        off -= math.degrees(before[axis])
        off -= span * math.floor(off / span + 0.5)
        if abs(off) > 2.0 * state.encoders.step_deg:
            return False
    return True


@compiled
def expect(state: Ram) -> None:
    """Find the increments of this epoch that sound sensors have if the vehicle stands."""
    redundancy, assembly = state.redundancy, state.assembly
    dt = state.parameters.period_ns * 1e-9
    known = redundancy.angle_known or _turned_evenly(state, dt)
    redundancy.angle_known = assembly.axis_received[INNER] and assembly.axis_received[OUTER]
    C_s_n = state.ins.C_s_n
    dtheta_s, force_s = redundancy.expected_dtheta_s, redundancy.work[0]
    _expect_rotation(state, C_s_n, dtheta_s, dt)
    redundancy.expected_known = known and redundancy.angle_known
    if not redundancy.expected_known:
        redundancy.outer_turn = 0.0
    step = earth.gravity_at(parallel(state.ins).sine, state.ins.height) * dt
    for i in range(3):
        force_s[i] = C_s_n[2, i] * step
    cross(redundancy.work[1], dtheta_s, force_s)
    for i in range(3):
        redundancy.expected_dv_s[i] = force_s[i] - 0.5 * redundancy.work[1][i]


@compiled
def expect_constant(state: Ram) -> None:
    """Expect what was measured in the first second: all stands, and the attitude is unknown.

    What that second errs by is learned as a constant.
    """
    redundancy = state.redundancy
    redundancy.aligned_epochs += 1
    redundancy.outer_turn = 0.0
    epochs, second_epochs = redundancy.aligned_epochs, redundancy.second_epochs
    redundancy.expected_known = epochs > second_epochs
    if redundancy.expected_known:
        return
    for i in range(3):
        if epochs == 1:
            redundancy.expected_dtheta_s[i] = 0.0
            redundancy.expected_dv_s[i] = 0.0
        redundancy.expected_dtheta_s[i] += state.dtheta_s[i] / second_epochs
        redundancy.expected_dv_s[i] += state.dv_s[i] / second_epochs
    redundancy.angle_known = False


@compiled
def forget(parity: Parity) -> None:
    """Forget what was learned of the expectation, which is another one from now on."""
    learning.forget_all(parity.expected, parity.vector_learning_variance)
    parity.now.standing = 0


@compiled
def expect_aligned(state: Ram) -> None:
    """Know of the constants of the expectation what the estimator knows of the biases.

    It has found them in the fine alignment, and takes them out once the sensors are compared.
    """
    estimator, first = state.estimator, BIASES
    parity, fusion = state.redundancy.gyros, state.gyros
    for kind in range(2):
        if kind == ACCELEROMETERS:
            parity, fusion = state.redundancy.accelerometers, state.accelerometers
        largest = 0.0
        for axis in range(3):
            total, known_bias = 0.0, 0.0
            for i in range(fusion.count):
                bias = estimator.gyro_bias[i]
                if kind == ACCELEROMETERS:
                    bias = estimator.accelerometer_bias[i]
                known_bias += fusion.gain[axis, i] * bias
                for j in range(fusion.count):
                    share = fusion.gain[axis, i] * fusion.gain[axis, j]
                    total += share * estimator.P[first + i, first + j]
            largest = max(largest, total)
            parity.expected.coefficients[axis, 0] = known_bias
        learner = parity.expected
        known = _WITHIN * _WITHIN * largest / learner.unit
        learner.covariance[0, 0] = min(learner.covariance[0, 0], known)
        first += int(fusion.count)


@compiled
def take(parity: Parity, vector_s: Floats, expected_s: Floats, outer_turn: float) -> None:
    """Add an epoch's fused vector, less what is expected of it."""
    parity.turned += abs(outer_turn)
    for i in range(3):
        parity.vector[i] += vector_s[i] - expected_s[i]


@compiled
def note_rates(state: Ram) -> None:
    """Note whether the axes have turned evenly for a second.

    Gyros are slower than encoders: where an axis starts or stops, they differ by its change of rate
    times some tenths of a millisecond, for once.
    """
    redundancy = state.redundancy
    redundancy.turns_evenly = True
    for axis in range(2):
        rate_dps = state.assembly.encoder_rate_dps[axis]
        if abs(rate_dps - redundancy.rate_before_dps[axis]) > _EVEN_DPS:
            redundancy.turns_evenly = False
        redundancy.rate_before_dps[axis] = rate_dps


@compiled
def note_velocity(state: Ram) -> None:
    """Note by how much the expectation errs, if the velocity is an error of the navigation.

    A tilt oscillates with the velocity, 90° apart: g times the tilt is the velocity times Schuler's
    rate. Groves (2nd ed., 2013), section 5.7. A navigation that has become fast has been turned by
    its biases and by the way that it made, and mistakes the Earth's rate as much.
    """
    ins, redundancy, estimator = state.ins, state.redundancy, state.estimator
    redundancy.gyros.tilt_error = 0.0
    redundancy.accelerometers.tilt_error = 0.0
    if not redundancy.navigated:
        return
    if estimator.running:  # it changes the attitude
        level, heading = estimator.attitude_sigma[0], estimator.attitude_sigma[2]
        if not redundancy.aligning:
            level = math.sqrt(max(estimator.P[0, 0], estimator.P[1, 1]))
            heading = math.sqrt(estimator.P[2, 2])
        level, heading = min(level, math.pi), min(heading, math.pi)
        redundancy.gyros.tilt_error = _WITHIN * earth.RATE * (level + heading)
        redundancy.accelerometers.tilt_error = _WITHIN * earth.GRAVITY_EQUATOR * level
    speed = math.sqrt(ins.velocity_n[0] ** 2 + ins.velocity_n[1] ** 2)
    schuler = math.sqrt(earth.GRAVITY_EQUATOR / earth.SEMI_MAJOR_AXIS)
    redundancy.gyros.tilt_error += speed / earth.SEMI_MAJOR_AXIS
    if not slow(state):
        second_epochs = redundancy.second_epochs
        seconds = (state.epoch - redundancy.navigation_epoch) / second_epochs
        turned = math.sqrt(redundancy.gyros.bias_variance) * seconds
        turned += speed * seconds / earth.SEMI_MAJOR_AXIS
        redundancy.gyros.tilt_error += earth.RATE * min(turned, math.pi)
    redundancy.accelerometers.tilt_error += speed * schuler


@compiled
def slow(state: Ram) -> bool:
    """Return whether the velocity navigated speaks for a vehicle that stands."""
    east, north = state.ins.velocity_n[0], state.ins.velocity_n[1]
    return east * east + north * north < _STANDS_BELOW * _STANDS_BELOW


@compiled
def is_driven(state: Ram) -> bool:
    """Return whether a receiver has measured in the last seconds that the vehicle moves."""
    gnss, since = state.gnss, state.epoch - state.gnss.epoch
    if gnss.interval_epochs == 0 or since > _FIX_S * state.redundancy.second_epochs:
        return False
    east, north = gnss.velocity_n[0], gnss.velocity_n[1]
    least = _DRIVEN_FROM + _SURELY * gnss.velocity_sigma
    return bool(east * east + north * north > least * least)


@compiled
def _learn_late(parity: Parity, regressors: int, sound: bool, even: bool) -> None:
    """Learn from the second that was `SETTLED_S` ago; keep the present one in its place.

    Not from one in which an axis starts or stops: what it shows once would count as lasting.
    """
    learner = parity.expected
    slot = parity.now.standing % SETTLED_S
    vector, earlier = parity.late_vector[slot], parity.late_regressors[slot]
    settled = parity.now.standing > 2 * SETTLED_S
    pending = parity.frozen > 0 or parity.persistent > 0 or parity.alarm
    if settled and sound and not pending:
        uncertain = learning.leverage(learner, earlier, regressors)
        for i in range(3):
            vector[i] -= learning.expected(learner, i, earlier, regressors)
        learning.learn(learner, vector, 3, uncertain, regressors)
        learning.age(learner, regressors)
    for i in range(3):
        vector[i] = parity.vector[i] if sound and even else 0.0
    for k in range(regressors):
        earlier[k] = parity.regressors[k] if sound and even else 0.0


@compiled
def close_second(
    parity: Parity, fusion: Fusion, regressors: int, known: bool, learns: bool, even: bool
) -> bool:
    """Add a second to the sums, learn at standstill, if wanted; return whether it clearly moves.

    It stands when the residuals of all sensors but one are within the limit. It is `even` if the
    axes have kept their rates.
    """
    learner = parity.expected
    beyond = 0
    for i in range(fusion.count):
        if parity.sensors >> i & 1:
            residual = parity.residual[i]
            for axis in range(3):
                residual += fusion.H[i, axis] * parity.vector[axis]
            beyond += abs(residual) > parity.standing_limit[i]
    stands = known and beyond <= 1
    parity.now.standing = parity.now.standing + 1 if stands else 0
    parity.now.turned += parity.turned
    parity.now.square_variance = learner.covariance[OUTER_TURN, OUTER_TURN] * learner.unit
    for i in range(3):
        learned = learning.expected(learner, i, parity.regressors, regressors)
        parity.now.vector[i] += parity.vector[i] - learned
    parity.now.vector_leverage += learning.leverage(learner, parity.regressors, regressors)
    if stands:
        _learn_late(parity, regressors, learns and beyond == 0, even)
    return beyond > 1
