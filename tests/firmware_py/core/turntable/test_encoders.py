"""The encoders against the gyros: what is a jump, what is not, and what is used instead."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.firmware_py.core.records.encoder_records import AngleSource
from rrins.firmware_py.core.records.memory import INNER, OUTER
from rrins.firmware_py.core.settings import power_on
from rrins.firmware_py.core.turntable import encoders
from rrins.firmware_py.core.turntable.sequencer import scheme_angle_deg

RATE_HZ = 200
DT = 1 / RATE_HZ
STEP_DEG = 360 / 2**26


class Table:
    """Two axes as encoders and gyros see them, in a vehicle that turns as a test says."""

    def __init__(self, tools, contract):
        self.scheme = tools.scheme(turn_rate_dps=2.0, stand_s=10.0)
        settings = tools.settings(rate_hz=RATE_HZ, scheme=self.scheme, axis_acceleration_dps2=10.0)
        self.state = power_on(settings, contract)[0]
        self.state["clock"]["synchronised"] = True
        self.angle_deg = np.zeros(2)
        self.error_deg = np.zeros(2)
        self.vehicle_dps = 0.0  # about the inner axis, which is that of the vehicle here

    @property
    def used_deg(self):
        return self.state["assembly"]["encoder_angle_deg"]

    def source(self, axis=INNER):
        return AngleSource(int(self.state["encoders"]["source"][axis]))

    def epoch(self, turned_deg=(0.0, 0.0), received=(True, True)):
        """Turn both axes, one after the other, and compare."""
        state, middle = self.state, math.radians(self.angle_deg[INNER] + 0.5 * turned_deg[INNER])
        inner, outer = np.radians(turned_deg)
        state["dtheta_s"] = [
            outer * math.cos(middle),
            -outer * math.sin(middle),
            inner + math.radians(self.vehicle_dps * DT),
        ]
        self.angle_deg += turned_deg
        assembly = state["assembly"]
        for axis in (INNER, OUTER):
            assembly["axis_received"][axis] = received[axis]
            if received[axis]:
                reading = self.angle_deg[axis] + self.error_deg[axis]
                assembly["encoder_angle_deg"][axis] = round(reading / STEP_DEG) * STEP_DEG
        encoders.follow(state, False)  # the vehicle does not know the Earth's turn


@pytest.fixture
def table(tools, contract):
    table = Table(tools, contract)
    for _ in range(5):
        table.epoch()
    return table


@pytest.mark.parametrize("axis", [INNER, OUTER])
@pytest.mark.parametrize("jump_deg", [-90.0, -0.03, 0.03, 1.0])
def test_a_jump_that_the_gyros_do_not_feel_is_taken_off(table, axis, jump_deg):
    turned = [0.0, 0.0]
    turned[axis] = 0.01
    for k in range(200):
        if k == 100:
            table.error_deg[axis] = jump_deg
        table.epoch(turned)
        assert table.used_deg[axis] == pytest.approx(table.angle_deg[axis], abs=1e-4)
    assert table.source(axis) == AngleSource.CORRECTED
    assert table.source(1 - axis) == AngleSource.ENCODER
    assert table.state["encoders"]["offset_deg"][axis] == pytest.approx(jump_deg, abs=1e-4)
    assert table.state["encoders"]["found_epoch"][1 - axis] == 0
    table.error_deg[axis] = 0.0
    table.epoch(turned)
    assert table.source(axis) == AngleSource.ENCODER
    assert table.used_deg[axis] == pytest.approx(table.angle_deg[axis], abs=STEP_DEG)


@pytest.mark.parametrize("gap", [1, 5, 30])
def test_a_jump_in_a_gap_of_its_frames_is_found_as_the_gap_allows(table, gap):
    for _ in range(50):
        table.epoch([0.01, 0.0])
    for _ in range(gap):
        table.epoch([0.01, 0.0], received=(False, True))
    table.error_deg[INNER] = 40.0
    for _ in range(3):
        table.epoch([0.01, 0.0])
    assert table.source() == AngleSource.CORRECTED
    assert table.used_deg[INNER] == pytest.approx(table.angle_deg[INNER], abs=1e-3)


def test_an_encoder_that_is_silent_for_long_is_replaced_by_the_gyros(table):
    for k in range(400):
        table.epoch([0.01 if k < 200 else 0.0, 0.0], received=(False, True))
        table.state["assembly"]["encoder_angle_deg"][INNER] = table.used_deg[INNER]
    # By the rate of the last frame, 0, for 20 epochs; then by the gyros.
    assert table.used_deg[INNER] == pytest.approx(table.angle_deg[INNER] - 0.2, abs=1e-3)


@pytest.mark.parametrize("axis", [INNER, OUTER])
@pytest.mark.parametrize(
    ("vehicle_dps", "obeys", "missed", "doubtful"),
    [
        (8.0, 1.0, 0.0, 0.0),
        (8.0, 1.0, 1.0, 1.0),
        (8.0, 1.0, -0.01, 0.01),
        (8.0, 0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0, 0.0),
        (0.0, 1.0, 0.01, 0.01),
        (0.0, 1.0, 0.009, 0.009),
    ],
    ids=["sound", "sticks", "slips", "stalls", "stalls at rest", "slips at rest", "by little"],
)
def test_an_angle_that_strays_is_doubtful_unless_the_gyros_feel_it(
    table, axis, vehicle_dps, obeys, missed, doubtful
):
    """A turn of 10°, of which the axis does a share, and the encoder misses one.

    The vehicle turns about the inner axis: no outer axis seems to turn with it.
    """
    doubtful *= axis == INNER or obeys > 0.0
    state, running = table.state, table.state["sequencer"]
    state["integrity"]["enabled"] = True
    running["running"] = True
    running["target_angle_deg"][axis] = 10.0
    table.vehicle_dps = vehicle_dps
    before_deg = 0.0
    for epoch in range(1, 1100):
        running["epochs"] = epoch
        expected_deg = scheme_angle_deg(running, state["parameters"], axis)
        turned = [0.0, 0.0]
        turned[axis] = obeys * (expected_deg - before_deg)
        table.error_deg[axis] = -missed * (table.angle_deg[axis] + turned[axis])
        table.epoch(turned)
        before_deg = expected_deg
    assert math.isclose(before_deg, 10.0)
    found_deg = encoders.doubtful_deg(state["encoders"], state["parameters"])
    assert found_deg == pytest.approx(1.25 * 10.0 * doubtful, abs=0.01)
    assert state["encoders"]["doubted"][axis] == (doubtful > 0.0)
