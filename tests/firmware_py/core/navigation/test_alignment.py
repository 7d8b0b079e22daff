"""Coarse alignment: exact on perfect increments, the known first-order errors on others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.firmware_py.core.maths import attitude, earth
from rrins.firmware_py.core.navigation import alignment
from rrins.firmware_py.core.records.memory import Alignment

DT, EPOCHS = 0.005, 20
ANGLE = st.floats(-3.1, 3.1)


def summed(dtheta, dv, epochs=EPOCHS):
    """Return an alignment that has had the same increments in every epoch."""
    record = np.zeros(1, dtype=Alignment.dtype)[0]
    alignment.begin(record)
    for _ in range(epochs):
        alignment.accumulate(record, dtheta, dv)
    return record


def found(record, gravity):
    alignment.find(record, DT, gravity, np.empty((3, 3)))
    return record


def at_rest(tools, C_s_n, latitude):
    gravity = earth.gravity(latitude, 0.0)
    dtheta = C_s_n.T @ tools.earth_rate_n(latitude) * DT
    return dtheta, C_s_n.T @ [0.0, 0.0, gravity * DT], gravity


@pytest.mark.slow
@settings(max_examples=50)
@given(ANGLE, st.floats(-1.5, 1.5), ANGLE, st.floats(-1.4, 1.4))
def test_perfect_increments_give_the_attitude(tools, roll, pitch, heading, latitude):
    C = tools.body_to_navigation(roll, pitch, heading)
    dtheta, dv, gravity = at_rest(tools, C, latitude)
    record = found(summed(dtheta, dv), gravity)
    assert record["done"]
    assert not record["failed"]
    assert record["C_s_n"] == pytest.approx(C, abs=1e-12)


def test_an_accelerometer_bias_tilts_by_its_share_of_gravity(tools):
    bias, latitude = 1e-4, 0.7
    dtheta, dv, gravity = at_rest(tools, np.eye(3), latitude)
    record = found(summed(dtheta, dv + np.array([bias, 0, 0]) * DT), gravity)
    roll, pitch, _ = attitude.euler_of_matrix(record["C_s_n"])
    assert roll == pytest.approx(-bias / gravity, rel=1e-4)
    assert pitch == pytest.approx(0, abs=1e-9)
    record = found(summed(dtheta, dv + np.array([0, bias, 0]) * DT), gravity)
    _, pitch, _ = attitude.euler_of_matrix(record["C_s_n"])
    assert pitch == pytest.approx(bias / gravity, rel=1e-4)


def test_an_east_gyro_bias_turns_the_heading(tools):
    bias, latitude = 1e-8, 0.7
    dtheta, dv, gravity = at_rest(tools, np.eye(3), latitude)
    record = found(summed(dtheta + np.array([bias, 0, 0]) * DT, dv), gravity)
    heading = attitude.euler_of_matrix(record["C_s_n"])[2]
    heading = math.remainder(heading, 2 * math.pi)
    assert abs(heading) == pytest.approx(bias / (earth.RATE * math.cos(latitude)), rel=1e-4)
    # North is taken to be where the horizontal rate points: east of it, so the nose seems west.
    assert heading < 0


def test_a_north_or_up_gyro_bias_leaves_the_heading(tools):
    dtheta, dv, gravity = at_rest(tools, np.eye(3), 0.7)
    record = found(summed(dtheta + np.array([0, 1e-8, 1e-8]) * DT, dv), gravity)
    assert record["C_s_n"] == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize("factor", [0.0, 0.97, 1.03, -1.0, math.nan])
def test_a_specific_force_that_is_not_gravity_fails(tools, factor):
    dtheta, dv, gravity = at_rest(tools, np.eye(3), 0.7)
    record = found(summed(dtheta, dv * abs(factor) if factor < 0 else dv * factor), gravity)
    assert bool(record["failed"]) == (factor != -1.0)
    assert bool(record["done"]) == (factor == -1.0)


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_gravity_may_be_off_by_a_percent(tools, factor):
    dtheta, dv, gravity = at_rest(tools, np.eye(3), 0.7)
    assert found(summed(dtheta, dv * factor), gravity)["done"]


def test_there_is_no_north_at_the_pole_nor_without_rate(tools):
    dtheta, dv, gravity = at_rest(tools, np.eye(3), math.pi / 2)
    assert found(summed(dtheta, dv), gravity)["failed"]
    assert found(summed(0 * dtheta, dv), gravity)["failed"]
    assert not found(summed(dtheta, dv), gravity)["done"]


def test_a_new_alignment_forgets_the_one_before(tools):
    dtheta, dv, gravity = at_rest(tools, np.eye(3), 0.7)
    record = found(summed(dtheta, 2 * dv), gravity)
    assert record["failed"]
    alignment.begin(record)
    for _ in range(EPOCHS):
        alignment.accumulate(record, dtheta, dv)
    assert found(record, gravity)["C_s_n"] == pytest.approx(np.eye(3), abs=1e-12)
    assert not record["failed"]


@given(ANGLE, ANGLE)
def test_a_given_attitude_goes_through_the_tables_angles(tools, heading, inner):
    C_b_n, C_s_b = tools.body_to_navigation(0.1, 0.2, heading), tools.rotation(2, inner)
    record = summed(np.zeros(3), np.zeros(3), 1)
    alignment.set_given(record, C_b_n, C_s_b)
    assert record["done"]
    assert record["C_s_n"] == pytest.approx(C_b_n @ C_s_b, abs=1e-15)


def started(rate_s, unit, epochs, limit=None):
    """Return the turn (counts) that the correction makes, and what the gyros hold back (counts)."""
    record = np.zeros(1, dtype=Alignment.dtype)[0]
    alignment.begin(record)
    record["C_s_n"] = np.eye(3)
    angle = np.asarray(rate_s) * DT / unit
    for k in range(1, epochs + 1):
        counts = np.rint(angle * k) - np.rint(angle * (k - 1))
        alignment.accumulate(record, counts * unit, np.zeros(3))
    alignment.apply_held_back(record, unit if limit is None else limit, np.empty((2, 3)))
    turn = np.array([record["C_s_n"][2, 1], record["C_s_n"][0, 2], record["C_s_n"][1, 0]])
    return turn / unit, angle * epochs - np.rint(angle * epochs)


def test_what_the_gyros_hold_back_is_corrected_to_well_below_half_a_count():
    # The next frames will bring what is held back: the attitude must start without it.
    random = np.random.default_rng(3)
    left, held = [], []
    for rate in random.uniform(-7.3e-5, 7.3e-5, (40, 3)):
        turn, held_back = started(rate, 4e-9, 400)
        left.extend(turn + held_back)
        held.extend(held_back)
    assert np.std(held) == pytest.approx(1 / math.sqrt(12), rel=0.15)
    assert np.std(left) < np.std(held) / 5
    assert np.max(np.abs(left)) < 0.3


def test_the_correction_is_limited_to_a_count():
    record = np.zeros(1, dtype=Alignment.dtype)[0]
    alignment.begin(record)
    record["C_s_n"] = np.eye(3)
    for k in range(100):
        jolt = np.array([1e-3, -1e-3, 0.0]) if k == 99 else np.zeros(3)
        alignment.accumulate(record, jolt, np.zeros(3))
    alignment.apply_held_back(record, 4e-9, np.empty((2, 3)))
    assert record["C_s_n"] == pytest.approx(
        np.eye(3) + 4e-9 * np.array([[0, 0, -1], [0, 0, -1], [1, 1, 0]]), abs=1e-20
    )


@pytest.mark.parametrize("epochs", [0, 1, 2])
def test_too_few_epochs_for_a_line_leave_the_attitude(epochs):
    turn, _ = started([7e-5, 3e-5, 1e-5], 4e-9, epochs)
    assert not turn.any()
