"""The rotation scheme against table 1, and an axis that does not do as it is told."""

from __future__ import annotations

import math

import pytest

from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.records.memory import INNER, OUTER
from rrins.firmware_py.core.settings import power_on
from rrins.firmware_py.core.turntable import sequencer

RATE_HZ, EPOCHS = 50, 175  # three seconds turning at 60 deg/s, half a second standing
AFTER_DEG = [  # table 1: angles of the inner and the outer axis after each position
    (180, 0),
    (180, -180),
    (360, -180),
    (360, 0),
    (360, 180),
    (540, 180),
    (540, 0),
    (720, 0),
    (540, 0),
    (540, 180),
    (360, 180),
    (360, 0),
    (360, -180),
    (180, -180),
    (180, 0),
    (0, 0),
]


class Rotation:
    """A running scheme whose axes follow perfectly, until a test says otherwise."""

    def __init__(self, tools, contract, positions=16, **changes):
        scheme = tools.scheme(positions=positions)
        self.ram = power_on(tools.settings(rate_hz=RATE_HZ, scheme=scheme, **changes), contract)
        self.sequencer, self.parameters = self.ram[0]["sequencer"], self.ram[0]["parameters"]
        self.assembly = self.ram[0]["assembly"]
        self.follows = [True, True]
        sequencer.start(self.sequencer, self.parameters, self.assembly)

    @property
    def targets(self):
        return tuple(self.sequencer["target_angle_deg"])

    def expected(self, axis):
        return sequencer.expected_angle_deg(self.sequencer, self.parameters, axis)

    def epoch(self):
        """Run one epoch; return whether an axis has been found not to follow."""
        for axis in (INNER, OUTER):
            if self.follows[axis]:
                self.assembly["encoder_angle_deg"][axis] = self.expected(axis)
        found = sequencer.watch(self.sequencer, self.parameters, self.assembly)
        sequencer.advance(self.sequencer, self.parameters)
        return found

    def epochs_until_found(self, limit=1000):
        return next(k for k in range(limit) if self.epoch())


@pytest.fixture
def rotation(tools, contract):
    return Rotation(tools, contract)


@pytest.mark.parametrize("positions", [16, 8])
def test_the_positions_are_those_of_table_1(tools, contract, positions):
    rotation = Rotation(tools, contract, positions)
    for k, after in enumerate(AFTER_DEG[:positions]):
        assert rotation.sequencer["position"] == k
        for _ in range(EPOCHS):
            assert rotation.targets == after
            assert not rotation.epoch()
    assert rotation.sequencer["position"] == 0
    assert rotation.sequencer["cycle"] == 1


def test_the_16_positions_return_to_the_start(rotation):
    for _ in range(2 * 16 * EPOCHS):
        rotation.epoch()
    assert rotation.sequencer["cycle"] == 2
    assert rotation.expected(INNER) == rotation.expected(OUTER) == 0


def test_one_axis_moves_at_a_time(rotation):
    before = [rotation.expected(INNER), rotation.expected(OUTER)]
    for _ in range(16 * EPOCHS):
        rotation.epoch()
        now = [rotation.expected(INNER), rotation.expected(OUTER)]
        assert (now[0] != before[0]) + (now[1] != before[1]) <= 1
        assert max(abs(a - b) for a, b in zip(now, before, strict=True)) <= 60 / RATE_HZ + 1e-9
        before = now


def test_the_papers_cycle_lasts_1600_seconds(tools):
    scheme = tools.scheme(turn_rate_dps=2.0, stand_s=10.0)
    assert scheme.cycle_s == 1600.0
    assert scheme.position_s(scheme.turns[0]) == 100.0


def test_an_axis_is_expected_to_turn_and_then_to_stand(rotation):
    angles = []
    for _ in range(EPOCHS):
        rotation.epoch()
        angles.append(rotation.expected(INNER))
    assert angles[49] == pytest.approx(60.0)
    assert angles[149:174] == pytest.approx([180.0] * 25)


def test_both_axes_are_commanded_to_a_position_while_it_runs(rotation):
    assert list(rotation.sequencer["command"]) == [AxisCommand.POSITION] * 2
    sequencer.stop(rotation.sequencer)
    assert list(rotation.sequencer["command"]) == [AxisCommand.HOLD] * 2
    assert not rotation.sequencer["running"]
    sequencer.switch_off(rotation.sequencer)
    assert list(rotation.sequencer["command"]) == [AxisCommand.OFF] * 2


def test_a_start_turns_back_to_zero_before_the_first_position(rotation):
    for _ in range(5 * EPOCHS - 1):
        rotation.epoch()
    assert rotation.targets == AFTER_DEG[4]
    sequencer.start(rotation.sequencer, rotation.parameters, rotation.assembly)
    epochs = 0
    while rotation.sequencer["homing"]:
        assert rotation.targets == (0, 0)
        assert not rotation.epoch()
        epochs += 1
    # 360° at 60°/s, and ten seconds to settle
    assert epochs == 16 * RATE_HZ
    assert rotation.targets == AFTER_DEG[0]
    assert (rotation.sequencer["position"], rotation.sequencer["cycle"]) == (0, 0)


@pytest.mark.parametrize("axis", [INNER, OUTER])
def test_an_axis_that_sticks_is_found_within_the_tolerance(rotation, axis):
    for _ in range(axis * EPOCHS):
        rotation.epoch()
    rotation.follows[axis] = False  # stays where it is
    # 5° of tolerance at 60°/s, 50 epochs a second
    assert rotation.epochs_until_found() == math.floor(5 / 60 * RATE_HZ) + 1
    assert [bool(n) for n in rotation.sequencer["not_following"]] == [axis == 0, axis == 1]


def test_an_axis_within_the_tolerance_is_let_be(rotation):
    rotation.follows[OUTER] = False
    rotation.assembly["encoder_angle_deg"][OUTER] = 4.99
    for _ in range(EPOCHS):
        assert not rotation.epoch()


def test_a_silent_axis_is_found_after_its_time(rotation):
    for k in range(100):
        rotation.assembly["axis_silent_epochs"][INNER] = k
        if rotation.epoch():
            break
    assert k == 0.1 * RATE_HZ + 1
    assert list(rotation.sequencer["not_following"]) == [1, 0]


def test_an_axis_that_reports_a_fault_is_found_at_once(rotation):
    rotation.assembly["axis_state"][OUTER] = AxisState.FAULT
    assert rotation.epoch()
    assert list(rotation.sequencer["not_following"]) == [0, 1]


def interrupted(rotation):
    """Interrupt the scheme as the mode logic does."""
    sequencer.stop(rotation.sequencer)
    sequencer.interrupt(rotation.sequencer, rotation.parameters)
    rotation.assembly["axis_state"][:] = AxisState.HOLDING


def epochs_waited(rotation, limit=100_000):
    """Wait for the next try; return for how many epochs."""
    arguments = (rotation.sequencer, rotation.parameters, rotation.assembly)
    return next(k for k in range(limit) if sequencer.wait(*arguments))


def test_an_interrupted_turn_is_completed_and_the_scheme_on_time_again(rotation):
    for _ in range(10):
        rotation.epoch()
    rotation.follows[INNER] = False
    stalled_deg = float(rotation.assembly["encoder_angle_deg"][INNER])
    found = 10 + rotation.epochs_until_found() + 1
    interrupted(rotation)
    assert not rotation.sequencer["running"]
    waited = epochs_waited(rotation)
    assert waited == RATE_HZ  # a second
    sequencer.resume(rotation.sequencer, rotation.parameters, rotation.assembly)
    assert rotation.sequencer["epochs"] == found + waited + 1
    assert rotation.expected(INNER) == pytest.approx(stalled_deg)
    rotation.follows[INNER] = True
    while rotation.sequencer["position"] == 0:
        assert rotation.sequencer["not_following"][INNER]
        assert not rotation.epoch()
    assert not rotation.sequencer["not_following"].any()
    assert rotation.sequencer["tries"] == 0
    assert list(rotation.sequencer["interruptions"]) == [1, 0]
    assert rotation.targets == AFTER_DEG[1]


def test_an_axis_is_tried_eight_times_and_then_abandoned(rotation):
    rotation.follows[INNER] = False
    waits = []
    for _ in range(sequencer.TRIES):
        rotation.epochs_until_found()
        interrupted(rotation)
        waits.append(epochs_waited(rotation))
        sequencer.resume(rotation.sequencer, rotation.parameters, rotation.assembly)
    assert waits == [RATE_HZ * 2**k for k in range(8)]
    rotation.epochs_until_found()
    interrupted(rotation)
    assert not rotation.sequencer["interrupted"]
    assert list(rotation.sequencer["abandoned"]) == [1, 0]
    assert list(rotation.sequencer["interruptions"]) == [1, 0]


@pytest.mark.parametrize("state", [AxisState.FAULT, AxisState.MOVING, AxisState.BRAKING])
def test_an_axis_that_does_not_stand_is_not_tried(rotation, state):
    rotation.follows[INNER] = False
    rotation.epochs_until_found()
    interrupted(rotation)
    rotation.assembly["axis_state"][INNER] = state
    assert not any(
        sequencer.wait(rotation.sequencer, rotation.parameters, rotation.assembly)
        for _ in range(3 * RATE_HZ)
    )
