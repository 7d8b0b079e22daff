"""Accelerometers away from the reference point, against the motion of a point on a rigid body."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rrins.host_tools.hardware import truth
from rrins.host_tools.hardware.memory import INNER, MOTION_CHANNELS, MOTION_TERMS, OUTER, Plant
from rrins.host_tools.hardware.tables import Accelerometers

NO_MOTION = np.zeros((1, MOTION_CHANNELS, MOTION_TERMS))
XYZ = np.eye(3)
DT = 0.005


def block_of(positions, omega_b=(0.0, 0.0, 0.0), first_epoch=0):
    """Return a plant with three accelerometers along x, y and z at positions of theirs, m."""
    plant = np.zeros(1, dtype=Plant.dtype)[0]
    plant["omega_ib_b"], plant["epoch"] = omega_b, first_epoch
    sensors = plant["accelerometers"]
    sensors["count"], sensors["displaced"] = 3, True
    sensors["axis"][:3], sensors["position_s"][:3] = XYZ, positions
    return plant


def turn(plant, which, angle, rate, change=0.0):
    """Let an axis turn over the next epoch, its rate linear in time."""
    axis = plant["axis"][which]
    axis["angle_before"], axis["rate_before"] = angle, rate
    axis["angle"], axis["rate"] = angle + (rate + change / 2) * DT, rate + change


def arms(plant):
    truth.integrate(plant, NO_MOTION, DT)
    plant["epoch"] += 1
    return plant["accelerometers"]["arm_increment"][:3].copy()


@pytest.mark.parametrize("which", [INNER, OUTER])
@pytest.mark.parametrize("by_vehicle", [False, True])
def test_at_a_constant_rate_the_force_is_omega_squared_r_to_the_axis(which, by_vehicle):
    omega, radius = 0.7, 0.05
    across = 0 if which == INNER else 1
    position = radius * XYZ[across]
    plant = block_of([position] * 3)
    if by_vehicle:  # the whole vehicle turns, the table rests
        plant["omega_ib_b"] = omega * (XYZ[2] if which == INNER else XYZ[0])
    for epoch in range(5):
        if not by_vehicle:
            turn(plant, which, omega * epoch * DT, omega)
        felt = arms(plant)
        expected = -(omega**2) * radius * DT * XYZ[across]
        assert felt == pytest.approx(expected, abs=1e-15)


def test_a_rate_that_jumps_is_felt_as_a_blow():
    plant = block_of([[0.1, 0.0, 0.0]] * 3)
    assert arms(plant) == pytest.approx(0)
    turn(plant, INNER, 0.0, 0.3)
    assert arms(plant)[1] == pytest.approx(0.03)
    turn(plant, INNER, 0.3 * DT, 0.3)
    assert arms(plant)[1] == pytest.approx(0)
    axis = plant["axis"][INNER]
    axis["angle_before"], axis["rate_before"], axis["rate"] = axis["angle"], 0.0, 0.0  # blocked
    assert arms(plant)[1] == pytest.approx(-0.03)
    assert arms(plant) == pytest.approx(0, abs=1e-18)


RATE, CHANGE, ANGLE = st.floats(-1, 1), st.floats(-0.01, 0.01), st.floats(-3, 3)
PLACE = st.tuples(*[st.floats(-0.2, 0.2)] * 3)


@pytest.mark.slow
@settings(max_examples=25)
@given(PLACE, PLACE, ANGLE, ANGLE, st.tuples(RATE, RATE, CHANGE, CHANGE), st.floats(0, 0.01))
def test_both_axes_and_the_vehicle_together(place, omega_b, inner, outer, rates, tilt):
    # The reference: positions of the point in inertial space, differentiated numerically.
    plant = block_of([place] * 3, omega_b)
    plant["table"]["non_orthogonality"], plant["table"]["is_crooked"] = tilt, tilt != 0
    moves = ((inner, *rates[::2]), (outer, *rates[1::2]))

    def at(t):
        return [angle + rate * t + change / DT * t * t / 2 for angle, rate, change in moves]

    def attitude(t):
        """Return C_s_i; i is b as it was at t = 0."""
        inner_at, outer_at = at(t)
        return (
            Rotation.from_rotvec(np.array(omega_b) * t)
            * Rotation.from_rotvec([outer_at, 0, 0])
            * Rotation.from_rotvec([0, tilt, 0])
            * Rotation.from_rotvec([0, 0, inner_at])
        )

    def force(t, h=2e-3):
        ends = [attitude(t + k * h).apply(place) for k in (-2, -1, 0, 1, 2)]
        second = (-ends[0] + 16 * ends[1] - 30 * ends[2] + 16 * ends[3] - ends[4]) / (12 * h * h)
        return attitude(t).inv().apply(second)

    for epoch in range(2):
        begin = at(epoch * DT), [rate + epoch * change for _, rate, change in moves]
        for which in (INNER, OUTER):
            turn(plant, which, begin[0][which], begin[1][which], moves[which][2])
        felt = arms(plant)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    expected = sum(
        w * DT / 2 * force(DT + DT * (n + 1) / 2) for n, w in zip(nodes, weights, strict=True)
    )
    assert felt == pytest.approx(expected, abs=2e-8)


def test_what_the_bus_carries_holds_it(tools):
    # Through the whole step: 60 mm from the inner axis, turned at 20 °/s.
    position = 0.06
    rows = []
    for arm in (position, 0.0):
        bench = tools.Bench(
            accelerometer_axes_deg=((90.0, 0.0), (90.0, 90.0), (0.0, 0.0)),
            accelerometers=Accelerometers(position_x_mm=arm * 1e3),
        )
        sums = [0.0]
        for _ in range(1200):
            frames = bench.commanded_step(inner={"target_deg": 3600.0, "rate_dps": 20.0})
            sums.append(sums[-1] + frames["SENSOR_1"]["accelerometer_dv"])
        rows.append(sums)
    count = 800  # epochs after the ramp
    with_arm, without = (row[-1] - row[-1 - count] for row in rows)
    expected = -(math.radians(20) ** 2) * position * count * DT
    assert with_arm - without == pytest.approx(expected, rel=1e-3)
