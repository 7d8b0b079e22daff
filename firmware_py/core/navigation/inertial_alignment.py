"""Coarse alignment of a vehicle that sways or moves, from any attitude and heading.

The gyros tell how the sensors have turned since it began, so what the accelerometers feel can be
summed along axes that do not turn, s0. What they should feel is known along the Earth's axes at the
beginning, i: gravity turns with the Earth, and GNSS says how the velocity changes. The rotation
between the two is Wahba's problem. Wu, Wu, Hu and Hu, "Optimization-based alignment for inertial
navigation systems: theory and algorithm", *Aerospace Science and Technology* 15 (2011) 1; Wu and
Pan, "Velocity/position integration formula, part I: application to in-flight coarse alignment",
*IEEE TAES* 49 (2013) 1006.

The first velocity is not known, so both sums are taken from their means. Samples have the weight
τ (T - τ), which is what fitting the positions would give them: a ship at its mooring comes back,
and its velocity cancels.
"""

from __future__ import annotations

import math

from rrins.compiled.compilation import compiled
from rrins.compiled.record import Floats
from rrins.firmware_py.core.maths import earth
from rrins.firmware_py.core.maths.attitude import (
    matrix_of_quaternion,
    multiply,
    normalise,
    quaternion_of_vector,
    rotate,
)
from rrins.firmware_py.core.maths.wahba import fill_davenport, invert_symmetric, largest_eigenvector
from rrins.firmware_py.core.navigation import strapdown
from rrins.firmware_py.core.navigation.alignment import FORCE_TOLERANCE, LARGEST_HEADING_SIGMA
from rrins.firmware_py.core.records.estimator_records import TRACK_EPOCHS
from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.core.records.memory import InertialAlignment, Ram

_MOVING = int(InitialAttitude.SELF_ALIGNED_MOVING)
_SWAYING = int(InitialAttitude.SELF_ALIGNED_SWAYING)

_LEAST_FIXES = 10

_SWAY_S = 2.0
"""Way that a vehicle sways per velocity: of a period of 12 s, divided by 2π."""

_CANCELS_S = 14.0
"""The velocity of a sway with periods up to 20 s cancels but for what is left at both ends. In the
weighted mean that goes with ``(4.3 / (ω T))²``: as the mean of ``(T / this)⁴`` independent ones.
"""

_LONGEST_S = 900.0
"""After which an alignment that waits begins anew: the gyros' errors have grown in it."""


@compiled
def is_wanted(state: Ram) -> bool:
    """Return whether the alignment is by this method."""
    method = state.parameters.initial_attitude
    return method in (_MOVING, _SWAYING)


@compiled
def begin(inertial: InertialAlignment) -> None:
    """Start a new alignment."""
    inertial.first_epoch = -1
    inertial.fixes = 0
    inertial.samples = 0
    for i in range(3):
        inertial.felt_s0[i] = 0.0
        inertial.moment_s0[i] = 0.0
        inertial.expected_i[i] = 0.0
    for power in range(2):
        inertial.weight[power] = 0.0
        inertial.felt_square[power] = 0.0
        for i in range(3):
            inertial.felt_sum[power, i] = 0.0
            inertial.expected_sum[power, i] = 0.0
            inertial.moment_sum[power, i] = 0.0
            for k in range(3):
                inertial.product[power, i, k] = 0.0
                inertial.moment_product[power, i, k] = 0.0
                inertial.expected_product[power, i, k] = 0.0


@compiled
def follow(state: Ram) -> bool:
    """Add an epoch; return whether the attitude may be asked for at its end."""
    inertial, ins = state.inertial_alignment, state.ins
    dt = state.parameters.period_ns * 1e-9
    left_out = state.redundancy.gyros.excluded | state.redundancy.accelerometers.excluded << 32
    is_long = state.alignment.epochs * dt > max(
        _LONGEST_S, 3.0 * state.parameters.alignment_epochs * dt
    )
    if inertial.first_epoch >= 0 and (left_out != inertial.left_out or is_long):
        begin(inertial)
        state.alignment.epochs = 0
        state.alignment.done = False
    if inertial.first_epoch < 0:
        inertial.first_epoch = state.epoch
        inertial.left_out = left_out
        for i in range(4):
            inertial.q_s_s0[i] = 1.0 if i == 0 else 0.0
        matrix_of_quaternion(inertial.C_s_s0, inertial.q_s_s0)
        for i in range(3):
            ins.dtheta_s_previous[i] = state.dtheta_s[i]
            ins.dv_s_previous[i] = state.dv_s[i]
    state.alignment.epochs += 1
    _feel(state)
    if state.parameters.initial_attitude == _MOVING:
        return _take_fix(state, dt)
    seconds = state.alignment.epochs * dt
    _fill_axes(inertial.C_n_i, state.parameters.latitude, earth.RATE * (seconds - 0.5 * dt))
    gravity = earth.gravity(state.parameters.latitude, state.parameters.height)
    for i in range(3):
        inertial.expected_i[i] += inertial.C_n_i[i, 2] * gravity * dt
    _sample(inertial, seconds, inertial.track[state.epoch % TRACK_EPOCHS], inertial.expected_i)
    return bool(state.epoch % round(1.0 / dt) == 0)


@compiled
def _feel(state: Ram) -> None:
    """Add the epoch's increments to the attitude and to the velocity change in s0."""
    inertial, ins = state.inertial_alignment, state.ins
    felt = inertial.track[state.epoch % TRACK_EPOCHS]
    middle_s = (state.alignment.epochs - 0.5) * state.parameters.period_ns * 1e-9
    vector, turned = inertial.work[0, 0], inertial.work[0, 1]
    strapdown.velocity_in_start_frame(ins, vector, state.dtheta_s, state.dv_s)
    rotate(turned, inertial.C_s_s0, vector)
    for i in range(3):
        inertial.felt_s0[i] += turned[i]
        inertial.moment_s0[i] += middle_s * turned[i]
        felt[i] = inertial.felt_s0[i]
        felt[3 + i] = inertial.moment_s0[i]
    strapdown.rotation_vector(vector, state.dtheta_s, ins.dtheta_s_previous)
    quaternion_of_vector(inertial.work_q[0], vector)
    multiply(inertial.work_q[1], inertial.q_s_s0, inertial.work_q[0])
    for i in range(4):
        inertial.q_s_s0[i] = inertial.work_q[1, i]
    normalise(inertial.q_s_s0)
    matrix_of_quaternion(inertial.C_s_s0, inertial.q_s_s0)
    for i in range(3):
        ins.dtheta_s_previous[i] = state.dtheta_s[i]
        ins.dv_s_previous[i] = state.dv_s[i]


@compiled
def _fill_axes(C_n_i: Floats, latitude: float, longitude: float) -> None:
    """Write the axes of n at a longitude that is counted in i."""
    cosine, sine = math.cos(latitude), math.sin(latitude)
    along, across = math.cos(longitude), math.sin(longitude)
    C_n_i[0, 0], C_n_i[0, 1], C_n_i[0, 2] = -across, -sine * along, cosine * along
    C_n_i[1, 0], C_n_i[1, 1], C_n_i[1, 2] = along, -sine * across, cosine * across
    C_n_i[2, 0], C_n_i[2, 1], C_n_i[2, 2] = 0.0, cosine, sine


@compiled
def _take_fix(state: Ram, dt: float) -> bool:
    """Take a fix that came in this epoch as a sample; return whether there was one.

    The velocity over ground in i changes by ``f - ω_ie x v - γ``, f the specific force.
    """
    inertial, gnss = state.inertial_alignment, state.gnss
    oldest = max(inertial.first_epoch, state.epoch - TRACK_EPOCHS + 1)
    if not gnss.fresh or gnss.epoch < oldest:
        return False
    if inertial.fixes > 0 and gnss.epoch <= inertial.fix_epoch:
        return False
    seconds = (gnss.epoch - inertial.first_epoch + 1) * dt
    _fill_axes(inertial.C_n_i, gnss.latitude, gnss.longitude + earth.RATE * seconds)
    velocity_i, expected = inertial.work[0, 0], inertial.work[0, 1]
    rotate(velocity_i, inertial.C_n_i, gnss.velocity_n)
    gravity = earth.gravity(gnss.latitude, gnss.height)
    since = (gnss.epoch - inertial.fix_epoch) * dt if inertial.fixes > 0 else 0.0
    for i in range(3):
        rate = inertial.C_n_i[i, 2] * gravity
        if i == 0:
            rate -= earth.RATE * velocity_i[1]
        elif i == 1:
            rate += earth.RATE * velocity_i[0]
        if inertial.fixes > 0:
            inertial.expected_i[i] += 0.5 * (rate + inertial.fix_rate_i[i]) * since
        inertial.fix_rate_i[i] = rate
        inertial.fix_velocity_i[i] = velocity_i[i]
        expected[i] = velocity_i[i] + inertial.expected_i[i]
    inertial.fixes += 1
    inertial.fix_epoch = gnss.epoch
    inertial.fix_place[0] = gnss.latitude
    inertial.fix_place[1] = gnss.longitude
    inertial.fix_place[2] = gnss.height
    _sample(inertial, seconds, inertial.track[gnss.epoch % TRACK_EPOCHS], expected)
    return bool(inertial.fixes >= _LEAST_FIXES)


@compiled
def _sample(inertial: InertialAlignment, seconds: float, felt: Floats, expected: Floats) -> None:
    """Add what was felt in s0, with its moment, and what was expected in i to the sums."""
    inertial.samples += 1
    weight = 1.0
    for power in range(2):
        weight *= seconds
        inertial.weight[power] += weight
        for i in range(3):
            inertial.felt_sum[power, i] += weight * felt[i]
            inertial.expected_sum[power, i] += weight * expected[i]
            inertial.moment_sum[power, i] += weight * felt[3 + i]
            inertial.felt_square[power] += weight * felt[i] * felt[i]
            for k in range(3):
                inertial.product[power, i, k] += weight * expected[i] * felt[k]
                inertial.moment_product[power, i, k] += weight * expected[i] * felt[3 + k]
                inertial.expected_product[power, i, k] += weight * expected[i] * expected[k]


@compiled
def find(state: Ram) -> None:
    """Find the rotation from the samples so far, and what noise and motion leave of its errors.

    `alignment.done` becomes true once the heading is known well enough; `alignment.failed` if what
    was felt is not as long as what was expected.
    """
    inertial, coarse = state.inertial_alignment, state.alignment
    B, spread = inertial.work[0], inertial.work[1]
    total_s = coarse.epochs * state.parameters.period_ns * 1e-9
    weight = total_s * inertial.weight[0] - inertial.weight[1]
    if not weight > 0.0:
        return
    _covary(B, inertial.product, inertial.expected_sum, inertial.felt_sum, total_s, weight)
    other = inertial.expected_product
    _covary(spread, other, inertial.expected_sum, inertial.expected_sum, total_s, weight)
    expected_square = spread[0, 0] + spread[1, 1] + spread[2, 2]
    felt_square = (total_s * inertial.felt_square[0] - inertial.felt_square[1]) / weight
    for i in range(3):
        felt_square -= _mean(inertial.felt_sum, i, total_s, weight) ** 2
    expected = math.sqrt(max(0.0, expected_square))
    if not abs(math.sqrt(max(0.0, felt_square)) - expected) < FORCE_TOLERANCE * expected:
        coarse.failed = True
        return
    fill_davenport(inertial.davenport, B)
    q_s0_i = inertial.work_q[2]
    largest = largest_eigenvector(inertial.davenport, inertial.eigenvectors, q_s0_i)
    matrix_of_quaternion(inertial.C_s0_i, q_s0_i)
    residual = max(0.0, felt_square + expected_square - 2.0 * largest) / 2.0
    coarse.velocity_sigma = math.sqrt(residual)
    coarse.position_sigma = _SWAY_S * coarse.velocity_sigma
    if state.parameters.initial_attitude == _MOVING:
        lever_b = state.antenna.lever_arm_b  # fixes are taken for those of the reference point
        lever = math.sqrt(lever_b[0] ** 2 + lever_b[1] ** 2 + lever_b[2] ** 2)
        coarse.velocity_sigma = max(state.gnss.velocity_sigma, coarse.velocity_sigma)
        coarse.position_sigma = math.hypot(state.gnss.position_sigma, lever)
    coarse.done = _find_sigma(state, residual, total_s, weight)


@compiled
def _covary(
    out: Floats, products: Floats, sums: Floats, others: Floats, total_s: float, weight: float
) -> None:
    """Write the weighted covariance of two vectors, shape (3, 3)."""
    for i in range(3):
        for k in range(3):
            mean = (total_s * products[0, i, k] - products[1, i, k]) / weight
            first = _mean(sums, i, total_s, weight)
            out[i, k] = mean - first * _mean(others, k, total_s, weight)


@compiled
def _mean(sums: Floats, component: int, total_s: float, weight: float) -> float:
    return float((total_s * sums[0, component] - sums[1, component]) / weight)


@compiled
def _find_sigma(state: Ram, residual: float, total_s: float, weight: float) -> bool:
    """Write the sigma of the attitude about the axes of n; return whether the heading is known.

    The least squares of ``θ x b = δ``, b what was expected: ``M = Σ w (b·b I - b bᵀ)`` is their
    information. A gyro bias ε turns s0 by ``ε t`` meanwhile, so ``δ = ε x m``, m the moment, and
    the attitude at the end is off by ``(T I - M⁻¹ (tr G I - Gᵀ)) ε``, ``G = Σ w b mᵀ``.

    Parameters
    ----------
    state : Ram
        With the covariance of b in `work[1]`.
    residual : float
        Variance of what was felt but not expected, per component, (m/s)².
    total_s : float
        Length of the alignment.
    weight : float
        Sum of all weights.
    """
    inertial, sigma = state.inertial_alignment, state.alignment.noise_sigma
    spread, information, inverse = inertial.work[1], inertial.work[2], inertial.work[3]
    moments, turned = inertial.work[0], inertial.work[4]
    for i in range(3):
        sigma[i] = 0.0
        for k in range(3):
            information[i, k] = -spread[i, k]
        information[i, i] += spread[0, 0] + spread[1, 1] + spread[2, 2]
    if not invert_symmetric(inverse, information):
        return False
    other = inertial.moment_product
    _covary(moments, other, inertial.expected_sum, inertial.moment_sum, total_s, weight)
    for i in range(3):  # G, its second index turned into i
        rotate(turned[i], inertial.C_s0_i, moments[i])
    trace = turned[0, 0] + turned[1, 1] + turned[2, 2]
    for i in range(3):
        for k in range(3):
            total = inverse[i, k] * trace
            for j in range(3):
                total -= inverse[i, j] * turned[k, j]
            moments[i, k] = (total_s if i == k else 0.0) - total
    count = max(1.0, (total_s / _CANCELS_S) ** 4)
    latitude, longitude = state.parameters.latitude, earth.RATE * total_s
    if state.parameters.initial_attitude == _MOVING:
        count = 0.5 * inertial.fixes
        latitude, longitude = inertial.fix_place[0], inertial.fix_place[1] + longitude
    _fill_axes(inertial.C_n_i, latitude, longitude)
    rate_variance = _rate_variance(state, total_s)
    known = False
    for axis in range(3):
        noise, drift = 0.0, 0.0
        for k in range(3):
            by_noise, by_drift = 0.0, 0.0
            for i in range(3):
                by_noise += inertial.C_n_i[i, axis] * inverse[i, k]
                by_drift += inertial.C_n_i[i, axis] * moments[i, k]
            noise += by_noise * inertial.C_n_i[k, axis]
            drift += by_drift * by_drift
        noise *= residual / count
        known = noise < LARGEST_HEADING_SIGMA * LARGEST_HEADING_SIGMA
        sigma[axis] = math.sqrt(noise + drift * rate_variance)
    return known


@compiled
def _rate_variance(state: Ram, total_s: float) -> float:
    """Return the variance of a component of the fused rate, (rad/s)²: bias, and mean of noise."""
    estimator, fusion = state.estimator, state.gyros
    variance = 0.0
    for k in range(fusion.count):
        share = 0.0
        for i in range(3):
            share += fusion.gain[i, k] * fusion.gain[i, k] / 3.0
        white = estimator.white_variance[0, k] / total_s
        variance += share * (estimator.bias_sigma[0] * estimator.bias_sigma[0] + white)
    return variance + state.alignment.rate_sigma**2


@compiled
def write_attitude(state: Ram) -> None:
    """Write the attitude of the sensors in n at the end of this epoch to the alignment."""
    inertial, parameters = state.inertial_alignment, state.parameters
    latitude = parameters.latitude
    longitude = earth.RATE * state.alignment.epochs * parameters.period_ns * 1e-9
    if parameters.initial_attitude == _MOVING:
        latitude = inertial.fix_place[0]
        longitude += inertial.fix_place[1]
    _fill_axes(inertial.C_n_i, latitude, longitude)
    C_s_i = inertial.work[0]
    for i in range(3):
        for k in range(3):
            C_s_i[i, k] = (
                inertial.C_s0_i[i, 0] * inertial.C_s_s0[0, k]
                + inertial.C_s0_i[i, 1] * inertial.C_s_s0[1, k]
                + inertial.C_s0_i[i, 2] * inertial.C_s_s0[2, k]
            )
    for i in range(3):
        for k in range(3):
            state.alignment.C_s_n[i, k] = (
                inertial.C_n_i[0, i] * C_s_i[0, k]
                + inertial.C_n_i[1, i] * C_s_i[1, k]
                + inertial.C_n_i[2, i] * C_s_i[2, k]
            )


@compiled
def set_in_motion(state: Ram) -> None:
    """Let the navigation begin with the velocity and position at the end of this epoch.

    Those of the last fix, and what was felt since. The axes of n are those of `write_attitude`.
    """
    inertial, ins = state.inertial_alignment, state.ins
    if state.parameters.initial_attitude != _MOVING:
        return
    since = (state.epoch - inertial.fix_epoch) * state.parameters.period_ns * 1e-9
    change_s0, change_i, way_n = inertial.work[1, 0], inertial.work[1, 1], inertial.work[1, 2]
    for i in range(3):
        before = inertial.track[inertial.fix_epoch % TRACK_EPOCHS, i]
        change_s0[i] = inertial.felt_s0[i] - before
    rotate(change_i, inertial.C_s0_i, change_s0)
    for k in range(3):
        ins.velocity_n[k] = 0.0
        way_n[k] = 0.0
        for i in range(3):
            change = change_i[i] - inertial.fix_rate_i[i] * since
            ins.velocity_n[k] += inertial.C_n_i[i, k] * (inertial.fix_velocity_i[i] + change)
            way = (inertial.fix_velocity_i[i] + 0.5 * change) * since
            way_n[k] += inertial.C_n_i[i, k] * way
    latitude, longitude = inertial.fix_place[0], inertial.fix_place[1]
    height = inertial.fix_place[2]
    meridian, prime_vertical = earth.radii(latitude)
    longitude += way_n[0] / ((prime_vertical + height) * math.cos(latitude))
    ins.latitude = latitude + way_n[1] / (meridian + height)
    ins.longitude = earth.wrapped(longitude)
    ins.height = height + way_n[2]
    ins.reference_height = ins.height
