"""The emulated odometer: what it counts, and when, against the way by numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.host_tools.hardware.fault_kinds import EVERY, HardwareFault
from rrins.host_tools.hardware.settings import (
    MotionPieces,
    OdometerSettings,
    PlannedFault,
    body_to_navigation,
)
from rrins.host_tools.motion.drive import synthetic_drive
from rrins.host_tools.motion.mounting import mounted
from rrins.host_tools.motion.trajectory import ATTITUDE, VELOCITY_N

BASE = np.array([math.radians(40), math.radians(116), 40.0, 0.0, 0.0, 0.7])
PERIOD_NS, RATE_HZ, LENGTH_S = 5_000_000, 200, 60


def moving(trajectory):
    return MotionPieces(trajectory.pieces, trajectory.knot_ns // PERIOD_NS, 0)


@pytest.fixture(scope="module")
def vehicle():
    return synthetic_drive(LENGTH_S, 5, BASE, PERIOD_NS)


def counts(bench, epochs):
    """Return the odometer's frames, by epoch."""
    found = {}
    for _ in range(epochs):
        epoch = bench.epoch
        sent = bench.step()
        if "ODOMETER" in sent:
            found[epoch] = sent["ODOMETER"]
    return found


def way_of(trajectory, forward_b, lever_arm_b=(0.0, 0.0, 0.0)):
    """Return the wheel's way at each epoch, m, from the vehicle's velocity and attitude alone."""
    rows = trajectory.at(np.arange(LENGTH_S * RATE_HZ + 1) / RATE_HZ)
    C_b_n = np.array([body_to_navigation(*angles) for angles in rows[:, ATTITUDE]])
    velocity = rows[:, VELOCITY_N] + np.gradient(C_b_n @ lever_arm_b, 1 / RATE_HZ, axis=0)
    speed = ((C_b_n @ forward_b) * velocity).sum(axis=1)
    return np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2)]) / RATE_HZ


def test_without_one_nothing_is_sent(tools):
    assert counts(tools.Bench(), 250) == {}


def test_a_count_is_sent_some_epochs_after_it_held(tools, vehicle):
    odometer = OdometerSettings(interval_epochs=20, latency_epochs=3, metres_per_pulse=0.001)
    bench = tools.Bench(odometer=odometer, motion=moving(vehicle))
    found = counts(bench, LENGTH_S * RATE_HZ)
    assert list(found) == list(range(3, LENGTH_S * RATE_HZ, 20))
    way = way_of(vehicle, [0, 1, 0])
    assert way[-1] > 100
    for epoch, frame in found.items():
        assert frame["alive_counter"] == epoch % 15
        assert (frame["valid"], frame["age_us"]) == (1, 15_000)
        assert frame["pulses"] == pytest.approx(1000 * way[epoch - 3], abs=1.1)


def test_mounting_lever_arm_and_scale_count(tools, vehicle):
    heading, pitch, arm = 0.03, -0.02, (0.8, -1.5, -0.4)
    odometer = OdometerSettings(
        interval_epochs=20,
        metres_per_pulse=0.001,
        scale_error=0.01,
        mounting=(heading, pitch),
        lever_arm_b=arm,
    )
    body = mounted(vehicle, heading, pitch)
    found = counts(tools.Bench(odometer=odometer, motion=moving(body)), LENGTH_S * RATE_HZ)
    forward_b = body_to_navigation(0.0, pitch, heading)[:, 1]
    way = 1.01 * way_of(body, forward_b, arm)
    straight = 1.01 * way_of(vehicle, [0, 1, 0])
    pulses = np.array([(frame["pulses"] + 2**31) % 2**32 - 2**31 for frame in found.values()])
    np.testing.assert_allclose(pulses / 1000, way[list(found)], atol=5e-3)
    assert np.abs(way - straight).max() > 0.2  # the lever arm turns with the vehicle


def test_its_noise_is_as_set_and_none_where_it_stands(tools, vehicle):
    settings = {"interval_epochs": 20, "metres_per_pulse": 1e-5}
    noisy = OdometerSettings(**settings, noise=0.02)
    frames = [
        counts(tools.Bench(odometer=odometer, motion=moving(vehicle)), LENGTH_S * RATE_HZ)
        for odometer in (OdometerSettings(**settings), noisy)
    ]
    ideal, real = (np.diff([f["pulses"] for f in found.values()]) * 1e-5 for found in frames)
    moves = np.abs(ideal) > 0.01 * 0.1
    np.testing.assert_allclose(real[~moves], ideal[~moves], atol=1.01e-5)  # a pulse
    speed_error = (real - ideal)[moves] / 0.1
    assert moves.sum() > 250
    assert np.std(speed_error) == pytest.approx(0.02, rel=0.14)  # 3 sigma
    assert abs(np.corrcoef(speed_error[1:], speed_error[:-1])[0, 1]) < 0.2


def ways(tools, vehicle, kind=None, value=0.0):
    """Return validity and the distances between counts, with a fault from 30 s to 40 s."""
    faults = () if kind is None else (PlannedFault(kind, EVERY, 6001, 8000, value),)
    odometer = OdometerSettings(interval_epochs=200, metres_per_pulse=0.001)
    bench = tools.Bench(odometer=odometer, motion=moving(vehicle), faults=faults)
    found = counts(bench, 9001).values()
    valid = [frame["valid"] for frame in found]
    return valid, np.diff([frame["pulses"] for frame in found]) / 1000


def test_a_wheel_that_slips_is_locked_or_does_not_count(tools, vehicle):
    valid, sound = ways(tools, vehicle)
    assert all(valid)
    assert sound[30:40].min() > 1
    for kind, value, share in (
        (HardwareFault.ODOMETER_SLIP, 0.2, 1.2),
        (HardwareFault.ODOMETER_LOCK, 0.0, 0.0),
        (HardwareFault.ODOMETER_LOST, 0.0, 0.0),
    ):
        valid, found = ways(tools, vehicle, kind, value)
        expected = sound.copy()
        expected[30:40] *= share
        np.testing.assert_allclose(found, expected, atol=2.5e-3)
        lost = kind == HardwareFault.ODOMETER_LOST
        assert valid == [1] * 31 + [int(not lost)] * 10 + [1] * 5
