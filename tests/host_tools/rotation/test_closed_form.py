"""The antiderivatives against the paper's integrands, written down as the paper has them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import cos, sign, sin

from rrins.host_tools.hardware.units import STANDARD_GRAVITY as G
from rrins.host_tools.rotation.analysis import SPECIFIC_FORCE_B
from rrins.host_tools.rotation.closed_form import leg_integral
from rrins.host_tools.rotation.errors import BIAS, MEASF, MEIE, MESSF
from rrins.host_tools.rotation.kinematics import INNER, OUTER, Leg

from .conftest import si_sensors

NO_FIELD = np.zeros(3)
RATE = math.radians(2.0)


def eq_26(a, b, t):
    return [sin(a) * cos(b + t), sin(a) * sin(b + t), cos(a) + 0 * t]


def eq_27(a, b, t):
    y = sin(a) * sin(b) * cos(t) - cos(a) * sin(t)
    z = sin(a) * sin(b) * sin(t) + cos(a) * cos(t)
    return [sin(a) * cos(b) + 0 * t, y, z]


def eq_29(a, b, t):
    return [
        RATE * cos(a) * (cos(t) * sin(a) * cos(b) - sin(t) * sin(a) * sin(b)),
        RATE * cos(a) * (sin(t) * sin(a) * cos(b) + cos(t) * sin(a) * sin(b)),
        RATE * cos(a) * cos(a) + 0 * t,
    ]


def eq_30(a, b, t):
    along = RATE * sin(a) * cos(b)
    return [
        along * sin(a) * cos(b) + 0 * t,
        along * (cos(t) * sin(a) * sin(b) - sin(t) * cos(a)),
        along * (sin(t) * sin(a) * sin(b) + cos(t) * cos(a)),
    ]


def eq_32(a, b, t):
    return sign(RATE * cos(a)) * np.array(eq_29(a, b, t))


def eq_33(a, b, t):
    return sign(RATE * sin(a) * cos(b)) * np.array(eq_30(a, b, t))


def eq_37(a, b, t):
    return [
        G * cos(a) * (cos(t) * sin(a) * cos(b) - sin(t) * sin(a) * sin(b)),
        G * cos(a) * (sin(t) * sin(a) * cos(b) + cos(t) * sin(a) * sin(b)),
        G * cos(a) * cos(a) + 0 * t,
    ]


def eq_38(a, b, t):
    return [
        G * (sin(t) * sin(a) ** 2 * sin(b) * cos(b) + cos(t) * sin(a) * cos(a) * cos(b)),
        G
        * (
            sin(2 * t) / 2 * (sin(a) ** 2 * sin(b) ** 2 - cos(a) ** 2)
            + cos(2 * t) * sin(a) * cos(a) * sin(b)
        ),
        G
        * (
            sin(t) ** 2 * sin(a) ** 2 * sin(b) ** 2
            + cos(t) ** 2 * cos(a) ** 2
            + sin(2 * t) * sin(a) * cos(a) * sin(b)
        ),
    ]


def eq_40(a, b, t):
    return sign(cos(a)) * np.array(eq_37(a, b, t))


def eq_41(a, b, t):
    along = sin(t) * sin(a) * sin(b) + cos(t) * cos(a)
    across = cos(t) * sin(a) * sin(b) - sin(t) * cos(a)
    return G * sign(along) * np.array([sin(a) * cos(b) * along, along * across, along**2])


CASES = [
    ("gyro", BIAS, INNER, eq_26),
    ("gyro", BIAS, OUTER, eq_27),
    ("gyro", MESSF, INNER, eq_29),
    ("gyro", MESSF, OUTER, eq_30),
    ("gyro", MEASF, INNER, eq_32),
    ("gyro", MEASF, OUTER, eq_33),
    ("accelerometer", MESSF, INNER, eq_37),
    ("accelerometer", MESSF, OUTER, eq_38),
    ("accelerometer", MEASF, INNER, eq_40),
    ("accelerometer", MEASF, OUTER, eq_41),
]


def integral_over_turn(integrand, turn_deg):
    """Integrate over time by the midpoint rule, fine enough for a kink inside."""
    count = 40_000
    angle = math.radians(turn_deg) * (np.arange(count) + 0.5) / count
    duration_s = math.radians(abs(turn_deg)) / RATE
    return np.mean(np.broadcast_to(integrand(angle), (3, count)), axis=1) * duration_s


@pytest.mark.parametrize("turn_deg", [180.0, 77.0])
@pytest.mark.parametrize(("alpha_deg", "beta_deg"), [(70.53, 120.0), (130.0, -35.0)])
@pytest.mark.parametrize(("kind", "error", "axis", "equation"), CASES)
def test_each_equation_of_the_paper(kind, error, axis, equation, alpha_deg, beta_deg, turn_deg):
    sensors = si_sensors(kind, ((alpha_deg, beta_deg),), bias=1.0, scale=1.0, asymmetric=1.0)
    field = NO_FIELD if kind == "gyro" else SPECIFIC_FORCE_B
    leg = Leg(1, axis, (0.0, 0.0), turn_deg, math.radians(turn_deg) / RATE)
    expected = integral_over_turn(
        lambda t: equation(math.radians(alpha_deg), math.radians(beta_deg), t), turn_deg
    )
    ours = leg_integral(leg, sensors, field)[0, error]
    assert ours == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


@given(
    alpha_deg=st.floats(0, 180),
    beta_deg=st.floats(-180, 180),
    delta=st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)),
    start=st.tuples(st.floats(-720, 720), st.floats(-720, 720)),
)
def test_an_installation_error_is_the_change_of_the_axis(alpha_deg, beta_deg, delta, start):
    """(34): in first order, an axis h' with no error sees (h' - h) x more than h."""
    sensors = si_sensors(
        "accelerometer", ((alpha_deg, beta_deg),), delta_u=delta[0], delta_v=delta[1]
    )
    leg = Leg(1, None, start, 0.0, 5.0)
    inner, outer = np.radians(start)
    C_s_b = np.array(
        [[1, 0, 0], [0, cos(outer), -sin(outer)], [0, sin(outer), cos(outer)]]
    ) @ np.array([[cos(inner), -sin(inner), 0], [sin(inner), cos(inner), 0], [0, 0, 1]])
    a, b = math.radians(alpha_deg), math.radians(beta_deg)
    h = np.array([sin(a) * cos(b), sin(a) * sin(b), cos(a)])
    u = np.array([cos(a) * cos(b), cos(a) * sin(b), -sin(a)])
    v = np.array([-sin(b), cos(b), 0])
    expected = -(delta[0] * v + delta[1] * u) @ C_s_b.T @ [0, 0, G] * (C_s_b @ h) * 5.0
    ours = leg_integral(leg, sensors, SPECIFIC_FORCE_B)[0, MEIE]
    assert ours == pytest.approx(expected, abs=1e-13)
