"""Inputs that wait for the filter, its corrections to the navigation, and the gate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.aiding import antenna
from rrins.firmware_py.core.estimator import feedback, measurements
from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.core.monitoring import monitor
from rrins.firmware_py.core.records.estimator_records import (
    ATTITUDE,
    BIASES,
    COMPONENTS,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    NEVER,
    NO_TRUST,
    TRACK_EPOCHS,
    VELOCITY,
    Aid,
)
from rrins.firmware_py.core.records.troubles import AidingFault, Kind

STATES = BIASES + 8
STAND, FIX_EPOCH = 5000, 4930
"""Epochs at which the filter stands, and at which a fix was valid: 0.35 s before."""

PLACE = np.array([0.7, 2.0, 40.0])
VELOCITY_N = np.array([3.0, -4.0, 0.5])
NORTH, EAST = 6.36e6, 4.9e6


def put(state, epoch, place, velocity_n):
    """Note the navigation at the end of an epoch."""
    state.epoch = epoch
    state.ins.latitude, state.ins.longitude, state.ins.height = place
    state.ins.velocity_n[:] = velocity_n
    measurements.note.py_func(state)
    state.gnss.fresh = False


def fix(state, epoch, place, velocity_n, position_sigma=1.0, velocity_sigma=0.1):
    """Let a fix come with the next epoch."""
    gnss = state.gnss
    gnss.fresh, gnss.epoch = True, epoch
    gnss.latitude, gnss.longitude, gnss.height = place
    gnss.velocity_n[:] = velocity_n
    gnss.position_sigma, gnss.velocity_sigma = position_sigma, velocity_sigma


def make_state(kit, **changes):
    state = kit.state(**changes)
    estimator = state.estimator
    measurements.begin.py_func(state)
    estimator.track_first = 1000
    estimator.epoch = STAND
    estimator.latitude, estimator.longitude, estimator.height = PLACE
    estimator.velocity_n[:] = VELOCITY_N
    estimator.north_radius, estimator.east_radius = NORTH, EAST
    sigma = np.array([1e-3] * 3 + [0.3] * 3 + [3 / NORTH, 3 / EAST, 3.0] + [1e-6] * 8)
    estimator.P[:STATES, :STATES] = np.diag(sigma**2)
    return state


@pytest.fixture
def state(kit):
    return make_state(kit)


def scalars(state):
    """Return what waits, as pairs of aid and component, in the order of the bits."""
    waiting = int(state.estimator.waiting)
    return [
        (Aid(bit // COMPONENTS), bit % COMPONENTS)
        for bit in range(COMPONENTS * len(Aid))
        if waiting >> bit & 1
    ]


def test_what_waits_is_taken_once_each_in_order(state):
    state.modes.mode = Mode.FINE_ALIGNMENT
    put(state, STAND, PLACE, VELOCITY_N)
    fix(state, STAND, PLACE, VELOCITY_N)
    put(state, STAND + 1, PLACE, VELOCITY_N)
    measurements.stand.py_func(state)
    state.parameters.latitude, state.parameters.longitude, state.parameters.height = PLACE
    state.estimator.velocity_n[:] = 0.0
    expected = scalars(state)
    assert len(expected) == 12
    for k, (aid, _) in enumerate(expected):
        before = [int(source.used) for source in state.estimator.sources]
        assert measurements.take.py_func(state)
        before[aid] += 1
        assert [int(source.used) for source in state.estimator.sources] == before
        assert scalars(state) == expected[k + 1 :]
    assert not measurements.take.py_func(state)


def test_where_the_height_is_held_level_components_wait_alone(kit):
    state = make_state(kit, height_channel="held")
    state.modes.mode = Mode.FINE_ALIGNMENT
    measurements.stand.py_func(state)
    put(state, FIX_EPOCH, PLACE, VELOCITY_N)
    fix(state, FIX_EPOCH, PLACE, VELOCITY_N)
    put(state, STAND, PLACE, VELOCITY_N)
    assert scalars(state) == [(aid, k) for aid in list(Aid)[:4] for k in range(2)]


def test_standing_is_compared_with_where_the_filter_stands(state):
    state.modes.mode = Mode.FINE_ALIGNMENT
    measurements.stand.py_func(state)
    parameters = state.parameters
    latitude, longitude, height = PLACE
    parameters.latitude = latitude + 1.0 / NORTH
    parameters.longitude = longitude - 1.0 / EAST
    parameters.height = height + 0.5
    estimator = state.estimator
    estimator.velocity_n[:] = 0.1, -0.2, 0.3
    while measurements.take.py_func(state):
        pass
    x = estimator.x
    assert x[VELOCITY : VELOCITY + 3] == pytest.approx([-0.1, 0.2, -0.3], rel=1e-3)
    assert x[LATITUDE] * NORTH == pytest.approx(1.0, rel=1e-3)
    assert x[LONGITUDE] * EAST == pytest.approx(-1.0, rel=1e-3)
    assert x[HEIGHT] == pytest.approx(0.5, rel=1e-3)
    assert not x[BIASES:].any()


@pytest.mark.parametrize(
    ("aid", "fault"),
    [
        (Aid.ZERO_VELOCITY, AidingFault.ZERO_VELOCITY_REJECTED),
        (Aid.KNOWN_POSITION, AidingFault.KNOWN_POSITION_REJECTED),
    ],
)
def test_standing_that_is_rejected_has_a_code_until_it_ends(state, aid, fault):
    state.estimator.running = True
    state.modes.mode = Mode.FINE_ALIGNMENT
    failing = []
    for mode in (Mode.FINE_ALIGNMENT, Mode.NAVIGATION_STRAPDOWN):
        state.modes.mode = mode
        state.estimator.sources[int(aid)].distrust = NO_TRUST
        state.estimator.aligned_epoch = NEVER
        measurements.stand.py_func(state)
        monitor._look_at_aiding.py_func(state, state.diagnostics)
        failing.append(bool(state.diagnostics.failing[int(Kind.AIDING)] & 1 << fault))
    assert failing == [True, False]


def innovations(state):
    """Return innovation, sigma and row of each scalar of a fix, without taking it."""
    found = {}
    for aid in (Aid.GNSS_POSITION, Aid.GNSS_VELOCITY):
        for component in range(3):
            state.estimator.row[:] = 0.0
            value, sigma = measurements.innovation_of.py_func(state, int(aid), component)
            found[aid, component] = value, sigma, np.array(state.estimator.row[:STATES])
    return found


def test_a_fix_of_the_past_is_compared_with_the_navigation_of_its_epoch(state):
    past_velocity = VELOCITY_N - [1.0, 2.0, 0.3]
    past = PLACE - [3e-6, -2e-6, 7.0]
    put(state, FIX_EPOCH, past, past_velocity)
    beside = np.array([2.0 / NORTH, -3.0 / EAST, 1.5])
    fix(state, FIX_EPOCH, past + beside, past_velocity + np.array([0.1, 0.2, -0.3]))
    put(state, STAND + 10, PLACE, VELOCITY_N)
    found = innovations(state)
    position = [found[Aid.GNSS_POSITION, k] for k in range(3)]
    velocity = [found[Aid.GNSS_VELOCITY, k] for k in range(3)]
    assert [row[0] for row in position] == pytest.approx([2.0, -3.0, 1.5], abs=1e-8)
    assert [row[0] for row in velocity] == pytest.approx([0.1, 0.2, -0.3], abs=1e-12)
    assert [row[1] for row in position] == 3 * [1.0]
    assert [row[1] for row in velocity] == 3 * [0.1]
    # The position's error then is that of now, less what the velocity's made of it since.
    seconds = (FIX_EPOCH - STAND) * 0.005
    north, east, up = (
        {LATITUDE: NORTH, 4: seconds},
        {LONGITUDE: EAST, 3: seconds},
        {8: 1, 5: seconds},
    )
    for (_, _, row), expected in zip(position, (north, east, up), strict=True):
        assert {k: row[k] for k in np.flatnonzero(row)} == pytest.approx(expected)
    for k, (_, _, row) in enumerate(velocity):
        assert np.array_equal(row, np.eye(STATES)[VELOCITY + k])


def test_the_navigation_of_the_past_is_taken_as_corrected_since(state):
    put(state, FIX_EPOCH, PLACE, VELOCITY_N)
    fix(state, FIX_EPOCH, PLACE, VELOCITY_N)
    put(state, STAND + 10, PLACE, VELOCITY_N)
    estimator = state.estimator
    last, before = 1, 0
    estimator.correction[last] = 2.0 / NORTH, -3.0 / EAST, 1.5, 0.1, 0.2, -0.3
    estimator.correction_epoch[last] = FIX_EPOCH - 1  # the track has it already
    assert [row[0] for row in innovations(state).values()] == pytest.approx(6 * [0.0], abs=1e-9)
    estimator.correction_epoch[last] = FIX_EPOCH  # at its end, behind the track
    expected = [-2.0, 3.0, -1.5, -0.1, -0.2, 0.3]
    assert [row[0] for row in innovations(state).values()] == pytest.approx(expected, abs=1e-8)
    estimator.correction[before] = estimator.correction[last]
    estimator.correction_epoch[before] = FIX_EPOCH
    estimator.correction_epoch[last] = FIX_EPOCH + 200
    twice = [2 * value for value in expected]
    assert [row[0] for row in innovations(state).values()] == pytest.approx(twice, abs=1e-8)


def test_longitudes_are_compared_across_the_antimeridian(state):
    navigated = PLACE * [1, 0, 1] + [0, -math.pi + 1.0 / EAST, 0]
    put(state, FIX_EPOCH, navigated, VELOCITY_N)
    fix(state, FIX_EPOCH, PLACE * [1, 0, 1] + [0, math.pi - 2.0 / EAST, 0], VELOCITY_N)
    put(state, STAND, PLACE, VELOCITY_N)
    assert innovations(state)[Aid.GNSS_POSITION, 1][0] == pytest.approx(-3.0, abs=1e-6)
    state.parameters.longitude = math.pi - 2.0 / EAST
    state.estimator.longitude = -math.pi + 1.0 / EAST
    known = measurements.innovation_of.py_func(state, int(Aid.KNOWN_POSITION), 1)
    assert known == pytest.approx((-3.0, 0.02), abs=1e-6)


def test_a_receiver_that_promises_too_much_is_not_believed(state):
    put(state, FIX_EPOCH, PLACE, VELOCITY_N)
    fix(state, FIX_EPOCH, PLACE, VELOCITY_N, position_sigma=0.0, velocity_sigma=0.0)
    put(state, STAND, PLACE, VELOCITY_N)
    sigmas = [row[1] for row in innovations(state).values()]
    assert sigmas == 3 * [0.01] + 3 * [0.002]


@pytest.mark.parametrize("age", [0, 100, TRACK_EPOCHS - 1])
def test_a_fix_as_old_as_the_track_waits(state, age):
    fix(state, STAND + 100 - age, PLACE, VELOCITY_N)
    put(state, STAND + 100, PLACE, VELOCITY_N)
    assert len(scalars(state)) == 6


def test_a_fix_from_before_the_track_or_the_filter_does_not(state):
    fix(state, STAND + 100 - TRACK_EPOCHS, PLACE, VELOCITY_N)
    put(state, STAND + 100, PLACE, VELOCITY_N)
    assert scalars(state) == []
    state.estimator.track_first = STAND
    fix(state, STAND - 1, PLACE, VELOCITY_N)
    put(state, STAND + 101, PLACE, VELOCITY_N)
    assert scalars(state) == []


def test_a_fix_is_not_replaced_before_all_of_it_is_taken(state):
    put(state, FIX_EPOCH, PLACE, VELOCITY_N)
    fix(state, FIX_EPOCH, PLACE, VELOCITY_N)
    put(state, STAND, PLACE, VELOCITY_N)
    for k in range(6):
        fix(state, STAND, PLACE, VELOCITY_N)
        put(state, STAND + 1 + k, PLACE, VELOCITY_N)
        assert state.estimator.fix_epoch == FIX_EPOCH
        measurements.take.py_func(state)
    fix(state, STAND, PLACE, VELOCITY_N)
    put(state, STAND + 7, PLACE, VELOCITY_N)
    assert state.estimator.fix_epoch == STAND
    assert len(scalars(state)) == 6


def take_east(state, innovation):
    """Take a fix's velocity to the east, this far from the navigation as corrected by x."""
    estimator = state.estimator
    put(state, FIX_EPOCH, PLACE, VELOCITY_N)
    corrected = VELOCITY_N + estimator.x[VELOCITY : VELOCITY + 3]
    fix(state, FIX_EPOCH, PLACE, corrected + np.array([innovation, 0, 0]), velocity_sigma=0.4)
    put(state, STAND, PLACE, VELOCITY_N)
    estimator.waiting = 1 << COMPONENTS * Aid.GNSS_VELOCITY
    assert measurements.take.py_func(state)


@pytest.mark.parametrize("innovation", [-5.01, 5.01, math.nan, math.inf])
def test_the_gate_rejects_counts_and_leaves_all_alone(state, innovation):
    estimator, source = state.estimator, state.estimator.sources[Aid.GNSS_VELOCITY]
    estimator.x[:STATES] = 0.01
    before = estimator.x.copy(), estimator.P.copy()
    sigma = math.hypot(0.3, 0.4)  # of the state, and of the measurement
    for k in range(1, 4):
        take_east(state, innovation * sigma)
        assert (source.used, source.rejected, source.rejected_in_a_row) == (0, k, k)
    assert np.array_equal(estimator.x, before[0])
    assert np.array_equal(estimator.P, before[1])
    assert source.squares == 0.0


@pytest.mark.parametrize("innovation", [-4.99, 0.5, 4.99])
def test_what_passes_the_gate_is_used_and_ends_a_row_of_rejections(state, innovation):
    estimator, source = state.estimator, state.estimator.sources[Aid.GNSS_VELOCITY]
    source.rejected = source.rejected_in_a_row = 3
    estimator.x[VELOCITY] = 0.01
    take_east(state, innovation * 0.5)
    assert (source.used, source.rejected, source.rejected_in_a_row) == (1, 3, 0)
    assert source.squares == pytest.approx(innovation**2)
    share = 0.3**2 / 0.5**2
    assert estimator.x[VELOCITY] == pytest.approx(0.01 + share * innovation * 0.5)
    assert estimator.P[VELOCITY, VELOCITY] == pytest.approx(0.3**2 * (1 - share))


ARM_B = np.array([0.5, -2.0, 1.5])
RATE_N = np.array([0.1, -0.2, 0.5])


def turning(tools, state, first=FIX_EPOCH - 50, last=STAND):
    """Let the antenna turn with a body, over some epochs."""
    state.antenna.present, state.antenna.lever_arm_b[:] = True, ARM_B
    state.modes.mode = Mode.NAVIGATION_ROTATING
    for epoch in range(first, last + 1):
        state.epoch = epoch
        state.ins.C_s_n[:] = tools.exponential(RATE_N * (epoch - FIX_EPOCH) * 0.005)
        state.C_s_b[:] = np.eye(3)
        antenna.follow.py_func(state)


def test_a_fix_of_an_antenna_away_is_referred_to_the_reference_point(tools, state):
    turning(tools, state)
    put(state, FIX_EPOCH, PLACE, VELOCITY_N)
    moving = np.cross(RATE_N, ARM_B)
    east, north, up = ARM_B
    fix(state, FIX_EPOCH, PLACE + np.array([north / NORTH, east / EAST, up]), VELOCITY_N + moving)
    put(state, STAND, PLACE, VELOCITY_N)
    found = innovations(state)
    assert [row[0] for row in found.values()] == pytest.approx(6 * [0.0], abs=1e-4)
    # A small turn of the attitude moves the antenna: by differences.
    for k, axis in enumerate((1, 0, 2)):
        for aid, vector, place in (
            (Aid.GNSS_POSITION, ARM_B, k),
            (Aid.GNSS_VELOCITY, moving, axis),
        ):
            row = found[aid, place][2][ATTITUDE : ATTITUDE + 3]
            turned = [(tools.exponential(1e-6 * one) @ vector)[axis] for one in np.eye(3)]
            expected = (np.array(turned) - vector[axis]) / 1e-6
            assert row == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("first", "last", "exact"),
    [(-50, 50, True), (-50, 1, True), (-50, 0, False), (0, 50, False), (0, 0, None)],
)
def test_the_antennas_velocity_is_of_the_epochs_around(tools, state, first, last, exact):
    turning(tools, state, FIX_EPOCH + first, FIX_EPOCH + last)
    assert antenna.is_known.py_func(state.antenna, FIX_EPOCH)
    assert not antenna.is_known.py_func(state.antenna, FIX_EPOCH + last + 1)
    assert not antenna.is_known.py_func(state.antenna, FIX_EPOCH + first - 1)
    out = np.zeros(3)
    antenna.velocity.py_func(state.antenna, FIX_EPOCH, 0.005, out)
    expected = np.zeros(3) if exact is None else np.cross(RATE_N, ARM_B)
    # Without an epoch on one side it is of half an epoch beside: half a period of acceleration.
    assert out == pytest.approx(expected, abs=1e-4 if exact else 2e-3)


def test_the_mean_of_a_seconds_heights_is_a_measurement(kit):
    state = make_state(kit, altimeter=True, height_channel="damped")
    estimator, bias = state.estimator, state.estimator.altimeter_state
    assert (estimator.states, bias) == (STATES + 1, STATES)
    estimator.altimeter_bias = 2.0
    for k in range(1, estimator.second_epochs + 1):
        state.assembly.altimeter_received = k % 20 == 0
        state.assembly.altimeter_height = PLACE[2] + 2.5 + 0.1 * (-1) ** (k // 20)
        put(state, STAND + k, PLACE, VELOCITY_N)
    measurements.finish_second.py_func(state)
    assert scalars(state) == [(Aid.ALTIMETER, 0)]
    estimator.row[:] = 0.0
    value, sigma = measurements.innovation_of.py_func(state, int(Aid.ALTIMETER), 0)
    assert (value, sigma) == pytest.approx((0.5, 0.5 / math.sqrt(10)))
    row = {k: estimator.row[k] for k in np.flatnonzero(estimator.row)}
    # Its mean time is that of the epochs 20, 40, … 200 of 200.
    assert row == pytest.approx({HEIGHT: 1.0, VELOCITY + 2: -0.45, bias: 1.0})
    assert (estimator.heights, estimator.height_sum, estimator.height_epochs) == (0, 0.0, 0)
    estimator.waiting = 0
    measurements.finish_second.py_func(state)
    assert scalars(state) == []


def test_heights_that_wait_are_those_of_the_navigation_as_corrected(kit):
    state = make_state(kit, altimeter=True, height_channel="damped")
    estimator = state.estimator
    for k in range(1, estimator.second_epochs + 1):
        state.assembly.altimeter_received = True
        state.assembly.altimeter_height = PLACE[2] + 2.0 + 0.1 * k / estimator.second_epochs
        put(state, STAND + k, PLACE, VELOCITY_N)
    measurements.finish_second.py_func(state)
    state.ins.q_s_n[0] = 1.0
    estimator.x[HEIGHT], estimator.x[VELOCITY + 2] = 2.1, 0.1  # at the end of the second
    feedback.apply.py_func(state)
    assert measurements.innovation_of.py_func(state, int(Aid.ALTIMETER), 0)[0] == pytest.approx(0.0)
