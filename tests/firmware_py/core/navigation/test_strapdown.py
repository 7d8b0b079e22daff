"""Strapdown navigation against motions whose truth is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rrins.firmware_py.core.maths import attitude, earth
from rrins.firmware_py.core.navigation import strapdown

A, E2 = earth.SEMI_MAJOR_AXIS, earth.ECCENTRICITY_SQUARED
DT = 0.005
LATITUDE = math.radians(40)
FAR_NORTH = math.radians(85)  # the Coriolis force hardly couples up with east here
HELD, DAMPED, FREE = strapdown.HEIGHT_HELD, strapdown.HEIGHT_DAMPED, strapdown.HEIGHT_FREE


def at_rest(tools, latitude, height=0.0, C_s_n=None):
    """Return the increments of a standing vehicle."""
    C_n_s = np.eye(3) if C_s_n is None else np.transpose(C_s_n)
    up = np.array([0.0, 0.0, earth.gravity(latitude, height)])
    return C_n_s @ tools.earth_rate_n(latitude) * DT, C_n_s @ up * DT


def angles_between(q, C_s_n):
    """Return the small rotation vector (rad) from an attitude in n to that of the quaternions."""
    C = np.empty((3, 3))
    attitude.matrix_of_quaternion(C, q)
    D = C @ np.transpose(C_s_n)
    return np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2


def coning_drift(half_angle, rate, dt, corrected, seconds=2.0):
    """Return the attitude error after coning; the quaternion is known in closed form."""
    t = dt * np.arange(round(seconds / dt) + 1)
    sine, slow = math.sin(half_angle), 2 * rate * math.sin(half_angle / 2) ** 2
    integral = np.column_stack([sine * np.cos(rate * t), sine * np.sin(rate * t), -slow * t])

    def truth(when):
        s = math.sin(half_angle / 2)
        return np.array(
            [math.cos(half_angle / 2), s * math.cos(rate * when), s * math.sin(rate * when), 0.0]
        )

    increments = np.diff(integral, axis=0)
    before = integral[0] - np.array(
        [sine * math.cos(-rate * dt), sine * math.sin(-rate * dt), slow * dt]
    )
    q, turn, product, phi = truth(0.0), np.empty(4), np.empty(4), np.empty(3)
    for increment in increments:
        strapdown.rotation_vector(phi, increment, before if corrected else increment)
        attitude.quaternion_of_vector(turn, phi)
        attitude.multiply(product, q, turn)
        q[:] = product
        before = increment
    C = np.empty((3, 3))
    attitude.matrix_of_quaternion(C, truth(t[-1]))
    return float(np.linalg.norm(angles_between(q, C)))


def test_coning_is_corrected_by_orders_of_magnitude():
    half_angle, rate, dt = math.radians(1), 2 * math.pi * 5, DT
    x = rate * dt
    plain = coning_drift(half_angle, rate, dt, corrected=False)
    # What the sum of increments misses, Savage (1998): Ω sin² a / 2 (1 - sin x / x).
    assert plain == pytest.approx(rate * half_angle**2 / 2 * x**2 / 6 * 2.0, rel=0.01)
    assert coning_drift(half_angle, rate, dt, corrected=True) < plain / 200


def test_coning_error_falls_with_the_fourth_power_of_the_period():
    errors = [coning_drift(0.02, 40.0, dt, corrected=True) for dt in (0.01, 0.005)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.1)


def sculling_error(tools, rate, dt, corrected):
    """Return the error of vertical velocity when roll and sideways force swing in phase."""
    tilt, force, seconds = 0.02, 5.0, 2.0
    t = dt * np.arange(-1, round(seconds / dt) + 1)
    theta, dv = tilt * np.sin(rate * t), -force / rate * np.cos(rate * t)
    ins = tools.Ins(np.eye(3), LATITUDE).record
    out, total = np.empty(3), np.zeros(3)
    for k in range(2, len(t)):
        dtheta_s, dv_s = np.diff(theta)[k - 1] * np.eye(3)[0], np.diff(dv)[k - 1] * np.eye(3)[1]
        ins.dtheta_s_previous[0] = np.diff(theta)[k - 2] if corrected else theta[k] - theta[k - 1]
        ins.dv_s_previous[1] = np.diff(dv)[k - 2] if corrected else dv[k] - dv[k - 1]
        strapdown.velocity_in_start_frame(ins, out, dtheta_s, dv_s)
        total += tools.rotation(0, theta[k - 1]) @ out
    nodes, weights = np.polynomial.legendre.leggauss(60)
    periods = round(seconds * rate / (2 * math.pi))
    phase = math.pi * (nodes + 1)
    over_one = np.sum(weights * force * np.sin(phase) * np.sin(tilt * np.sin(phase))) * math.pi
    return abs(total[2] - periods * over_one / rate)


@pytest.mark.slow
def test_sculling_is_corrected_by_orders_of_magnitude(tools):
    rate, dt = 2 * math.pi * 5, 0.01
    plain = sculling_error(tools, rate, dt, corrected=False)
    assert sculling_error(tools, rate, dt, corrected=True) < plain / 50


def test_a_constant_turn_and_force_are_integrated_to_second_order(tools):
    ins = tools.Ins(np.eye(3), LATITUDE).record
    dtheta, dv, out = np.array([0.0, 0.0, 0.01]), np.array([0.03, 0.0, 0.04]), np.empty(3)
    ins.dtheta_s_previous[:], ins.dv_s_previous[:] = dtheta, dv
    strapdown.velocity_in_start_frame(ins, out, dtheta, dv)
    a = 0.01
    expected = [0.03 * math.sin(a) / a, 0.03 * (1 - math.cos(a)) / a, 0.04]
    assert out == pytest.approx(expected, abs=0.03 * a**3 / 23)  # the third order is left out


ANGLE = st.floats(-math.pi, math.pi)


@pytest.mark.slow
@settings(max_examples=20)
@given(st.floats(-1.5, 1.5), ANGLE, st.floats(-1.5, 1.5), ANGLE, st.floats(-100, 10_000))
def test_a_standing_vehicle_stays_where_and_as_it_is(tools, latitude, roll, pitch, yaw, height):
    C = tools.body_to_navigation(roll, pitch, yaw)
    ins = tools.Ins(C, latitude, 1.0, height)
    run = ins.run(*at_rest(tools, latitude, height, C), DT, 2000)
    assert run.velocity[-1] == pytest.approx(np.zeros(3), abs=1e-10)
    assert run.latitude[-1] == pytest.approx(latitude, abs=1e-15)
    assert run.longitude[-1] == pytest.approx(1.0, abs=1e-15)
    # 1e-15 an epoch is 5e-8 °/h; rounding reaches half of that.
    assert angles_between(run.q[-1], C) == pytest.approx(np.zeros(3), abs=2000 * 1e-15)


@pytest.mark.parametrize("speed", [300.0, -300.0])
def test_a_flight_along_a_parallel_keeps_it(tools, speed):
    height = 1000.0
    _, prime_vertical = earth.radii(LATITUDE)
    east = speed / (prime_vertical + height)
    w_ie = tools.earth_rate_n(LATITUDE)
    w_en = np.array([0.0, east, east * math.tan(LATITUDE)])
    v = np.array([speed, 0.0, 0.0])
    f = np.cross(2 * w_ie + w_en, v) + np.array([0, 0, earth.gravity(LATITUDE, height)])
    ins = tools.Ins(np.eye(3), LATITUDE, 0.0, height)
    ins.record.velocity_n[0] = speed
    run = ins.run((w_ie + w_en) * DT, f * DT, DT, 120_000, channel=FREE)
    longitude = east / math.cos(LATITUDE) * run.time[-1]
    assert run.longitude[-1] == pytest.approx(longitude, rel=1e-10)
    assert run.latitude[-1] == pytest.approx(LATITUDE, abs=1e-10)
    assert run.height[-1] == pytest.approx(height, abs=1e-3)
    assert run.velocity[-1] == pytest.approx(v, abs=1e-5)


def test_a_flight_along_a_meridian_keeps_it(tools):
    speed, n = 300.0, 120_000
    t = DT * (np.arange(n) + 0.5)
    fine = np.concatenate([[0.0], t])
    latitude = np.empty(n)
    here = LATITUDE
    for k in range(n):  # Heun's method is far better than needed in so short steps
        h = fine[k + 1] - fine[k]
        slope = speed / earth.radii(here)[0]
        here += h * (slope + speed / earth.radii(here + h * slope)[0]) / 2
        latitude[k] = here
    root = 1 - E2 * np.sin(latitude) ** 2
    meridian = A * (1 - E2) / root**1.5
    w_ie = earth.RATE * np.column_stack([0 * t, np.cos(latitude), np.sin(latitude)])
    w_en = np.column_stack([-speed / meridian, 0 * t, 0 * t])
    f = np.cross(2 * w_ie + w_en, [0.0, speed, 0.0])
    f[:, 2] += [earth.gravity(p, 0.0) for p in latitude]
    ins = tools.Ins(np.eye(3), LATITUDE)
    ins.record.velocity_n[1] = speed
    run = ins.run((w_ie + w_en) * DT, f * DT, DT, n)
    end = here + 0.5 * DT * speed / earth.radii(here)[0]
    assert run.latitude[-1] == pytest.approx(end, abs=1e-8)
    assert run.longitude[-1] == pytest.approx(0.0, abs=1e-8)
    assert run.velocity[-1] == pytest.approx([0, speed, 0], abs=1e-3)


def test_a_tilt_swings_with_the_period_of_schuler(tools):
    # On the equator, the tilt about north: v = √(gR) tilt sin(ωt), no Foucault, no Earth's loop.
    tilt = 1e-6
    g, R = earth.gravity(0.0, 0.0), A
    ins = tools.Ins(tools.rotation(1, tilt), 0.0)
    run = ins.run(*at_rest(tools, 0.0), DT, 1_100_000, every=200)
    omega = math.sqrt(g / R)
    assert 2 * math.pi / omega / 60 == pytest.approx(84.5, abs=0.1)
    amplitude = math.sqrt(g * R) * tilt
    expected = amplitude * np.sin(omega * run.time)
    assert run.velocity[:, 0] == pytest.approx(expected, abs=1e-4 * amplitude)
    assert run.longitude * R == pytest.approx(
        R * tilt * (1 - np.cos(omega * run.time)), abs=1e-4 * R * tilt
    )


def test_a_free_height_diverges_as_physics_has_it(tools):
    ins = tools.Ins(np.eye(3), FAR_NORTH)
    ins.record.height = 1.0
    run = ins.run(*at_rest(tools, FAR_NORTH), DT, 200_000, every=1000, channel=FREE)
    gradient = earth.gravity(FAR_NORTH, 0.0) - earth.gravity(FAR_NORTH, 1.0)
    expected = np.cosh(math.sqrt(gradient) * run.time)
    assert run.height[-1] > 2
    assert run.height == pytest.approx(expected, rel=1e-4)


def test_a_damped_height_returns_with_three_equal_time_constants(tools):
    ins = tools.Ins(np.eye(3), FAR_NORTH)
    ins.record.height = 1.0
    run = ins.run(*at_rest(tools, FAR_NORTH), DT, 400_000, every=1000, channel=DAMPED)
    x = run.time / 100.0  # s³ + 3 s² + 3 s + 1 = 0 from 1, -3 and 6: a triple root
    assert run.height == pytest.approx((1 - 2 * x + x**2 / 2) * np.exp(-x), abs=1e-3)
    assert abs(run.height[-1]) < 1e-5


@pytest.mark.parametrize("channel", [HELD, DAMPED])
def test_a_wrong_vertical_force_does_not_run_away(tools, channel):
    dtheta, dv = at_rest(tools, LATITUDE)
    ins = tools.Ins(np.eye(3), LATITUDE, height=100.0)
    run = ins.run(dtheta, dv * (1 + 1e-5), DT, 400_000, every=1000, channel=channel)
    assert run.height[-1] == pytest.approx(100.0, abs=0.0 if channel == HELD else 0.01)
    assert abs(run.velocity[-1, 2]) < 1e-4
    if channel == HELD:
        assert not run.velocity[:, 2].any()


def test_a_crawl_is_not_lost_in_rounding(tools):
    # 1e-8 m/s moves by a tenth of the spacing of floats per epoch.
    latitude, longitude, n, every = 0.7, 2.0, 1_000_000, 1000
    ins = tools.Ins(np.eye(3), latitude, longitude)
    ins.record.velocity_n[:2] = 1e-8
    run = ins.run(*at_rest(tools, latitude), DT, n, every=every)
    meridian, prime_vertical = earth.radii(latitude)
    velocity = np.vstack([[1e-8, 1e-8, 0.0], run.velocity])
    path = np.cumsum(velocity[1:] + velocity[:-1], axis=0) * DT * every / 2
    assert np.abs(path[:, :2]).max() > 5e-6
    north = (run.latitude - latitude) * meridian
    east = (run.longitude - longitude) * prime_vertical * math.cos(latitude)
    assert north == pytest.approx(path[:, 1], abs=2e-9)  # 0.7 nm and 2.2 nm: one spacing
    assert east == pytest.approx(path[:, 0], abs=4e-9)


def test_navigation_starts_at_rest_with_nothing_left_of_before(tools):
    ins = tools.Ins(np.eye(3), LATITUDE)
    ins.run([1e-3, 2e-3, 3e-3], [0.1, 0.2, 0.3], DT, 100, channel=DAMPED)
    C = tools.rotation(2, 1.0)
    strapdown.initialise(ins.record, C, 0.1, 0.2, 3.0)
    again = ins.run(*at_rest(tools, 0.1, 3.0, C), DT, 100, channel=DAMPED)
    fresh = tools.Ins(C, 0.1, 0.2, 3.0).run(*at_rest(tools, 0.1, 3.0, C), DT, 100, channel=DAMPED)
    for name in ("latitude", "longitude", "height", "velocity", "q"):
        assert np.array_equal(getattr(again, name), getattr(fresh, name)), name
